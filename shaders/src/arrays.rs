//! A scene as flat arrays with scene-wide numbers: what the GPU binds and what the CPU twins read.

use glam::{DMat3, DVec3};
use lodestream_format::hierarchy::{Group, Node, Part};
use lodestream_format::proxy::Proxy;
use lodestream_format::scene::{AlphaMode, Instance, Material, Wrap};
use lodestream_format::{Asset, Hierarchy, Scene};

use crate::proxies::proxy_record;
use crate::types::{
    AssetRecord, InstanceRecord, MaterialRecord, NO_MASK_CUTOFFS, NO_TEXTURE, NOT_INSTALLED,
    ProxyRecord, WHITE_TEXEL, material_flag,
};

/// Flat arrays of a scene. Node, group and page numbers inside an asset count from the bases in its [`AssetRecord`].
#[derive(Debug, Clone, Default)]
pub struct SceneArrays {
    /// Placements.
    pub instances: Vec<InstanceRecord>,
    /// Bases and grids of the assets.
    pub assets: Vec<AssetRecord>,
    /// Hierarchy nodes of all assets.
    pub nodes: Vec<Node>,
    /// Groups of all assets; first parts and first pages count from the asset's bases.
    pub groups: Vec<Group>,
    /// Group parts of all assets.
    pub parts: Vec<Part>,
    /// Scene material of each asset's slots.
    pub material_slots: Vec<u32>,
    /// Materials; a scene without any has one default.
    pub materials: Vec<MaterialRecord>,
    /// Centre of each asset in object space, metres.
    pub centers: Vec<DVec3>,
    /// Proxies of the assets.
    pub proxies: Vec<Proxy>,
    /// Pages of all assets.
    pub page_count: u32,
    /// Levels of nodes of the deepest hierarchy: how many rounds `cull_nodes` takes.
    pub depth: u32,
}

impl SceneArrays {
    /// Flattens `scene` over its `assets`, which stand in the order of `scene.assets`.
    pub fn new<'a>(
        scene: &Scene,
        assets: impl Iterator<Item = (&'a Asset, &'a Hierarchy)>,
    ) -> Self {
        let mut arrays = Self::default();
        for (used, (asset, hierarchy)) in scene.assets.iter().zip(assets) {
            arrays.assets.push(AssetRecord {
                node_base: arrays.nodes.len() as u32,
                group_base: arrays.groups.len() as u32,
                part_base: arrays.parts.len() as u32,
                page_base: arrays.page_count,
                aabb_min: asset.aabb.min,
                position_step: asset.position_grid.step() as f32,
                aabb_max: asset.aabb.max,
                uv_step: asset.uv_grid.step() as f32,
                attributes: asset.attributes.0,
                material_base: arrays.material_slots.len() as u32,
                spare: [0; 2],
            });
            arrays.proxies.push(asset.proxy.clone());
            arrays.nodes.extend(&hierarchy.nodes);
            arrays.groups.extend(&hierarchy.groups);
            arrays.parts.extend(&hierarchy.parts);
            // A slot that the scene does not map falls back on its first material, so that no lookup leaves the array.
            let slots = (0..asset.material_slots as usize)
                .map(|slot| used.materials.get(slot).copied().unwrap_or(0));
            arrays.material_slots.extend(slots);
            arrays.page_count += asset.pages.len() as u32;
            arrays.depth = arrays.depth.max(hierarchy.depth);
            arrays.centers.push(DVec3::from(asset.center_in_object()));
        }
        arrays.instances = scene
            .instances
            .iter()
            .filter_map(|instance| arrays.instance_record(instance))
            .collect();
        arrays.materials = scene.materials.iter().map(material_record).collect();
        if arrays.materials.is_empty() {
            arrays.materials.push(material_record(&DEFAULT_MATERIAL));
        }
        arrays
    }

    /// An instance as the GPU has it; `None` where its asset is not one of the scene's.
    pub fn instance_record(&self, instance: &Instance) -> Option<InstanceRecord> {
        let center_in_object = *self.centers.get(instance.asset as usize)?;
        Some(instance_record(instance, center_in_object))
    }

    /// The proxies with `materials`, as points show them.
    pub fn proxy_records(&self, materials: &[MaterialRecord]) -> Vec<ProxyRecord> {
        let record = |(proxy, asset): (&Proxy, &AssetRecord)| {
            let slots = self.material_slots.get(asset.material_base as usize..);
            proxy_record(proxy, slots.unwrap_or(&[]), materials)
        };
        self.proxies.iter().zip(&self.assets).map(record).collect()
    }

    /// A page table with nothing installed.
    pub fn empty_page_table(&self) -> Vec<u32> {
        vec![NOT_INSTALLED; self.page_count as usize]
    }

    /// The sphere of everything in world space: centre and radius, metres, in f64. `None` for a scene without instances.
    pub fn bounds_in_world(&self) -> Option<(DVec3, f64)> {
        let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
        for instance in &self.instances {
            let asset = &self.assets[instance.asset as usize];
            for corner in 0..8 {
                let pick = |axis: usize| {
                    (if corner >> axis & 1 == 0 {
                        asset.aabb_min[axis]
                    } else {
                        asset.aabb_max[axis]
                    }) as f64
                };
                let world = instance.world_from_local(DVec3::new(pick(0), pick(1), pick(2)));
                (low, high) = (low.min(world), high.max(world));
            }
        }
        (!self.instances.is_empty()).then(|| ((low + high) * 0.5, (high - low).length() * 0.5))
    }
}

impl InstanceRecord {
    /// A local point in world space, in f64.
    pub fn world_from_local(&self, point: DVec3) -> DVec3 {
        let column = |column: [f32; 3]| DVec3::from(column.map(f64::from));
        let linear = DMat3::from_cols(
            column(self.linear_x),
            column(self.linear_y),
            column(self.linear_z),
        );
        column(self.translation_high) + column(self.translation_low) + linear * point
    }
}

/// `value` as the sum of two f32 vectors, exact to about 48 bits.
pub fn split(value: DVec3) -> ([f32; 3], [f32; 3]) {
    let high = value.to_array().map(|value| value as f32);
    let low = std::array::from_fn(|axis| (value[axis] - high[axis] as f64) as f32);
    (high, low)
}

fn instance_record(instance: &Instance, center_in_object: DVec3) -> InstanceRecord {
    let rows = instance.world_from_object;
    let linear = DMat3::from_cols_array_2d(
        &[0, 1, 2].map(|column| [0, 1, 2].map(|row: usize| rows[row][column])),
    );
    let translation = DVec3::new(rows[0][3], rows[1][3], rows[2][3]) + linear * center_in_object;
    let (translation_high, translation_low) = split(translation);
    let column = |index: usize| linear.col(index).to_array().map(|value| value as f32);
    InstanceRecord {
        translation_high,
        asset: instance.asset,
        translation_low,
        max_scale: lodestream_format::bounds::round_up(largest_stretch(linear) * (1.0 + 1e-6)),
        linear_x: column(0),
        mirrored: (linear.determinant() < 0.0) as u32,
        linear_y: column(1),
        spare_0: 0,
        linear_z: column(2),
        proxy: instance.asset,
    }
}

/// Largest singular value, by power iteration on `AᵀA` from each axis, bounded from above by the Frobenius norm.
fn largest_stretch(linear: DMat3) -> f64 {
    let square = linear.transpose() * linear;
    let frobenius = linear
        .to_cols_array()
        .iter()
        .map(|value| value * value)
        .sum::<f64>()
        .sqrt();
    let from_axis = |axis: DVec3| {
        let direction = (0..64).fold(axis, |vector, _| (square * vector).normalize_or(axis));
        (square * direction).length().sqrt()
    };
    [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .map(from_axis)
        .fold(0.0, f64::max)
        .min(frobenius)
}

const DEFAULT_MATERIAL: Material = Material {
    name: String::new(),
    base_color_factor: [0.8, 0.8, 0.8, 1.0],
    base_color: None,
    emissive_factor: [0.0; 3],
    metallic: 0.0,
    roughness: 1.0,
    alpha_mode: AlphaMode::Opaque,
    double_sided: true,
    unlit: false,
};

fn material_record(material: &Material) -> MaterialRecord {
    let mut flags = 0;
    let mut set = |flag, when| flags |= if when { flag } else { 0 };
    set(material_flag::DOUBLE_SIDED, material.double_sided);
    set(material_flag::UNLIT, material.unlit);
    // Blended surfaces are drawn as masked at one half: the visbuffer holds one surface a pixel.
    let alpha_cutoff = match material.alpha_mode {
        AlphaMode::Opaque => 0.0,
        AlphaMode::Mask { cutoff } => cutoff,
        AlphaMode::Blend => 0.5,
    };
    set(
        material_flag::MASK,
        material.alpha_mode != AlphaMode::Opaque,
    );
    let mut rows = lodestream_format::scene::TextureUse::IDENTITY;
    if let Some(used) = &material.base_color {
        rows = used.uv_transform;
        set(material_flag::NEAREST, used.nearest);
        for (wrap, clamp, mirror) in [
            (
                used.wrap[0],
                material_flag::CLAMP_U,
                material_flag::MIRROR_U,
            ),
            (
                used.wrap[1],
                material_flag::CLAMP_V,
                material_flag::MIRROR_V,
            ),
        ] {
            set(clamp, wrap == Wrap::Clamp);
            set(mirror, wrap == Wrap::Mirror);
        }
    }
    MaterialRecord {
        base_color: material.base_color_factor,
        emissive: material.emissive_factor,
        alpha_cutoff,
        uv_row_u: rows[0],
        texture: material
            .base_color
            .as_ref()
            .map_or(NO_TEXTURE, |used| used.texture),
        uv_row_v: rows[1],
        flags,
        metallic: material.metallic,
        roughness: material.roughness,
        mask_cutoffs: NO_MASK_CUTOFFS,
        mean_texel: WHITE_TEXEL,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretch_of_known_maps() {
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Z);
        assert!((largest_stretch(shear) - 1.618_033_988_7).abs() < 1e-6);
        assert!(
            (largest_stretch(DMat3::from_diagonal(DVec3::new(1e-6, -3.0, 2.0))) - 3.0).abs() < 1e-9
        );
        assert_eq!(largest_stretch(DMat3::ZERO), 0.0);
    }

    #[test]
    fn split_keeps_millimetres_at_ten_thousand_kilometres() {
        let value = DVec3::new(1e7 + 0.001, -6.4e6 - 0.002, 0.0);
        let (high, low) = split(value);
        for axis in 0..3 {
            assert!((high[axis] as f64 + low[axis] as f64 - value[axis]).abs() < 1e-6);
        }
    }
}

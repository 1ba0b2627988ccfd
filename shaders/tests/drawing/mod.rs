//! A one-asset scene built by hand, drawn with the CPU twins.
#![allow(dead_code, reason = "each test file uses its part")]

use glam::{DVec3, Mat3, Vec3};
use lodestream_format::cluster::{Attributes, Cluster, MaterialRange, NO_GROUP};
use lodestream_format::{memory_form, octahedral};
use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::{self, Camera, Textures};
use lodestream_shaders::types::{
    AssetRecord, ClusterItem, InstanceRecord, MaterialRecord, NO_MASK_CUTOFFS, NO_TEXTURE,
    ShadeMode, View, material_flag,
};

/// Metres a grid step of [`cluster`].
pub const STEP: f32 = 1.0 / 65536.0;
/// Texture widths a texture-grid step.
pub const UV_STEP: f32 = 1.0 / 4096.0;
pub const SIZE_PX: [u32; 2] = [96, 64];

pub struct Picture {
    pub arrays: SceneArrays,
    pub pool: Vec<u32>,
    pub visible: Vec<ClusterItem>,
    pub view: View,
    pub textures: Textures,
}

impl Picture {
    /// All clusters in one page, one instance at the origin, one white two-sided matt material, a camera at +Z.
    pub fn new(clusters: &[Cluster], attributes: u32) -> Self {
        let pool =
            memory_form::encode(clusters, Attributes(attributes), 0).expect("clusters are valid");
        let asset = AssetRecord {
            node_base: 0,
            group_base: 0,
            part_base: 0,
            page_base: 0,
            aabb_min: [-4.0; 3],
            position_step: STEP,
            aabb_max: [4.0; 3],
            uv_step: UV_STEP,
            attributes,
            material_base: 0,
            spare: [0; 2],
        };
        let arrays = SceneArrays {
            instances: vec![instance(Mat3::IDENTITY, DVec3::ZERO)],
            assets: vec![asset],
            material_slots: (0..8).collect(),
            materials: vec![WHITE],
            page_count: 1,
            ..SceneArrays::default()
        };
        let visible = (0..clusters.len() as u32)
            .map(|cluster| ClusterItem {
                instance: 0,
                page: 0,
                cluster,
                page_word: 0,
            })
            .collect();
        Self {
            arrays,
            pool,
            visible,
            view: camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO).view(0.01, 1.0),
            textures: Textures::default(),
        }
    }

    pub fn raster(&self) -> Vec<u64> {
        cpu::raster(&self.visible, &self.arrays, &self.pool, &self.view)
    }

    pub fn raster_masked(&self) -> Vec<u64> {
        cpu::raster_masked(
            &self.visible,
            &self.arrays,
            &self.pool,
            &self.view,
            &self.textures,
        )
    }

    /// RGB bytes of every pixel.
    pub fn shade(&mut self, mode: ShadeMode) -> Vec<[u8; 3]> {
        self.view.shade_mode = mode as u32;
        let counts = cpu::raster_overdraw(&self.visible, &self.arrays, &self.pool, &self.view);
        let colors = cpu::shade(
            &self.raster(),
            &self.visible,
            &self.arrays,
            &self.pool,
            &self.view,
            &self.textures,
            &counts,
        );
        colors
            .iter()
            .map(|color| {
                let [r, g, b, a] = color.to_le_bytes();
                assert_eq!(a, 255);
                [r, g, b]
            })
            .collect()
    }
}

pub const WHITE: MaterialRecord = MaterialRecord {
    base_color: [0.8, 0.8, 0.8, 1.0],
    emissive: [0.0; 3],
    alpha_cutoff: 0.0,
    uv_row_u: [1.0, 0.0, 0.0],
    texture: NO_TEXTURE,
    uv_row_v: [0.0, 1.0, 0.0],
    flags: material_flag::DOUBLE_SIDED,
    metallic: 0.0,
    roughness: 1.0,
    mask_cutoffs: NO_MASK_CUTOFFS,
    mean_texel: u32::MAX,
};

pub fn camera(eye: DVec3, target: DVec3) -> Camera {
    Camera {
        eye,
        target,
        up: DVec3::Y,
        fov_y_degrees: 60.0,
        size_px: SIZE_PX,
    }
}

pub fn instance(linear: Mat3, translation: DVec3) -> InstanceRecord {
    let (translation_high, translation_low) = lodestream_shaders::arrays::split(translation);
    InstanceRecord {
        translation_high,
        asset: 0,
        translation_low,
        max_scale: linear
            .x_axis
            .length()
            .max(linear.y_axis.length())
            .max(linear.z_axis.length()),
        linear_x: linear.x_axis.into(),
        mirrored: (linear.determinant() < 0.0) as u32,
        linear_y: linear.y_axis.into(),
        spare_0: 0,
        linear_z: linear.z_axis.into(),
        proxy: 0,
    }
}

/// Corners of a mesh: position, normal, texture coordinates.
pub type Corner = (Vec3, Vec3, [f32; 2]);

/// A cluster of the asset's first material slot with the attributes that `attributes` names.
pub fn cluster(corners: &[Corner], triangles: &[[u8; 3]], attributes: u32) -> Cluster {
    let has = |flag| attributes & flag != 0;
    Cluster {
        positions: corners
            .iter()
            .map(|corner| {
                corner
                    .0
                    .to_array()
                    .map(|value| (value / STEP).round() as i32)
            })
            .collect(),
        normals: corners
            .iter()
            .filter(|_| has(Attributes::NORMAL))
            .map(|corner| octahedral::encode(corner.1.into()))
            .collect(),
        uvs: corners
            .iter()
            .filter(|_| has(Attributes::UV))
            .map(|corner| corner.2.map(|value| (value / UV_STEP).round() as i32))
            .collect(),
        colors: corners
            .iter()
            .filter(|_| has(Attributes::COLOR))
            .map(|_| [255, 128, 0, 255])
            .collect(),
        triangles: triangles.to_vec(),
        materials: vec![MaterialRange {
            slot: 0,
            triangle_count: triangles.len() as u16,
        }],
        level: 0,
        group: 0,
        child_group: NO_GROUP,
    }
}

/// A square of side 2 at height `z`, facing +Z, its texture upright.
pub fn square(z: f32, attributes: u32) -> Cluster {
    let corner = |x: f32, y: f32| (Vec3::new(x, y, z), Vec3::Z, [x * 0.5 + 0.5, 0.5 - y * 0.5]);
    cluster(
        &[
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ],
        &[[0, 1, 2], [0, 2, 3]],
        attributes,
    )
}

/// The unit sphere, 112 triangles.
pub fn sphere(attributes: u32) -> Cluster {
    let (rows, columns) = (8u32, 8u32);
    let mut corners = Vec::new();
    for row in 0..=rows {
        for column in 0..columns {
            let (polar, around) = (
                row as f32 / rows as f32 * std::f32::consts::PI,
                column as f32 / columns as f32 * std::f32::consts::TAU,
            );
            let point = Vec3::new(
                polar.sin() * around.sin(),
                polar.cos(),
                polar.sin() * around.cos(),
            );
            corners.push((point, point, [0.0, 0.0]));
        }
    }
    let at = |row: u32, column: u32| (row * columns + column % columns) as u8;
    let mut triangles = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let [a, b] = [at(row, column), at(row, column + 1)];
            let [c, d] = [at(row + 1, column), at(row + 1, column + 1)];
            if row > 0 {
                triangles.push([a, c, b]);
            }
            if row + 1 < rows {
                triangles.push([b, c, d]);
            }
        }
    }
    cluster(&corners, &triangles, attributes)
}

/// Index of the pixel in the middle.
pub fn center() -> usize {
    pixel(SIZE_PX[0] / 2, SIZE_PX[1] / 2)
}

pub fn pixel(x: u32, y: u32) -> usize {
    (y * SIZE_PX[0] + x) as usize
}

//! Instances below a pixel. Twin of `wgsl/shared/proxy.wgsl`.

use glam::Vec3;
use lodestream_format::Sphere;

use super::error_metric::projected_error_px;
use super::hash::hash;
use super::light::{light_surface, safe_normalize, tone};
use super::srgb::{pack_color, srgb_from_linear};
use super::view::{dot3, rel_from_local};
use crate::types::{
    AssetRecord, ClusterItem, InstanceRecord, POINT_FLAG, ProxyRecord, ProxySideRecord, View,
};

/// Largest part of an emissive colour that a record holds.
pub const MOST_EMISSIVE: f32 = 16.0;

/// Whether an instance is at most a pixel error wide, and at most a pixel.
pub fn draws_as_point(view: &View, instance: &InstanceRecord, asset: &AssetRecord) -> bool {
    if view.is_reference() || view.instance_count < 2 {
        return false;
    }
    let sphere = sphere(asset);
    let width_px = projected_error_px(view, instance, sphere, 2.0 * sphere.radius, 0.0);
    width_px <= view.pixel_error_px.min(1.0)
}

fn sphere(asset: &AssetRecord) -> Sphere {
    let half = (Vec3::from(asset.aabb_max) - Vec3::from(asset.aabb_min)) * 0.5;
    Sphere {
        center: (Vec3::from(asset.aabb_min) + half).to_array(),
        radius: dot3(half, half).sqrt(),
    }
}

/// The point of an instance, if its pixel's sample meets it: it does with the probability of the
/// area that it covers, the same in every frame.
pub fn point_of(
    view: &View,
    index: u32,
    instance: &InstanceRecord,
    asset: &AssetRecord,
    proxy: &ProxyRecord,
) -> Option<ClusterItem> {
    let rel = rel_from_local(instance, view, Vec3::from(sphere(asset).center));
    let column = |index: usize| glam::Vec4::from(view.clip_from_rel[index]);
    let clip = column(0) * rel.x + column(1) * rel.y + column(2) * rel.z + column(3);
    if clip.w.partial_cmp(&view.near_metres) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let size = view.size_px.map(|side| side as f32);
    let x = (0.5 + 0.5 * (clip.x / clip.w)) * size[0];
    let y = (0.5 - 0.5 * (clip.y / clip.w)) * size[1];
    if !(x >= 0.0 && y >= 0.0 && x < size[0] && y < size[1]) {
        return None;
    }
    let distance = dot3(rel, rel).sqrt();
    let to_eye = safe_normalize(-rel, -Vec3::from(view.forward));
    let columns = [instance.linear_x, instance.linear_y, instance.linear_z].map(Vec3::from);
    let sign = if instance.mirrored != 0 { -1.0 } else { 1.0 };
    let faces = [
        columns[1].cross(columns[2]) * sign,
        columns[2].cross(columns[0]) * sign,
        columns[0].cross(columns[1]) * sign,
    ];
    let toward = faces.map(|face| face.dot(to_eye));
    let areas: [f32; 3] = std::array::from_fn(|axis| proxy.areas_m2[axis] * toward[axis].abs());
    let sum = areas[0] + areas[1] + areas[2];
    let root = (areas[0] * areas[0] + areas[1] * areas[1] + areas[2] * areas[2]).sqrt();
    let area_m2 = root * (1.0 - proxy.boxiness) + sum * proxy.boxiness;
    let px_a_metre = view.pixels_at_one_metre / clip.w;
    let area_px = area_m2 * px_a_metre * px_a_metre * (distance / clip.w);
    if (hash(index) >> 8) as f32 / 16_777_216.0 >= area_px {
        return None;
    }
    let mut color = Vec3::ZERO;
    for axis in 0..3 {
        let side = &proxy.sides[2 * axis + usize::from(toward[axis] < 0.0)];
        let normal = side.normal();
        let normal = faces[0] * normal.x + faces[1] * normal.y + faces[2] * normal.z;
        let normal = safe_normalize(normal, to_eye);
        let [metallic, roughness] = side.metallic_roughness();
        let lit = light_surface(side.base_color(), metallic, roughness, normal, to_eye);
        color += (lit + side.emissive()) * (areas[axis] / sum);
    }
    let srgb = Vec3::from(tone(color).to_array().map(srgb_from_linear));
    Some(ClusterItem {
        instance: index,
        page: POINT_FLAG | (y as u32 * view.size_px[0] + x as u32),
        cluster: pack_color(srgb),
        page_word: (clip.z / clip.w).to_bits(),
    })
}

impl ProxySideRecord {
    fn halves(word: u32) -> [f32; 2] {
        [word & 0xffff, word >> 16].map(|half| half as f32 / 65_535.0)
    }

    /// Linear, vertex colours and textures multiplied in; without what `emissive` has.
    pub fn base_color(&self) -> Vec3 {
        let [red, green] = Self::halves(self.words[0]);
        Vec3::new(red, green, Self::halves(self.words[1])[0])
    }

    /// Linear, with the base colour of unlit materials.
    pub fn emissive(&self) -> Vec3 {
        let [green, blue] = Self::halves(self.words[2]);
        Vec3::new(Self::halves(self.words[1])[1], green, blue) * MOST_EMISSIVE
    }

    /// Mean normal, local.
    pub fn normal(&self) -> Vec3 {
        let part = |shift: u32| ((self.words[3] >> shift) & 255) as f32 / 127.0 - 1.0;
        Vec3::new(part(0), part(8), part(16))
    }

    /// Four bits each.
    pub fn metallic_roughness(&self) -> [f32; 2] {
        [24, 28].map(|shift| ((self.words[3] >> shift) & 15) as f32 / 15.0)
    }

    /// Rounds to the record.
    pub fn new(
        base_color: Vec3,
        emissive: Vec3,
        normal: Vec3,
        metallic_roughness: [f32; 2],
    ) -> Self {
        let unorm = |value: f32, steps: f32| (value.clamp(0.0, 1.0) * steps).round() as u32;
        let halves = |low: f32, high: f32| unorm(low, 65_535.0) | unorm(high, 65_535.0) << 16;
        let glow = emissive / MOST_EMISSIVE;
        let signed = |value: f32| ((value.clamp(-1.0, 1.0) + 1.0) * 127.0).round() as u32;
        let [metallic, roughness] = metallic_roughness.map(|value| unorm(value, 15.0));
        let axes = signed(normal.x) | signed(normal.y) << 8 | signed(normal.z) << 16;
        Self {
            words: [
                halves(base_color.x, base_color.y),
                halves(base_color.z, glow.x),
                halves(glow.y, glow.z),
                axes | metallic << 24 | roughness << 28,
            ],
        }
    }
}

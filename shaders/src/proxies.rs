//! Proxies of a scene's assets with the materials of the scene: what points are coloured by.

use glam::Vec3;
use lodestream_format::octahedral;
use lodestream_format::proxy::{Proxy, ProxySide};

use crate::cpu::srgb::linear_from_byte;
use crate::types::{MaterialRecord, ProxyRecord, ProxySideRecord, material_flag};

/// The record of `proxy` where its slots show the materials that `slots` names.
pub fn proxy_record(proxy: &Proxy, slots: &[u32], materials: &[MaterialRecord]) -> ProxyRecord {
    let looks: [Look; 6] =
        std::array::from_fn(|side| Look::of(&proxy.sides[side], slots, materials));
    let cover = |axis: usize| (looks[2 * axis].cover + looks[2 * axis + 1].cover) * 0.5;
    ProxyRecord {
        areas_m2: std::array::from_fn(|axis| proxy.areas_m2[axis] * cover(axis)),
        boxiness: proxy.boxiness,
        sides: looks.map(|look| look.record),
    }
}

/// A side with its materials.
struct Look {
    /// Share of the area that masks leave.
    cover: f32,
    record: ProxySideRecord,
}

impl Look {
    fn of(side: &ProxySide, slots: &[u32], materials: &[MaterialRecord]) -> Self {
        let total: f32 = side.shares.iter().map(|share| share.share as f32).sum();
        let vertex_color = Vec3::from(side.color.map(|value| value as f32 / 255.0));
        let (mut base, mut emissive) = (Vec3::ZERO, Vec3::ZERO);
        let (mut metallic, mut roughness, mut cover) = (0.0, 0.0, 0.0);
        for share in &side.shares {
            let slot = slots.get(share.slot as usize).copied().unwrap_or(0);
            let Some(material) = materials.get(slot as usize) else {
                continue;
            };
            let weight = share.share as f32 / total;
            let [red, green, blue, alpha] = material.mean_texel.to_le_bytes();
            let texel = Vec3::from([red, green, blue].map(linear_from_byte));
            let [r, g, b, _] = material.base_color;
            let color = Vec3::new(r, g, b) * texel * vertex_color * weight;
            match material.flags & material_flag::UNLIT != 0 {
                true => emissive += color,
                false => base += color,
            }
            emissive += Vec3::from(material.emissive) * weight;
            metallic += material.metallic * weight;
            roughness += material.roughness * weight;
            cover += weight * alpha as f32 / 255.0;
        }
        let normal = Vec3::from(octahedral::decode(side.normal));
        Self {
            cover,
            record: ProxySideRecord::new(base, emissive, normal, [metallic, roughness]),
        }
    }
}

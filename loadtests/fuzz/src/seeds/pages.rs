//! Pages of made clusters in both forms and every codec.

use lodestream_format::cluster::{Attributes, MaterialRange, NO_GROUP};
use lodestream_format::disk_form::{self, Parent};
use lodestream_format::frame::{self, Codec};
use lodestream_format::{Cluster, memory_form};

use super::Seeds;
use crate::targets::input::{bytes, sized};

/// A sheet of eight by eight squares.
fn cluster(from: i32, attributes: Attributes, materials: Vec<MaterialRange>) -> Cluster {
    let square = |square: u8| {
        let a = square / 8 * 9 + square % 8;
        [[a, a + 1, a + 10], [a, a + 10, a + 9]]
    };
    let each = |flag: u32| 0..if attributes.has(flag) { 81 } else { 0 };
    Cluster {
        positions: (0..81).map(|v| [from + v % 9, v / 9, v * v % 77]).collect(),
        normals: each(Attributes::NORMAL)
            .map(|v: i32| [v as u16 * 9, 512])
            .collect(),
        uvs: each(Attributes::UV)
            .map(|v| [v % 9 * 400, from + v / 9])
            .collect(),
        colors: each(Attributes::COLOR)
            .map(|v| [v as u8, 255, 7, from as u8])
            .collect(),
        triangles: (0..64).flat_map(square).collect(),
        materials,
        level: 1,
        group: 7,
        child_group: NO_GROUP,
    }
}

/// Pages with and without parents, attributes and material tables.
pub fn forms(seeds: &Seeds) {
    let range = |slot, triangle_count| MaterialRange {
        slot,
        triangle_count,
    };
    for flags in 0..=Attributes::ALL {
        let attributes = Attributes(flags);
        let one = cluster(0, attributes, vec![range(0, 128)]);
        let next = cluster(8, attributes, vec![range(3, 100), range(900, 28)]);
        let mut parent = one.clone();
        parent.triangles.truncate(90);
        parent.materials = vec![range(0, 90)];
        (parent.child_group, parent.group) = (7, 3);
        let parent = disk_form::canonical(&parent);
        let above =
            memory_form::encode(std::slice::from_ref(&parent), attributes, 1).expect("a page");
        let named = [Parent {
            page: 1,
            index: 0,
            cluster: &parent,
        }];
        for (name, clusters, parents) in [
            ("one", vec![one.clone()], &[][..]),
            ("two", vec![one.clone(), next.clone()], &[]),
            ("below", vec![one, next], &named),
        ] {
            let disk = disk_form::encode(&clusters, attributes, 2, parents).expect("a page");
            let own = if parents.is_empty() {
                vec![]
            } else {
                bytes(&above)
            };
            let name = format!("{name}-{flags}");
            seeds.add("disk_form", &name, &[&sized(&own), &bytes(&disk)]);
            for codec in [Codec::None, Codec::Zstd, Codec::Lz4] {
                let frame = frame::encode(&disk, codec).expect("a frame");
                seeds.add("frame", &format!("{name}-{codec:?}"), &[&frame]);
            }
        }
        let clusters: Vec<u8> = (0..400u32).map(|it| (it * it % 251) as u8 % 9).collect();
        seeds.add(
            "memory_form",
            &format!("any-{flags}"),
            &[&[flags as u8], &clusters],
        );
    }
}

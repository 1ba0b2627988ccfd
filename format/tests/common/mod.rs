//! Clusters for tests: a fixed one that uses every feature, and random ones.
// Each test binary uses its own part of this module; failing loudly is what a test's unwrap is for.
#![allow(dead_code, clippy::unwrap_used)]

use lodestream_format::cluster::{Attributes, Cluster, MaterialRange, NO_GROUP};
use proptest::prelude::*;

/// Three clusters with every attribute; the second needs a material table, the third has four vertices of the first.
pub fn fixed() -> Vec<Cluster> {
    let cluster = |seed: i32, materials: Vec<MaterialRange>, group, child_group| Cluster {
        positions: (0..6)
            .map(|v: i32| {
                [
                    seed + v * 37 % 100,
                    -seed + v * v,
                    (v * 70_001) % 90_000 - 500,
                ]
            })
            .collect(),
        normals: (0..6).map(|v| [v * 100, 1023 - v * 3]).collect(),
        uvs: (0..6).map(|v| [v * 300 - 40, 5]).collect(),
        colors: (0..6).map(|v| [10 + v * 7, 255, v, 128]).collect(),
        triangles: vec![[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]],
        materials,
        level: 3,
        group,
        child_group,
    };
    let range = |slot, triangle_count| MaterialRange {
        slot,
        triangle_count,
    };
    let first = cluster(1_000, vec![range(0, 1), range(63, 2), range(7, 1)], 4, 17);
    let second = cluster(-77, vec![range(64, 3), range(65_000, 1)], 4, NO_GROUP);
    let mut third = first.clone();
    third.positions[1][2] += 5;
    third.normals[4] = [3, 900];
    vec![first, second, third]
}

/// Clusters, and after them as many that have vertices of one before, in another order and some of them changed.
pub fn page(attributes: Attributes) -> impl Strategy<Value = Vec<Cluster>> {
    let copies = prop::collection::vec(any::<(prop::sample::Index, u64)>(), 0..6);
    (prop::collection::vec(cluster(attributes), 1..6), copies).prop_map(|(mut clusters, copies)| {
        for (index, seed) in copies {
            let mut copy = index.get(&clusters).clone();
            copy.triangles.reverse();
            for vertex in (0..copy.positions.len()).filter(|vertex| seed >> (vertex % 64) & 1 == 1)
            {
                copy.positions[vertex] = copy.positions[0];
                if let (Some(first), Some(own)) =
                    (copy.uvs.first().copied(), copy.uvs.get_mut(vertex))
                {
                    *own = first;
                }
            }
            clusters.push(copy);
        }
        clusters
    })
}

/// Any cluster that passes `Cluster::check` with `attributes`.
pub fn cluster(attributes: Attributes) -> impl Strategy<Value = Cluster> {
    (
        1usize..=256,
        1usize..=128,
        0u32..=22,
        0u32..=20,
        any::<u64>(),
    )
        .prop_map(move |(vertices, triangles, position_bits, uv_bits, seed)| {
            let mut state = seed | 1;
            let mut random = move |below: u32| {
                state = state
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                ((state >> 33) as u32) % below.max(1)
            };
            let origin: [i32; 3] = std::array::from_fn(|_| random(1 << 22) as i32 - (1 << 21));
            let when = |flag| if attributes.has(flag) { vertices } else { 0 };
            let mut left = triangles as u16;
            let mut materials = Vec::new();
            while left > 0 {
                let run = (random(left as u32) + 1) as u16;
                let slots = if seed % 3 == 0 { 65_535 } else { 64 };
                materials.push(MaterialRange {
                    slot: random(slots) as u16,
                    triangle_count: run,
                });
                left -= run;
            }
            Cluster {
                positions: (0..vertices)
                    .map(|_| {
                        std::array::from_fn(|axis| origin[axis] + random(1 << position_bits) as i32)
                    })
                    .collect(),
                normals: (0..when(Attributes::NORMAL))
                    .map(|_| [random(1024) as u16, random(1024) as u16])
                    .collect(),
                uvs: (0..when(Attributes::UV))
                    .map(|_| [random(1 << uv_bits) as i32 - 7_000_000, random(3) as i32])
                    .collect(),
                colors: (0..when(Attributes::COLOR))
                    .map(|_| [random(256) as u8, 7, 200 + random(50) as u8, 255])
                    .collect(),
                triangles: (0..triangles)
                    .map(|_| std::array::from_fn(|_| random(vertices as u32) as u8))
                    .collect(),
                materials,
                level: random(64) as u8,
                group: random(1000),
                child_group: if random(2) == 0 {
                    NO_GROUP
                } else {
                    random(1000)
                },
            }
        })
}

/// Any combination of attributes.
pub fn attributes() -> impl Strategy<Value = Attributes> {
    (0u32..8).prop_map(Attributes)
}

//! Pages: round trips from bytes alone, golden bytes, truncation, mutation, rejection.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod common;

use lodestream_format::cluster::{Attributes, MaterialRange};
use lodestream_format::disk_form::{self, DiskForm};
use lodestream_format::frame::{self, Codec};
use lodestream_format::memory_form::{self, ClusterView};
use lodestream_format::{Cluster, ContentHash};
use proptest::prelude::*;

const ALL: Attributes = Attributes(Attributes::ALL);

fn read_back(words: &[u32], clusters: usize) -> Vec<Cluster> {
    (0..clusters as u32)
        .map(|index| {
            let view = ClusterView::new(words, index).unwrap();
            let vertices = 0..view.header.vertex_count();
            let mut cluster = Cluster {
                positions: vertices.clone().map(|v| view.position_q(v)).collect(),
                normals: vertices.clone().filter_map(|v| view.normal(v)).collect(),
                uvs: vertices.clone().filter_map(|v| view.uv(v)).collect(),
                colors: vertices.filter_map(|v| view.color(v)).collect(),
                triangles: (0..view.header.triangle_count())
                    .map(|t| view.triangle(t).map(|index| index as u8))
                    .collect(),
                level: view.header.level() as u8,
                group: view.header.group(),
                child_group: view.header.child_group(),
                ..Cluster::default()
            };
            cluster.materials = slots_to_ranges(
                (0..view.header.triangle_count()).map(|t| view.material_slot(t) as u16),
            );
            cluster
        })
        .collect()
}

fn slots_to_ranges(
    slots: impl Iterator<Item = u16>,
) -> Vec<lodestream_format::cluster::MaterialRange> {
    let mut ranges: Vec<lodestream_format::cluster::MaterialRange> = Vec::new();
    for slot in slots {
        match ranges.last_mut() {
            Some(last) if last.slot == slot => last.triangle_count += 1,
            _ => ranges.push(lodestream_format::cluster::MaterialRange {
                slot,
                triangle_count: 1,
            }),
        }
    }
    ranges
}

/// Neighbouring ranges of one slot say the same as one range.
fn canonical(mut cluster: Cluster) -> Cluster {
    cluster.materials = slots_to_ranges(
        cluster
            .materials
            .iter()
            .flat_map(|range| std::iter::repeat_n(range.slot, range.triangle_count as usize))
            .collect::<Vec<_>>()
            .into_iter(),
    );
    cluster
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn both_forms_give_the_clusters_back(
        (attributes, clusters) in common::attributes()
            .prop_flat_map(|attributes| (Just(attributes), common::page(attributes)))
    ) {
        let ordered: Vec<_> = clusters.iter().map(disk_form::canonical).collect();
        let memory = memory_form::encode(&ordered, attributes, 9).unwrap();
        let canonical: Vec<_> = ordered.iter().cloned().map(canonical).collect();
        prop_assert_eq!(&read_back(&memory, clusters.len()), &canonical);
        let sizes: usize = ordered.iter().map(|cluster| memory_form::cluster_words(cluster, attributes)).sum();
        prop_assert_eq!(memory.len(), memory_form::PAGE_HEADER_WORDS + sizes);

        let disk = disk_form::encode(&clusters, attributes, 9).unwrap();
        for codec in [Codec::None, Codec::Zstd, Codec::Lz4] {
            let packed = frame::encode(&disk, codec).unwrap();
            let form = DiskForm::parse(frame::decode(&packed).unwrap()).unwrap();
            prop_assert_eq!(form.page(), 9);
            prop_assert_eq!(form.memory_words(), memory.len());
            let decoded: Vec<_> = form.clusters().into_iter().map(self::canonical).collect();
            prop_assert_eq!(&decoded, &canonical);
        }
    }
}

/// Version 3 of the disk form and version 1 of the memory form, pinned: changing a byte of the layout needs a new magic.
#[test]
fn golden_bytes() {
    let clusters = common::fixed();
    let disk = disk_form::encode(&clusters, ALL, 2).unwrap();
    let memory = memory_form::encode(&clusters, ALL, 2).unwrap();
    assert!(disk[disk_form::header_word::SHARED_VERTICES] > 0);
    let hash = |words: &[u32]| ContentHash::of(bytemuck::cast_slice(words)).to_string();
    assert_eq!(
        (disk.len(), hash(&disk)),
        (GOLDEN_DISK.0, GOLDEN_DISK.1.to_owned())
    );
    assert_eq!(
        (memory.len(), hash(&memory)),
        (GOLDEN_MEMORY.0, GOLDEN_MEMORY.1.to_owned())
    );
    // The frame with codec none is the header and the words themselves; compressed bytes depend on the library's version.
    let plain = frame::encode(&disk, Codec::None).unwrap();
    assert_eq!(plain[..8], [0, 0, 0, 0, disk.len() as u8, 0, 0, 0]);
    assert_eq!(&plain[8..], bytemuck::cast_slice::<u32, u8>(&disk));
}

const GOLDEN_DISK: (usize, &str) = (
    136,
    "d6470001a428ce76f8302fc703099ca892933e2dbc5effe1d53254b5e0e61bd0",
);
const GOLDEN_MEMORY: (usize, &str) = (
    104,
    "fe4472397a1c291084ce970ddfab607af533383283ce29adaeebc496511d3fcb",
);

/// A vertex is stored once in a page, but at a cluster's beginning; what refers to no earlier cluster is refused.
#[test]
fn a_border_is_stored_once() {
    let sheet = |from: i32| Cluster {
        positions: (0..81)
            .map(|v: i32| [from + v % 9, v / 9, v * v % 7])
            .collect(),
        triangles: (0..64u8)
            .flat_map(|square| {
                let a = square / 8 * 9 + square % 8;
                [[a, a + 1, a + 10], [a, a + 10, a + 9]]
            })
            .collect(),
        materials: vec![MaterialRange {
            slot: 0,
            triangle_count: 128,
        }],
        ..Cluster::default()
    };
    let mut right = sheet(8);
    for row in 0..9 {
        right.positions[row * 9] = sheet(0).positions[row * 9 + 8];
    }
    let clusters = [sheet(0), right];
    let disk = disk_form::encode(&clusters, Attributes(0), 0).unwrap();
    let shared = disk[disk_form::header_word::SHARED_VERTICES];
    assert!((6..=9).contains(&shared), "{shared} of nine");
    let form = DiskForm::parse(disk.clone()).unwrap();
    let ordered: Vec<Cluster> = clusters.iter().map(disk_form::canonical).collect();
    assert_eq!(form.clusters(), ordered);
    // The first reference lies after 256 control bytes and the extra bytes: make it lead to the last vertex of all.
    let words = |bytes: usize| bytes.div_ceil(4);
    let extra = disk[disk_form::header_word::EXTRA_BYTES] as usize;
    let columns = disk_form::HEADER_WORDS + 13 * 4 * words(2);
    let first = columns + words(256) + words(extra);
    let mut beyond = disk;
    let number = 2 * 161u32;
    beyond[first] = beyond[first] & !0xff | number & 0xff;
    beyond[first + words(shared as usize)] |= number >> 8;
    let error = DiskForm::parse(beyond).unwrap_err().to_string();
    assert!(error.contains("before the cluster"), "{error}");
}

#[test]
fn every_truncation_and_extension_is_rejected() {
    let disk = disk_form::encode(&common::fixed(), ALL, 2).unwrap();
    for length in 0..disk.len() {
        assert!(
            DiskForm::parse(disk[..length].to_vec()).is_err(),
            "{length} words"
        );
    }
    let mut longer = disk;
    longer.push(0);
    assert!(DiskForm::parse(longer).is_err());
}

/// Whatever the words say, parsing ends with an error or with a form that unpacks, packs again, and passes every check.
#[test]
fn mutations_are_rejected_or_consistent() {
    let disk = disk_form::encode(&common::fixed(), ALL, 2).unwrap();
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut accepted = 0;
    for case in 0..200_000u32 {
        let mut words = disk.clone();
        for _ in 0..1 + case % 3 {
            let at = random() as usize % words.len();
            words[at] = match random() % 4 {
                0 => words[at] ^ 1 << (random() % 32),
                1 => words[at].wrapping_add(random() as u32 % 5).wrapping_sub(2),
                2 => random() as u32,
                _ => [0, u32::MAX, 1 << 31, 128, 256][random() as usize % 5],
            };
        }
        if let Ok(form) = DiskForm::parse(words) {
            accepted += 1;
            let clusters = form.clusters();
            memory_form::encode(&clusters, form.attributes(), form.page()).unwrap();
        }
    }
    assert!(
        accepted > 0,
        "no mutation was harmless: the check would reject everything"
    );
}

#[test]
fn encoders_name_what_does_not_fit() {
    let good = &common::fixed()[0];
    let broken: [(&str, fn(&mut Cluster)); 6] = [
        ("triangles", |cluster| cluster.triangles.clear()),
        ("index", |cluster| cluster.triangles[0] = [0, 1, 6]),
        ("normals", |cluster| _ = cluster.normals.pop()),
        ("material", |cluster| {
            cluster.materials[0].triangle_count = 9
        }),
        ("position", |cluster| cluster.positions[0][1] = 1 << 24),
        ("level", |cluster| cluster.level = 64),
    ];
    for (word, damage) in broken {
        let mut cluster = good.clone();
        damage(&mut cluster);
        let error = disk_form::encode(&[cluster], ALL, 0)
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
    assert!(disk_form::encode(&[], ALL, 0).is_err());
}

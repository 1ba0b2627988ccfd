//! Pages: round trips from bytes alone, golden bytes, truncation, mutation, rejection.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod common;

use lodestream_format::cluster::{Attributes, MaterialRange};
use lodestream_format::cluster_view;
use lodestream_format::disk_form::{self, DiskForm, Parent};
use lodestream_format::frame::{self, Codec};
use lodestream_format::memory_form;
use lodestream_format::{Cluster, ContentHash};
use proptest::prelude::*;

const ALL: Attributes = Attributes(Attributes::ALL);

fn read_back(words: &[u32]) -> Vec<Cluster> {
    cluster_view::clusters(words).collect()
}

/// Memory form of a page without parents.
fn restored(form: &DiskForm) -> Vec<u32> {
    disk_form::memory_form(form, |_| None).unwrap()
}

/// Neighbouring ranges of one slot say the same as one range.
fn canonical(mut cluster: Cluster) -> Cluster {
    let ranges = std::mem::take(&mut cluster.materials);
    for range in ranges {
        match cluster.materials.last_mut() {
            Some(last) if last.slot == range.slot => last.triangle_count += range.triangle_count,
            _ => cluster.materials.push(range),
        }
    }
    cluster
}

/// Clusters whose group is 7, and a page before them that has some of their vertices, in clusters simplified from group 7.
fn with_parents(
    attributes: Attributes,
) -> impl Strategy<Value = (Attributes, Vec<Cluster>, Vec<Cluster>)> {
    (common::page(attributes), any::<u64>()).prop_map(move |(mut clusters, seed)| {
        clusters.iter_mut().for_each(|cluster| cluster.group = 7);
        let mut parents = Vec::new();
        for (index, cluster) in clusters.iter().enumerate() {
            let mut parent = cluster.clone();
            parent.triangles.reverse();
            parent.child_group = if seed >> index & 3 == 3 { 8 } else { 7 };
            parent.positions[0] = [index as i32, 5, -9];
            parents.push(disk_form::canonical(&parent));
        }
        (attributes, clusters, parents)
    })
}

fn parents_of(page: u32, clusters: &[Cluster]) -> Vec<Parent<'_>> {
    let numbered = (0..).zip(clusters);
    let parents = numbered.map(|(index, cluster)| Parent {
        page,
        index,
        cluster,
    });
    parents.collect()
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
        prop_assert_eq!(&read_back(&memory), &canonical);
        let sizes: usize = ordered.iter().map(|cluster| memory_form::cluster_words(cluster, attributes)).sum();
        prop_assert_eq!(memory.len(), memory_form::PAGE_HEADER_WORDS + sizes);

        let disk = disk_form::encode(&clusters, attributes, 9, &[]).unwrap();
        for codec in [Codec::None, Codec::Zstd, Codec::Lz4] {
            let packed = frame::encode(&disk, codec).unwrap();
            let form = DiskForm::parse(frame::decode(&packed).unwrap()).unwrap();
            prop_assert_eq!(form.page(), 9);
            prop_assert_eq!(form.memory_words(), memory.len());
            prop_assert_eq!(&restored(&form), &memory);
        }
    }

    #[test]
    fn a_page_comes_back_from_its_parents(
        (attributes, clusters, parents) in common::attributes().prop_flat_map(with_parents)
    ) {
        let parent_page = memory_form::encode(&parents, attributes, 3).unwrap();
        let ordered: Vec<_> = clusters.iter().map(disk_form::canonical).collect();
        let memory = memory_form::encode(&ordered, attributes, 9).unwrap();
        let disk = disk_form::encode(&clusters, attributes, 9, &parents_of(3, &parents)).unwrap();
        let form = DiskForm::parse(disk).unwrap();
        let resident = |page| (page == 3).then_some(&parent_page[..]);
        prop_assert_eq!(disk_form::memory_form(&form, resident).unwrap(), memory);
        for page in form.parent_pages() {
            prop_assert_eq!(page, 3);
            let error = disk_form::memory_form(&form, |_| None).unwrap_err().to_string();
            prop_assert!(error.contains("of page 3"), "{}", error);
        }
    }
}

/// Version 5 of the disk form and version 2 of the memory form, pinned: changing a byte of the layout needs a new magic.
#[test]
fn golden_bytes() {
    let clusters = common::fixed();
    let disk = fixed_page();
    let memory = memory_form::encode(&clusters, ALL, 2).unwrap();
    assert!(disk[disk_form::header_word::REPEATED] > 0);
    assert!(disk[disk_form::header_word::INHERITED] > 0);
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

/// The fixed clusters as page 2, below a page 1 that has vertices of the second.
fn fixed_page() -> Vec<u32> {
    let parents = fixed_parents();
    disk_form::encode(&common::fixed(), ALL, 2, &parents_of(1, &parents)).unwrap()
}

fn fixed_parents() -> Vec<Cluster> {
    let mut parent = common::fixed()[1].clone();
    parent.positions[2] = [0; 3];
    parent.child_group = 4;
    vec![disk_form::canonical(&parent)]
}

const GOLDEN_DISK: (usize, &str) = (
    133,
    "104d537dca021d8f2338486527400047efaf757cea6fb69d4fc7eca67dc2de18",
);
const GOLDEN_MEMORY: (usize, &str) = (
    107,
    "0a83d25c4724c2262901d3cce7ac17d0d5cf13be3b8a4bd9c7e76b42cc4e36e0",
);

/// A border of two clusters is stored once; what names no vertex of an earlier round is refused.
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
    let disk = disk_form::encode(&clusters, Attributes(0), 0, &[]).unwrap();
    let count = |word: usize| disk[word] as usize;
    assert_eq!(count(disk_form::header_word::REPEATED), 9);
    let form = DiskForm::parse(disk.clone()).unwrap();
    let ordered: Vec<Cluster> = clusters.iter().map(disk_form::canonical).collect();
    assert_eq!(read_back(&restored(&form)), ordered);
    // The first cluster that is named: make it the one that names it.
    let words = |bytes: usize| bytes.div_ceil(4);
    let first = disk_form::HEADER_WORDS
        + 13 * 4 * words(2)
        + words(count(disk_form::header_word::STEP_BYTES))
        + words(count(disk_form::header_word::EXTRA_BYTES))
        + words(2 * 81usize.div_ceil(5) + 1);
    let mut own = disk;
    own[first] &= !0xff;
    let error = DiskForm::parse(own).unwrap_err().to_string();
    assert!(error.contains("earlier round"), "{error}");
}

/// As many triangles, vertices and bits as there can be.
#[test]
fn the_largest_cluster_comes_back() {
    let spread = |vertex: i32, by: i32| (vertex * by) % 256 * ((1 << 24) / 256 + 1) % (1 << 24);
    let vertices = 0..256i32;
    let mut cluster = Cluster {
        positions: vertices
            .clone()
            .map(|v| [spread(v, 1), spread(v, 3), spread(v, 5)].map(|x| x - (1 << 23)))
            .collect(),
        normals: vertices
            .clone()
            .map(|v| [v as u16 * 4, 1023 - v as u16])
            .collect(),
        uvs: vertices
            .clone()
            .map(|v| [spread(v, 7), spread(v, 9)])
            .collect(),
        colors: vertices
            .map(|v| [v as u8, 255 - v as u8, v as u8 ^ 85, v as u8 ^ 170])
            .collect(),
        triangles: (0..128u8)
            .map(|t| [2 * t, 2 * t + 1, t.wrapping_mul(37)])
            .collect(),
        materials: vec![MaterialRange {
            slot: 0,
            triangle_count: 128,
        }],
        ..Cluster::default()
    };
    // Both ends, so that every coordinate needs its 24 bits.
    cluster.positions[0] = [-(1 << 23); 3];
    cluster.positions[255] = [(1 << 23) - 1; 3];
    (cluster.uvs[0], cluster.uvs[255]) = ([0; 2], [(1 << 24) - 1; 2]);
    let disk = disk_form::encode(std::slice::from_ref(&cluster), ALL, 0, &[]).unwrap();
    let form = DiskForm::parse(disk).unwrap();
    assert_eq!(form.headers()[0].vertex_bits(ALL), 5 * 24 + 20 + 32);
    let expected = memory_form::encode(&[disk_form::canonical(&cluster)], ALL, 0).unwrap();
    assert_eq!(restored(&form), expected);
}

#[test]
fn every_truncation_and_extension_is_rejected() {
    let disk = fixed_page();
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

/// Whatever the words say, parsing ends with an error or with a form that becomes a page which unpacks, whatever its parents hold.
#[test]
fn a_million_mutations_are_rejected_or_consistent() {
    let disk = fixed_page();
    let parents = memory_form::encode(&fixed_parents(), ALL, 1).unwrap();
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut accepted = 0;
    for case in 0..1_000_000u32 {
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
            // A parent that is not there is the only reason left.
            if let Ok(memory) = disk_form::memory_form(&form, |_| Some(&parents)) {
                assert_eq!(memory.len(), form.memory_words());
                assert_eq!(read_back(&memory).len(), form.headers().len());
            }
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
        let error = disk_form::encode(&[cluster], ALL, 0, &[])
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
    assert!(disk_form::encode(&[], ALL, 0, &[]).is_err());
}

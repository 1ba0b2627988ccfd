//! The twin of `transcode` gives the memory form bit for bit.

use lodestream_format::cluster::{Attributes, Cluster, MaterialRange, NO_GROUP};
use lodestream_format::disk_form::{self, DiskForm};
use lodestream_format::memory_form;
use lodestream_shaders::cpu::transcode::transcode;
use proptest::prelude::*;

/// Values that need up to `bits` bits above a base.
fn spread(bits: u32, base: i32, count: usize) -> impl Strategy<Value = Vec<i32>> {
    let most = ((1u64 << bits) - 1) as i32;
    prop::collection::vec((0..=most).prop_map(move |offset| base + offset), count)
}

fn vectors<const N: usize>(columns: Vec<Vec<i32>>) -> Vec<[i32; N]> {
    (0..columns[0].len())
        .map(|row| std::array::from_fn(|column| columns[column][row]))
        .collect()
}

/// Positions of 0..=23 bits an axis near the centre, or the whole 24 bits.
fn axis(count: usize) -> impl Strategy<Value = Vec<i32>> {
    prop_oneof![
        (0u32..=23, -(1 << 23)..=0i32).prop_flat_map(move |(bits, base)| spread(bits, base, count)),
        spread(24, -(1 << 23), count),
    ]
}

fn texture_axis(count: usize) -> impl Strategy<Value = Vec<i32>> {
    (0u32..=24, -2_000_000_000..=2_000_000_000i32)
        .prop_flat_map(move |(bits, base)| spread(bits, base, count))
}

/// Runs that make up all triangles: inline, or in a table where there are many or a slot is large.
fn materials(triangles: usize) -> impl Strategy<Value = Vec<MaterialRange>> {
    let slot = prop_oneof![0u16..64, any::<u16>()];
    prop::collection::vec((1..=triangles.div_ceil(2), slot), 1..6).prop_map(move |runs| {
        let mut left = triangles;
        let mut ranges = Vec::new();
        for (run, slot) in runs {
            let run = run.min(left);
            if run > 0 {
                ranges.push(MaterialRange {
                    slot,
                    triangle_count: run as u16,
                });
                left -= run;
            }
        }
        if let Some(last) = ranges.last_mut() {
            last.triangle_count += left as u16;
        }
        ranges
    })
}

fn cluster(attributes: Attributes) -> impl Strategy<Value = Cluster> {
    let counts = prop_oneof![
        (1usize..=128, 1usize..=256),
        (1usize..=3, 1usize..=3),
        (Just(128), Just(256)),
    ];
    counts.prop_flat_map(move |(triangles, vertices)| {
        let when = move |flag| if attributes.has(flag) { vertices } else { 0 };
        let geometry = (
            prop::collection::vec(axis(vertices), 3),
            prop::collection::vec(prop::array::uniform2(0u16..1024), when(Attributes::NORMAL)),
            prop::collection::vec(texture_axis(when(Attributes::UV).max(1)), 2),
            (
                0u8..=255,
                prop::collection::vec(prop::array::uniform4(any::<u8>()), when(Attributes::COLOR)),
            ),
        );
        let topology = (
            prop::collection::vec(prop::array::uniform3(0..vertices), triangles),
            materials(triangles),
            (
                0u8..64,
                any::<u32>(),
                prop_oneof![Just(NO_GROUP), any::<u32>()],
            ),
        );
        (geometry, topology).prop_map(
            move |(
                (positions, normals, uvs, (mask, colors)),
                (triangles, materials, (level, group, child_group)),
            )| Cluster {
                positions: vectors(positions),
                normals,
                uvs: if attributes.has(Attributes::UV) {
                    vectors(uvs)
                } else {
                    vec![]
                },
                // The mask narrows the channels' widths.
                colors: colors
                    .into_iter()
                    .map(|color| color.map(|channel| channel & mask))
                    .collect(),
                triangles: triangles
                    .into_iter()
                    .map(|triangle| triangle.map(|index| index as u8))
                    .collect(),
                materials,
                level,
                group,
                child_group,
            },
        )
    })
}

fn page() -> impl Strategy<Value = (Attributes, Vec<Cluster>, u32)> {
    (0..=Attributes::ALL)
        .prop_map(Attributes)
        .prop_flat_map(|attributes| {
            (
                Just(attributes),
                prop::collection::vec(cluster(attributes), 1..8),
                any::<u32>(),
            )
        })
}

/// What differs, or false for a page that the format refuses (too many words).
fn check(attributes: Attributes, clusters: &[Cluster], page: u32) -> Result<bool, String> {
    // The disk form has its own order; what does not pass the checks has none.
    if clusters
        .iter()
        .any(|cluster| cluster.check(attributes).is_err())
    {
        return Ok(false);
    }
    let ordered: Vec<Cluster> = clusters.iter().map(disk_form::canonical).collect();
    let Ok(expected) = memory_form::encode(&ordered, attributes, page) else {
        return Ok(false);
    };
    let disk =
        disk_form::encode(clusters, attributes, page, &[]).map_err(|error| error.to_string())?;
    let form = DiskForm::parse(disk).map_err(|error| error.to_string())?;
    let words = transcode(&form, |_| None).map_err(|error| error.to_string())?;
    if words.len() != expected.len() {
        return Err(format!("{} words, not {}", words.len(), expected.len()));
    }
    match words.iter().zip(&expected).position(|(a, b)| a != b) {
        Some(word) => Err(format!(
            "word {word}: {:#x}, not {:#x}",
            words[word], expected[word]
        )),
        None => Ok(true),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn twin_gives_the_memory_form((attributes, clusters, page) in page()) {
        let encoded = check(attributes, &clusters, page).map_err(TestCaseError::fail)?;
        prop_assume!(encoded);
    }
}

/// Widths of 0 to 24 bits on every axis at once, so that no width is left to chance.
#[test]
fn every_width_of_a_coordinate() {
    for bits in 0..=24u32 {
        let most = ((1u64 << bits) - 1) as i32;
        let middle = most / 2;
        let position = |share: i32| {
            [
                share - (1 << 23),
                (most - share) - (1 << 23),
                share / 2 * 2 - (1 << 23),
            ]
        };
        let cluster = Cluster {
            positions: vec![position(0), position(middle), position(most)],
            normals: vec![[0, 1023], [1023, 0], [511, 512]],
            uvs: vec![[-7, most], [most - 7, 0], [middle - 7, middle]],
            colors: vec![[0, 255, 7, 9]; 3],
            triangles: vec![[0, 1, 2], [2, 1, 0]],
            materials: vec![MaterialRange {
                slot: 3,
                triangle_count: 2,
            }],
            level: 5,
            group: 9,
            child_group: 11,
        };
        let clusters = [cluster.clone(), cluster];
        assert_eq!(
            check(Attributes(Attributes::ALL), &clusters, 1),
            Ok(true),
            "{bits} bits"
        );
    }
}

/// A single vertex on a single place: no index bits, no position bits, no payload at all.
#[test]
fn a_cluster_without_payload() {
    let cluster = Cluster {
        positions: vec![[4, -5, 6]],
        triangles: vec![[0, 0, 0]],
        materials: vec![MaterialRange {
            slot: 0,
            triangle_count: 1,
        }],
        child_group: NO_GROUP,
        ..Cluster::default()
    };
    assert_eq!(check(Attributes(0), &[cluster], 0), Ok(true));
}

//! Assets, hierarchies and scenes: round trips, golden bytes, mutation.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

use lodestream_format::asset::PageEntry;
use lodestream_format::bounds::{Aabb, Sphere};
use lodestream_format::cluster::Attributes;
use lodestream_format::grid::Grid;
use lodestream_format::hierarchy::{Child, Group, LEAF_FLAG, Node, Part, ROOT_ERROR};
use lodestream_format::instances::InstanceSteps;
use lodestream_format::proxy::{Proxy, ProxySide, SlotShare};
use lodestream_format::scene::{
    AlphaMode, Instance, Material, MediaType, SceneAsset, Texture, TextureUse, Wrap,
};
use lodestream_format::{Asset, ContentHash, Hierarchy, Scene};

fn asset() -> Asset {
    let page = |offset, bytes, dependencies| PageEntry {
        offset,
        bytes,
        memory_words: 1000,
        hash: ContentHash::of(&[bytes as u8]),
        dependencies,
    };
    Asset {
        attributes: Attributes(Attributes::NORMAL),
        position_grid: Grid { step_exponent: -10 },
        uv_grid: Grid { step_exponent: -13 },
        center_q: [10_000_000_000, -3, 0],
        aabb: Aabb {
            min: [-1.0; 3],
            max: [1.0; 3],
        },
        material_slots: 2,
        source_triangles: 300,
        dag_triangles: 600,
        clusters: 6,
        levels: 3,
        pack: ContentHash::of(b"pack"),
        hierarchy: ContentHash::of(b"hierarchy"),
        proxy: Proxy {
            areas_m2: [1.0, 2.5, 0.0],
            boxiness: 0.25,
            sides: std::array::from_fn(|side| ProxySide {
                normal: [side as u16, 1023],
                color: [255, 0, side as u8],
                shares: (0..2)
                    .map(|slot| SlotShare { slot, share: 100 })
                    .take(side)
                    .collect(),
            }),
        },
        root_page_count: 1,
        pages: vec![
            page(0, 100, vec![]),
            page(100, 50, vec![0]),
            page(150, 60, vec![0, 1]),
        ],
    }
}

fn hierarchy() -> Hierarchy {
    let sphere = Sphere {
        center: [0.0; 3],
        radius: 2.0,
    };
    let child = |error, reference| Child {
        lod_center: sphere.center,
        lod_radius: sphere.radius,
        aabb_min: [-1.0; 3],
        max_parent_error_metres: error,
        aabb_max: [1.0; 3],
        reference,
    };
    let group = |parent_error_metres, first_part, part_count, first_page| Group {
        lod_center: sphere.center,
        lod_radius: sphere.radius,
        parent_error_metres,
        first_part,
        part_count,
        first_page,
        level: 0,
        cluster_count: 2 * part_count,
        triangle_count: 200,
        spare: 0,
    };
    let mut nodes = vec![
        Node {
            children: [Child::EMPTY; 8]
        };
        2
    ];
    nodes[0].children[0] = child(ROOT_ERROR, LEAF_FLAG);
    nodes[0].children[1] = child(0.25, 1);
    nodes[1].children[0] = child(0.25, LEAF_FLAG | 1);
    let part = Part {
        first_cluster: 0,
        cluster_count: 2,
    };
    Hierarchy {
        nodes,
        groups: vec![group(ROOT_ERROR, 0, 1, 0), group(0.25, 1, 2, 1)],
        parts: vec![part; 3],
        depth: 2,
    }
}

fn scene() -> Scene {
    let used = TextureUse {
        texture: 0,
        wrap: [Wrap::Clamp, Wrap::Mirror],
        nearest: true,
        uv_transform: TextureUse::IDENTITY,
    };
    Scene {
        assets: vec![SceneAsset {
            name: "rock".into(),
            asset: ContentHash::of(b"asset"),
            materials: vec![0],
            steps: InstanceSteps::default(),
        }],
        instances: vec![Instance {
            asset: 0,
            world_from_object: [
                [1.0, 0.0, 0.0, 1e7],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
            ],
        }],
        materials: vec![Material {
            name: "stone".into(),
            base_color_factor: [0.5, 0.5, 0.5, 1.0],
            base_color: Some(used),
            emissive_factor: [0.0; 3],
            metallic: 0.0,
            roughness: 0.9,
            alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
            double_sided: false,
            unlit: false,
        }],
        textures: vec![Texture {
            object: ContentHash::of(b"png"),
            bytes: 3,
            media_type: MediaType::Png,
            width: 4,
            height: 2,
        }],
        source_triangles: 300,
        warnings: vec!["left out 1 LINES primitive".into()],
    }
}

#[test]
fn objects_round_trip() {
    assert_eq!(Asset::decode(&asset().encode().unwrap()).unwrap(), asset());
    assert_eq!(
        Hierarchy::decode(&hierarchy().encode(), 3).unwrap(),
        hierarchy()
    );
    assert_eq!(Scene::decode(&scene().encode().unwrap()).unwrap(), scene());
}

/// Version 1 of the hierarchy, pinned to the byte.
#[test]
fn golden_hierarchy() {
    let bytes = hierarchy().encode();
    assert_eq!(
        (bytes.len(), ContentHash::of(&bytes).to_string()),
        (GOLDEN_HIERARCHY.0, GOLDEN_HIERARCHY.1.to_owned())
    );
}

const GOLDEN_HIERARCHY: (usize, &str) = (
    920,
    "35c8b0bd64d32b7dba9d0c9c55fa34c184bab0f549bab4d53f54d18d302c262d",
);

#[test]
fn wrong_assets_are_rejected() {
    let damages: [(&str, fn(&mut Asset)); 6] = [
        ("offset", |asset| asset.pages[1].offset = 99),
        ("dependencies", |asset| {
            asset.pages[1].dependencies = vec![1]
        }),
        ("dependencies", |asset| {
            asset.pages[2].dependencies = vec![1, 0]
        }),
        ("root pages", |asset| asset.root_page_count = 4),
        ("bounds", |asset| asset.aabb.max[1] = f32::NAN),
        ("exponent", |asset| asset.position_grid.step_exponent = 101),
    ];
    for (word, damage) in damages {
        let mut asset = asset();
        damage(&mut asset);
        let error = Asset::decode(&asset.encode().unwrap())
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
}

#[test]
fn wrong_hierarchies_are_rejected() {
    let damages: [(&str, fn(&mut Hierarchy)); 8] = [
        ("bounds and error", |hierarchy| {
            hierarchy.nodes[0].children[1].max_parent_error_metres = 0.1
        }),
        ("not seen before", |hierarchy| {
            hierarchy.nodes[1].children[0].reference = 0
        }),
        ("each in one leaf", |hierarchy| {
            hierarchy.nodes[1].children[0] = Child::EMPTY
        }),
        ("pages", |hierarchy| hierarchy.groups[1].first_page = 2),
        ("clusters", |hierarchy| {
            hierarchy.groups[0].cluster_count = 3
        }),
        ("sphere", |hierarchy| {
            hierarchy.groups[0].lod_radius = f32::NAN
        }),
        ("parent error", |hierarchy| {
            hierarchy.groups[1].parent_error_metres = -1.0
        }),
        ("depth", |hierarchy| hierarchy.depth = 7),
    ];
    for (word, damage) in damages {
        let mut hierarchy = hierarchy();
        damage(&mut hierarchy);
        let error = Hierarchy::decode(&hierarchy.encode(), 3)
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
}

#[test]
fn no_mutation_or_truncation_panics() {
    let objects = [
        asset().encode().unwrap(),
        hierarchy().encode(),
        scene().encode().unwrap(),
    ];
    let mut state = 1u64;
    let mut random = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 33) as usize
    };
    for object in &objects {
        for length in 0..object.len() {
            let cut = &object[..length];
            assert!(
                Asset::decode(cut).is_err()
                    && Hierarchy::decode(cut, 3).is_err()
                    && Scene::decode(cut).is_err()
            );
        }
        for _ in 0..60_000 {
            let mut bytes = object.clone();
            for _ in 0..1 + random() % 3 {
                let at = random() % bytes.len();
                bytes[at] = random() as u8;
            }
            let _ = (
                Asset::decode(&bytes),
                Hierarchy::decode(&bytes, 3),
                Scene::decode(&bytes),
            );
        }
    }
}

/// The structs that the GPU reads have no padding and the sizes that FORMAT.md gives.
#[test]
fn sizes() {
    assert_eq!(
        (
            size_of::<Child>(),
            size_of::<Node>(),
            size_of::<Group>(),
            size_of::<Part>()
        ),
        (48, 384, 48, 8)
    );
}

/// Culling takes a round a level of nodes: a chain of them would keep a GPU busy for ever.
#[test]
fn a_chain_of_nodes_is_no_hierarchy() {
    let chain = |depth: usize| {
        let mut hierarchy = hierarchy();
        let leaves = hierarchy.nodes[0].children;
        let mut link = leaves[1];
        link.max_parent_error_metres = ROOT_ERROR;
        let last = hierarchy.nodes[1];
        hierarchy.nodes = (1..depth as u32)
            .map(|below| {
                let mut node = last;
                node.children[0] = Child {
                    reference: below,
                    ..link
                };
                node
            })
            .collect();
        let mut end = last;
        end.children[..2].copy_from_slice(&[leaves[0], last.children[0]]);
        hierarchy.nodes.push(end);
        hierarchy.depth = depth as u32;
        Hierarchy::decode(&hierarchy.encode(), 3)
    };
    assert_eq!(chain(64).map(|hierarchy| hierarchy.depth), Ok(64));
    let error = chain(65).unwrap_err().to_string();
    assert_eq!(error, "hierarchy depth: expected at most 64, found 65");
}

//! Libraries made from the format's own functions, with packs of any size, that need no build.

use bytes::Bytes;
use lodestream_format::asset::PageEntry;
use lodestream_format::grid::Grid;
use lodestream_format::instances::InstanceSteps;
use lodestream_format::scene::{Instance, SceneAsset};
use lodestream_format::{Aabb, Asset, ContentHash, Scene};
use lodestream_server::library::{BuildRecord, Library};

/// An asset in a library.
#[derive(Debug, Clone)]
pub struct Made {
    pub hash: ContentHash,
    pub asset: Asset,
    pub pack: Bytes,
    pub hierarchy: Bytes,
}

impl Made {
    /// The frame of a page.
    pub fn frame(&self, page: u32) -> &[u8] {
        let entry = &self.asset.pages[page as usize];
        &self.pack[entry.offset as usize..][..entry.bytes as usize]
    }
}

/// Bytes that look random, always the same for a seed.
pub fn noise(seed: u64, bytes: usize) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    (0..bytes)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u8
        })
        .collect()
}

/// Stores an asset of `pages` pages of about `page_bytes` (no two the same), whose frames are noise.
pub async fn asset(library: &Library, seed: u64, pages: u32, page_bytes: usize) -> Made {
    let mut entries = vec![];
    let mut pack = vec![];
    for page in 0..pages {
        let frame = noise(
            seed * 1_000_003 + page as u64,
            page_bytes + page as usize % 97,
        );
        entries.push(PageEntry {
            offset: pack.len() as u64,
            bytes: frame.len() as u32,
            memory_words: 100,
            hash: ContentHash::of(&frame),
            dependencies: if page == 0 { vec![] } else { vec![page - 1] },
        });
        pack.extend(frame);
    }
    let (pack, hierarchy) = (Bytes::from(pack), Bytes::from(noise(seed ^ 77, 5000)));
    let asset = Asset {
        attributes: Default::default(),
        position_grid: Grid { step_exponent: -10 },
        uv_grid: Grid { step_exponent: -13 },
        center_q: [0; 3],
        aabb: Aabb {
            min: [-1.0; 3],
            max: [1.0; 3],
        },
        material_slots: 1,
        source_triangles: 1000,
        dag_triangles: 2000,
        clusters: 16,
        levels: 3,
        pack: put(library, pack.clone()).await,
        hierarchy: put(library, hierarchy.clone()).await,
        proxy: Default::default(),
        root_page_count: 2.min(pages),
        pages: entries,
    };
    let hash = put(library, Bytes::from(asset.encode().expect("encodes"))).await;
    Made {
        hash,
        asset,
        pack,
        hierarchy,
    }
}

/// Publishes a scene over assets.
pub async fn scene(library: &Library, name: &str, assets: &[Made]) -> ContentHash {
    let scene = Scene {
        assets: assets
            .iter()
            .enumerate()
            .map(|(index, made)| SceneAsset {
                name: format!("asset {index}"),
                asset: made.hash,
                materials: vec![0],
                steps: InstanceSteps::default(),
            })
            .collect(),
        instances: (0..assets.len() as u32)
            .map(|asset| Instance {
                asset,
                world_from_object: [
                    [1.0, 0.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0, 0.0],
                    [0.0, 0.0, 1.0, 0.0],
                ],
            })
            .collect(),
        materials: vec![lodestream_format::scene::Material {
            name: "grey".to_owned(),
            base_color_factor: [0.5, 0.5, 0.5, 1.0],
            base_color: None,
            emissive_factor: [0.0; 3],
            metallic: 0.0,
            roughness: 1.0,
            alpha_mode: Default::default(),
            double_sided: false,
            unlit: false,
        }],
        ..Scene::default()
    };
    let hash = put(library, Bytes::from(scene.encode().expect("encodes"))).await;
    library.publish(name, hash).await.expect("publishes");
    hash
}

/// Stores an object.
pub async fn put(library: &Library, bytes: Bytes) -> ContentHash {
    library.put_object(bytes, 60).await.expect("stores").0
}

/// The record of a build that gave it.
pub fn record_of(made: &Made) -> BuildRecord<u32> {
    BuildRecord {
        asset: made.hash,
        hierarchy: made.asset.hierarchy,
        hierarchy_bytes: made.hierarchy.len() as u64,
        pack: made.asset.pack,
        pack_bytes: made.pack.len() as u64,
        report: 7,
    }
}

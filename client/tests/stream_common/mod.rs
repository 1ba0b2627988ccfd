//! Scenes made from a number: real objects, hierarchies and pages over random DAGs, small enough to check everything.
// Each test binary uses its own part of this module; failing loudly is what a test's unwrap is for.
#![allow(dead_code, clippy::unwrap_used)]

pub mod pool_model;
pub mod world;

use std::path::Path;

use bytes::Bytes;
use lodestream_client::stream::{
    OpenedAsset, OpenedScene, PixelErrorControl, ResidencyConfig, StreamingRequest, decode_page,
    split_frames,
};
use lodestream_format::asset::PageEntry;
use lodestream_format::cluster::{Attributes, MaterialRange, NO_GROUP};
use lodestream_format::disk_form;
use lodestream_format::frame::{self, Codec};
use lodestream_format::grid::Grid;
use lodestream_format::hierarchy::{Child, Group, LEAF_FLAG, Node, Part, ROOT_ERROR};
use lodestream_format::instances::InstanceSteps;
use lodestream_format::library::{SceneReference, object_path, scene_path};
use lodestream_format::limits::HIERARCHY_WIDTH;
use lodestream_format::scene::{Instance, SceneAsset};
use lodestream_format::{Aabb, Asset, Cluster, ContentHash, Hierarchy, Scene, Sphere, memory_form};

/// A splitmix64 sequence: small, and the same everywhere.
#[derive(Debug, Clone)]
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, end: u32) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 33) as u32 % end.max(1)
    }

    pub fn unit(&mut self) -> f32 {
        self.below(1 << 20) as f32 / (1 << 20) as f32
    }

    pub fn chance(&mut self, share: f32) -> bool {
        self.unit() < share
    }
}

/// An asset with what a reader cannot see: its DAG, its frames, its objects.
pub struct MadeAsset {
    pub opened: OpenedAsset,
    /// Coarser groups that hold clusters made from each group.
    pub parents: Vec<Vec<u32>>,
    /// Whether a group has members that hold source triangles.
    pub holds_source: Vec<bool>,
    pub frames: Vec<Bytes>,
    pub asset_bytes: Vec<u8>,
    pub hierarchy_bytes: Vec<u8>,
}

/// A scene of such assets.
pub struct MadeScene {
    pub opened: OpenedScene,
    pub assets: Vec<MadeAsset>,
}

/// How large to make it.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    pub assets: u32,
    /// Groups of the finest level.
    pub finest_groups: u32,
    pub levels: u32,
}

pub fn make_scene(seed: u64, size: Size) -> MadeScene {
    let mut random = Random(seed);
    let assets: Vec<MadeAsset> = (0..size.assets)
        .map(|_| make_asset(&mut random, size))
        .collect();
    MadeScene::over(assets)
}

struct Draft {
    level: u32,
    sphere: Sphere,
    parent_error_metres: f32,
    children: Vec<usize>,
    parents: Vec<usize>,
}

/// Groups fine to coarse: every group has coarser parents up to the roots, every coarse one has children.
fn draft(random: &mut Random, size: Size) -> Vec<Draft> {
    let mut groups: Vec<Draft> = Vec::new();
    let mut below: Vec<usize> = Vec::new();
    for level in 0..size.levels {
        let finest = size.finest_groups.max(1);
        let count = if level + 1 == size.levels {
            1 + random.below(2)
        } else {
            (finest >> level).max(2)
        };
        let first = groups.len();
        for _ in 0..count {
            let center = std::array::from_fn(|_| random.unit() * 20.0 - 10.0);
            groups.push(Draft {
                level,
                sphere: Sphere {
                    center,
                    radius: 0.5 + random.unit(),
                },
                parent_error_metres: 0.001 + 0.01 * random.unit(),
                children: vec![],
                parents: vec![],
            });
        }
        let own: Vec<usize> = (first..groups.len()).collect();
        for &child in &below {
            for _ in 0..1 + random.below(3) {
                let parent = own[random.below(own.len() as u32) as usize];
                if !groups[child].parents.contains(&parent) {
                    groups[child].parents.push(parent);
                    groups[parent].children.push(child);
                }
            }
        }
        for &parent in own.iter().filter(|_| level > 0) {
            if groups[parent].children.is_empty() {
                let child = below[random.below(below.len() as u32) as usize];
                groups[parent].children.push(child);
                groups[child].parents.push(parent);
            }
            let children = groups[parent].children.clone();
            let spheres: Vec<Sphere> = children.iter().map(|&child| groups[child].sphere).collect();
            groups[parent].sphere = Sphere::enclosing(&spheres);
            let errors = children
                .iter()
                .map(|&child| groups[child].parent_error_metres);
            // Some equal their child's: monotone is not strictly monotone.
            let growth = if random.chance(0.1) {
                1.0
            } else {
                1.0 + 2.0 * random.unit()
            };
            groups[parent].parent_error_metres = errors.fold(0.0, f32::max) * growth;
        }
        below = own;
    }
    for &root in &below {
        groups[root].parent_error_metres = ROOT_ERROR;
    }
    groups
}

fn make_cluster(random: &mut Random, level: u32, group: u32, child_group: u32) -> Cluster {
    let triangles = 1 + random.below(6) as usize;
    let positions = (0..triangles + 2)
        .map(|_| std::array::from_fn(|_| random.below(1000) as i32 - 500))
        .collect();
    Cluster {
        positions,
        triangles: (0..triangles as u8)
            .map(|first| [first, first + 1, first + 2])
            .collect(),
        materials: vec![MaterialRange {
            slot: 0,
            triangle_count: triangles as u16,
        }],
        level: level as u8,
        group,
        child_group,
        ..Cluster::default()
    }
}

fn make_asset(random: &mut Random, size: Size) -> MadeAsset {
    let drafts = draft(random, size);
    // Coarse to fine: the last draft is group 0.
    let number = |draft: usize| (drafts.len() - 1 - draft) as u32;
    let (mut groups, mut parts, mut parents) = (vec![], vec![], vec![]);
    let mut pages: Vec<Vec<Cluster>> = vec![vec![]];
    let mut page_limit = 1 + random.below(6) as usize;
    for (index, draft) in drafts.iter().enumerate().rev() {
        let group = number(index);
        let mut children: Vec<u32> = draft.children.iter().map(|&child| number(child)).collect();
        if children.is_empty() {
            children = vec![NO_GROUP; 1 + random.below(3) as usize];
        }
        let first_part = parts.len() as u32;
        let mut first_page = None;
        for &child in &children {
            if pages.last().unwrap().len() >= page_limit {
                pages.push(vec![]);
                page_limit = 1 + random.below(6) as usize;
            }
            let page = pages.len() as u32 - 1;
            let clusters = pages.last_mut().unwrap();
            if first_page.is_none_or(|first| first + (parts.len() as u32 - first_part) <= page) {
                parts.push(Part {
                    first_cluster: clusters.len() as u32,
                    cluster_count: 0,
                });
            }
            first_page.get_or_insert(page);
            parts.last_mut().unwrap().cluster_count += 1;
            clusters.push(make_cluster(random, draft.level, group, child));
        }
        groups.push(Group {
            lod_center: draft.sphere.center,
            lod_radius: draft.sphere.radius,
            parent_error_metres: draft.parent_error_metres,
            first_part,
            part_count: parts.len() as u32 - first_part,
            first_page: first_page.unwrap(),
            level: draft.level,
            cluster_count: children.len() as u32,
            triangle_count: 0,
            spare: 0,
        });
        parents.push(draft.parents.iter().map(|&parent| number(parent)).collect());
    }
    let mut nodes = Vec::new();
    let all: Vec<u32> = (0..groups.len() as u32).collect();
    let depth = make_node(&mut nodes, &groups, &all);
    let hierarchy = Hierarchy {
        nodes,
        groups,
        parts,
        depth,
    };
    finish(random, hierarchy, parents, pages)
}

fn aabb(sphere: Sphere) -> Aabb {
    Aabb {
        min: sphere.center.map(|center| center - sphere.radius),
        max: sphere.center.map(|center| center + sphere.radius),
    }
}

/// A node over `members`; gives the levels of nodes from it down.
fn make_node(nodes: &mut Vec<Node>, groups: &[Group], members: &[u32]) -> u32 {
    let own = nodes.len();
    nodes.push(Node {
        children: [Child::EMPTY; HIERARCHY_WIDTH],
    });
    let mut depth = 1;
    for (slot, chunk) in members
        .chunks(members.len().div_ceil(HIERARCHY_WIDTH))
        .enumerate()
    {
        let spheres: Vec<Sphere> = chunk
            .iter()
            .map(|&group| groups[group as usize].lod_sphere())
            .collect();
        let sphere = Sphere::enclosing(&spheres);
        let bounds = spheres
            .iter()
            .fold(Aabb::EMPTY, |bounds, &sphere| bounds.merge(&aabb(sphere)));
        let errors = chunk
            .iter()
            .map(|&group| groups[group as usize].parent_error_metres);
        let reference = if let &[group] = chunk {
            LEAF_FLAG | group
        } else {
            let below = nodes.len() as u32;
            depth = depth.max(1 + make_node(nodes, groups, chunk));
            below
        };
        nodes[own].children[slot] = Child {
            lod_center: sphere.center,
            lod_radius: sphere.radius,
            aabb_min: bounds.min,
            max_parent_error_metres: errors.fold(0.0, f32::max),
            aabb_max: bounds.max,
            reference,
        };
    }
    depth
}

fn finish(
    random: &mut Random,
    hierarchy: Hierarchy,
    parents: Vec<Vec<u32>>,
    pages: Vec<Vec<Cluster>>,
) -> MadeAsset {
    let attributes = Attributes::default();
    let mut frames = Vec::new();
    let mut entries: Vec<PageEntry> = Vec::new();
    let mut offset = 0;
    for (page, clusters) in (0u32..).zip(&pages) {
        let codec = [Codec::None, Codec::Zstd, Codec::Lz4][random.below(3) as usize];
        let words = disk_form::encode(clusters, attributes, page, &[]).unwrap();
        let frame = frame::encode(&words, codec).unwrap();
        let memory = memory_form::encode(clusters, attributes, page).unwrap();
        let groups = clusters.iter().map(|cluster| cluster.group as usize);
        let needed = groups.flat_map(|group| &parents[group]);
        let mut dependencies: Vec<u32> = needed
            .flat_map(|&parent| hierarchy.groups[parent as usize].pages())
            .filter(|&dependency| dependency < page)
            .collect();
        dependencies.sort_unstable();
        dependencies.dedup();
        entries.push(PageEntry {
            offset,
            bytes: frame.len() as u32,
            memory_words: memory.len() as u32,
            hash: ContentHash::of(&frame),
            dependencies,
        });
        offset += frame.len() as u64;
        frames.push(Bytes::from(frame));
    }
    let roots = hierarchy.groups.iter().filter(|group| group.is_root());
    let last_root = roots.map(|group| group.pages().end).max().unwrap();
    let spare = random.below(2).min(pages.len() as u32 - last_root);
    let hierarchy_bytes = hierarchy.encode();
    let clusters = hierarchy
        .groups
        .iter()
        .map(|group| group.cluster_count as u64);
    let asset = Asset {
        attributes,
        position_grid: Grid { step_exponent: -8 },
        uv_grid: Grid { step_exponent: -12 },
        center_q: [0; 3],
        aabb: Aabb {
            min: [-20.0; 3],
            max: [20.0; 3],
        },
        material_slots: 1,
        source_triangles: 1,
        dag_triangles: 1,
        clusters: clusters.sum(),
        levels: 1,
        pack: ContentHash::of(&frames.concat()),
        hierarchy: ContentHash::of(&hierarchy_bytes),
        proxy: Default::default(),
        root_page_count: last_root + spare,
        pages: entries,
    };
    let asset_bytes = asset.encode().unwrap();
    let pack = Bytes::from(frames.concat());
    made_of(asset, hierarchy, &pack, asset_bytes, hierarchy_bytes)
}

/// An asset from its objects; the DAG is read out of the pages.
pub fn made_of(
    asset: Asset,
    hierarchy: Hierarchy,
    pack: &Bytes,
    asset_bytes: Vec<u8>,
    hierarchy_bytes: Vec<u8>,
) -> MadeAsset {
    let hash = ContentHash::of(&asset_bytes);
    let frames = split_frames(&hash, &asset, 0, asset.pages.len() as u32 - 1, pack).unwrap();
    let mut parents = vec![vec![]; hierarchy.groups.len()];
    let mut holds_source = vec![false; hierarchy.groups.len()];
    for (page, frame) in (0..).zip(&frames) {
        let form = decode_page(&hash, &asset, &hierarchy, page, frame).unwrap();
        for header in form.headers() {
            match header.child_group() {
                NO_GROUP => holds_source[header.group() as usize] = true,
                child => parents[child as usize].push(header.group()),
            }
        }
    }
    let root_pages = (0..asset.root_page_count)
        .map(|page| decode_page(&hash, &asset, &hierarchy, page, &frames[page as usize]).unwrap())
        .collect();
    MadeAsset {
        opened: OpenedAsset {
            hash,
            asset,
            hierarchy,
            root_pages,
            page_base: 0,
        },
        parents,
        holds_source,
        frames,
        asset_bytes,
        hierarchy_bytes,
    }
}

impl MadeScene {
    /// The assets side by side, 30 metres apart.
    pub fn over(assets: Vec<MadeAsset>) -> Self {
        let placed = |asset: usize| Instance {
            asset: asset as u32,
            world_from_object: [
                [1.0, 0.0, 0.0, 30.0 * asset as f64],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
            ],
        };
        let used = |made: &MadeAsset| SceneAsset {
            name: "made".to_owned(),
            asset: made.opened.hash,
            materials: vec![],
            steps: InstanceSteps::default(),
        };
        let scene = Scene {
            assets: assets.iter().map(used).collect(),
            instances: (0..assets.len()).map(placed).collect(),
            ..Scene::default()
        };
        let opened = assets.iter().map(|made| made.opened.clone()).collect();
        let opened = OpenedScene::assemble(scene, opened, 0).unwrap();
        Self { opened, assets }
    }

    /// A scene-wide page, fetched and checked.
    pub fn decoded(&self, page: u32) -> lodestream_format::disk_form::DiskForm {
        let (index, local) = self.opened.locate(page).unwrap();
        let made = &self.assets[index];
        let opened = &made.opened;
        let frame = &made.frames[local as usize];
        decode_page(&opened.hash, &opened.asset, &opened.hierarchy, local, frame).unwrap()
    }

    /// Writes the scene into a library folder.
    pub fn write_library(&self, folder: &Path, name: &str) {
        let put = |bytes: &[u8]| {
            let hash = ContentHash::of(bytes);
            write(&folder.join(object_path(&hash)), bytes);
            hash
        };
        for made in &self.assets {
            put(&made.asset_bytes);
            put(&made.hierarchy_bytes);
            put(&made.frames.concat());
        }
        let reference = SceneReference {
            scene: put(&self.opened.scene.encode().unwrap()),
            published_secs: 1,
        };
        let json = serde_json::to_vec(&reference).unwrap();
        write(&folder.join(scene_path(name).unwrap()), &json);
    }

    /// What the GPU would ask for from `eye` (world metres), looking along +x if `half` is set and around otherwise.
    pub fn requests(
        &self,
        eye: [f32; 3],
        half: bool,
        pixel_error_px: f32,
    ) -> Vec<StreamingRequest> {
        let mut priorities = std::collections::BTreeMap::new();
        for (index, opened) in self.opened.assets.iter().enumerate() {
            for group in &opened.hierarchy.groups {
                let at = 30.0 * index as f32;
                let error_px = projected_px(group, eye, at);
                let seen = !half || group.lod_center[0] + at + group.lod_radius > eye[0];
                if seen && error_px > pixel_error_px {
                    for page in group.pages() {
                        let page = opened.page_base + page;
                        let (most, sum) = priorities.entry(page).or_insert((0.0f32, 0.0f32));
                        (*most, *sum) = (most.max(error_px), *sum + error_px);
                    }
                }
            }
        }
        priorities
            .into_iter()
            .map(|(page, (error_px, priority_px))| StreamingRequest {
                page,
                error_px,
                priority_px,
            })
            .collect()
    }
}

/// Monotone toward the root, as spheres nest and errors grow.
pub fn projected_px(group: &Group, eye: [f32; 3], asset_at: f32) -> f32 {
    let [x, y, z] = group.lod_center;
    let offset = [x + asset_at - eye[0], y - eye[1], z - eye[2]];
    let squared = offset.map(|value| (value * value) as f64);
    let distance = squared.iter().sum::<f64>().sqrt();
    let depth = (distance - group.lod_radius as f64).max(0.1);
    (group.parent_error_metres as f64 * 1000.0 / depth) as f32
}

fn write(path: &Path, bytes: &[u8]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// A configuration whose pool has just so many slots.
pub fn config(scene: &OpenedScene, slots: u32, control: PixelErrorControl) -> ResidencyConfig {
    let one = lodestream_client::stream::PoolLayout::new(scene, 1 << 30).unwrap();
    let pool_bytes = one.first_slot_word as u64 * 4 + slots as u64 * 128 * 1024;
    ResidencyConfig {
        control,
        ..ResidencyConfig::new(pool_bytes)
    }
}

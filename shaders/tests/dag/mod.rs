//! Random DAGs with everything that the culling passes read, made without the builder, and scenes of them.
#![allow(dead_code, reason = "each test file uses its part")]

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};
use lodestream_format::asset::PageEntry;
use lodestream_format::bounds::Sphere;
use lodestream_format::cluster::{Attributes, MaterialRange, NO_GROUP};
use lodestream_format::grid::Grid;
use lodestream_format::hierarchy::{Child, Group, LEAF_FLAG, NO_CHILD, Node, Part, ROOT_ERROR};
use lodestream_format::instances::InstanceSteps;
use lodestream_format::scene::{Instance, SceneAsset};
use lodestream_format::{Aabb, Asset, Cluster, ContentHash, Hierarchy, Scene, memory_form};
use lodestream_shaders::SceneArrays;
use lodestream_shaders::types::NOT_INSTALLED;

/// SplitMix64 (Steele et al., "Fast splittable pseudorandom number generators", 2014).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    /// In 0..1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn vector(&mut self, scale: f64) -> DVec3 {
        DVec3::new(
            self.range(-scale, scale),
            self.range(-scale, scale),
            self.range(-scale, scale),
        )
    }
}

/// An asset with its pages unpacked.
pub struct Dag {
    pub asset: Asset,
    pub hierarchy: Hierarchy,
    pub pages: Vec<Vec<Cluster>>,
}

struct RawGroup {
    level: u32,
    members: Vec<usize>,
    lod_sphere: Sphere,
    parent_error_metres: f32,
}

const GRID: Grid = Grid { step_exponent: -8 };

fn leaf(random: &mut Random) -> Cluster {
    let center: [i32; 3] = std::array::from_fn(|_| random.below(8192) as i32 - 4096);
    let positions = (0..3)
        .map(|_| center.map(|q| q + random.below(400) as i32 - 200))
        .collect();
    cluster(positions, 0, NO_GROUP)
}

fn cluster(positions: Vec<[i32; 3]>, level: u8, child_group: u32) -> Cluster {
    let triangles = vec![[0, 1, 2]; 1 + level as usize];
    Cluster {
        materials: vec![MaterialRange {
            slot: 0,
            triangle_count: triangles.len() as u16,
        }],
        positions,
        triangles,
        level,
        child_group,
        ..Cluster::default()
    }
}

/// Groups clusters level by level until only root groups are left. Errors often tie and spheres often coincide.
fn raw_dag(random: &mut Random) -> (Vec<Cluster>, Vec<RawGroup>) {
    let mut clusters: Vec<Cluster> = (0..1 + random.below(80)).map(|_| leaf(random)).collect();
    let mut groups: Vec<RawGroup> = Vec::new();
    let mut current: Vec<usize> = (0..clusters.len()).collect();
    for level in 0.. {
        let last = current.len() <= 2 || level == 10;
        let mut produced = Vec::new();
        while !current.is_empty() {
            let size = if last {
                current.len()
            } else {
                1 + random.below(5.min(current.len()))
            };
            let members: Vec<usize> = current.drain(..size).collect();
            let number = groups.len() as u32;
            let (mut spheres, mut error) = (Vec::new(), 0f32);
            for &member in &members {
                let aabb = clusters[member].aabb(GRID);
                spheres.push(Sphere::around([aabb.min, aabb.max].into_iter()));
                if let Some(child) = groups.get(clusters[member].child_group as usize) {
                    spheres.push(child.lod_sphere);
                    error = error.max(child.parent_error_metres);
                }
                clusters[member].group = number;
            }
            let is_root = last || random.below(20) == 0;
            if random.below(3) > 0 {
                error = error * (1.0 + random.unit() as f32) + random.range(0.0, 0.05) as f32;
            }
            groups.push(RawGroup {
                level,
                lod_sphere: Sphere::enclosing(&spheres),
                parent_error_metres: if is_root { ROOT_ERROR } else { error },
                members: members.clone(),
            });
            for _ in 0..if is_root {
                0
            } else {
                members.len().div_ceil(2)
            } {
                let positions = (0..3)
                    .map(|_| {
                        clusters[members[random.below(members.len())]].positions[random.below(3)]
                    })
                    .collect();
                produced.push(clusters.len());
                clusters.push(cluster(positions, level as u8 + 1, number));
            }
        }
        if produced.is_empty() {
            break;
        }
        current = produced;
    }
    (clusters, groups)
}

/// A random asset.
pub fn random_dag(random: &mut Random) -> Dag {
    let (clusters, raw) = raw_dag(random);
    let mut order: Vec<usize> = (0..raw.len()).collect();
    order.sort_by_key(|&index| {
        (
            raw[index].parent_error_metres < ROOT_ERROR,
            u32::MAX - raw[index].level,
        )
    });
    let mut rank = vec![0u32; raw.len()];
    order
        .iter()
        .enumerate()
        .for_each(|(place, &index)| rank[index] = place as u32);

    let page_clusters = 2 + random.below(6);
    let mut pages: Vec<Vec<Cluster>> = vec![Vec::new()];
    let mut hierarchy = Hierarchy::default();
    let mut root_page_count = 0;
    for &index in &order {
        let raw = &raw[index];
        let first_part = hierarchy.parts.len() as u32;
        let mut first_page = None;
        for &member in &raw.members {
            if pages[pages.len() - 1].len() == page_clusters {
                pages.push(Vec::new());
            }
            let page = pages.len() - 1;
            let begins = first_page
                .is_none_or(|first| page > first + hierarchy.parts.len() - 1 - first_part as usize);
            first_page.get_or_insert(page);
            if begins {
                hierarchy.parts.push(Part {
                    first_cluster: pages[page].len() as u32,
                    cluster_count: 0,
                });
            }
            hierarchy
                .parts
                .last_mut()
                .expect("a part was pushed")
                .cluster_count += 1;
            let mut cluster = clusters[member].clone();
            cluster.group = rank[cluster.group as usize];
            if cluster.child_group != NO_GROUP {
                cluster.child_group = rank[cluster.child_group as usize];
            }
            pages[page].push(cluster);
        }
        if raw.parent_error_metres >= ROOT_ERROR {
            root_page_count = pages.len() as u32;
        }
        hierarchy.groups.push(Group {
            lod_center: raw.lod_sphere.center,
            lod_radius: raw.lod_sphere.radius,
            parent_error_metres: raw.parent_error_metres,
            first_part,
            part_count: hierarchy.parts.len() as u32 - first_part,
            first_page: first_page.expect("a group has members") as u32,
            level: raw.level,
            cluster_count: raw.members.len() as u32,
            triangle_count: raw
                .members
                .iter()
                .map(|&member| clusters[member].triangles.len() as u32)
                .sum(),
            spare: 0,
        });
    }
    let aabbs = group_aabbs(&pages, hierarchy.groups.len());
    let mut leaves: Vec<u32> = (0..hierarchy.groups.len() as u32).collect();
    leaves.sort_by_cached_key(|_| random.next());
    hierarchy.depth = push_node(random, &mut hierarchy, &aabbs, &leaves);
    let hierarchy =
        Hierarchy::decode(&hierarchy.encode(), pages.len() as u32).expect("a valid hierarchy");
    let asset = asset(&hierarchy, &pages, &aabbs, root_page_count);
    Dag {
        asset,
        hierarchy,
        pages,
    }
}

fn group_aabbs(pages: &[Vec<Cluster>], groups: usize) -> Vec<Aabb> {
    let mut aabbs = vec![Aabb::EMPTY; groups];
    for cluster in pages.iter().flatten() {
        let aabb = &mut aabbs[cluster.group as usize];
        *aabb = aabb.merge(&cluster.aabb(GRID));
    }
    aabbs
}

/// Appends a node over `leaves` and, after it, those below; gives its depth.
fn push_node(
    random: &mut Random,
    hierarchy: &mut Hierarchy,
    aabbs: &[Aabb],
    leaves: &[u32],
) -> u32 {
    let index = hierarchy.nodes.len();
    hierarchy.nodes.push(Node {
        children: [Child::EMPTY; 8],
    });
    let share = leaves.len().div_ceil(2 + random.below(7)).max(1);
    let mut deepest = 0;
    for (slot, below) in leaves.chunks(share).enumerate() {
        let groups: Vec<Group> = below
            .iter()
            .map(|&leaf| hierarchy.groups[leaf as usize])
            .collect();
        let sphere = Sphere::enclosing(&groups.iter().map(Group::lod_sphere).collect::<Vec<_>>());
        let aabb = below
            .iter()
            .fold(Aabb::EMPTY, |aabb, &leaf| aabb.merge(&aabbs[leaf as usize]));
        let reference = if below.len() == 1 {
            below[0] | LEAF_FLAG
        } else {
            let reference = hierarchy.nodes.len() as u32;
            deepest = deepest.max(push_node(random, hierarchy, aabbs, below));
            reference
        };
        hierarchy.nodes[index].children[slot] = Child {
            lod_center: sphere.center,
            lod_radius: sphere.radius,
            aabb_min: aabb.min,
            max_parent_error_metres: groups
                .iter()
                .map(|group| group.parent_error_metres)
                .fold(0.0, f32::max),
            aabb_max: aabb.max,
            reference,
        };
    }
    deepest + 1
}

fn asset(
    hierarchy: &Hierarchy,
    pages: &[Vec<Cluster>],
    aabbs: &[Aabb],
    root_page_count: u32,
) -> Asset {
    let hash = ContentHash::of(b"");
    let entries = (0..pages.len() as u32).map(|page| PageEntry {
        offset: page as u64,
        bytes: 1,
        memory_words: 1,
        hash,
        dependencies: dependencies(hierarchy, pages, page).into_iter().collect(),
    });
    Asset {
        attributes: Attributes(0),
        position_grid: GRID,
        uv_grid: GRID,
        center_q: [0; 3],
        aabb: aabbs.iter().fold(Aabb::EMPTY, |all, aabb| all.merge(aabb)),
        material_slots: 1,
        source_triangles: 0,
        dag_triangles: 0,
        clusters: 0,
        levels: 0,
        pack: hash,
        hierarchy: hash,
        proxy: Default::default(),
        root_page_count,
        pages: entries.collect(),
    }
}

/// Pages of the groups that the groups of `page` refine.
fn dependencies(hierarchy: &Hierarchy, pages: &[Vec<Cluster>], page: u32) -> BTreeSet<u32> {
    let own: BTreeSet<u32> = pages[page as usize]
        .iter()
        .map(|cluster| cluster.group)
        .collect();
    let coarser = pages
        .iter()
        .flatten()
        .filter(|cluster| own.contains(&cluster.child_group));
    coarser
        .flat_map(|cluster| hierarchy.groups[cluster.group as usize].pages())
        .filter(|&other| other != page)
        .collect()
}

/// A scene with a pool: everything that a frame's culling reads but the view.
pub struct Fixture {
    pub arrays: SceneArrays,
    pub dags: Vec<Dag>,
    pub page_table: Vec<u32>,
    pub pool: Vec<u32>,
}

impl Fixture {
    /// One to five instances of the assets, some mirrored, some stretched unevenly, some ten thousand kilometres away.
    pub fn new(random: &mut Random, dags: Vec<Dag>) -> Self {
        let far = if random.below(3) == 0 {
            random.vector(1e7)
        } else {
            DVec3::ZERO
        };
        let instances = (0..1 + random.below(5)).map(|_| {
            let linear = match random.below(4) {
                0 => DMat3::IDENTITY,
                1 => DMat3::from_diagonal(DVec3::new(
                    random.range(0.1, 4.0),
                    -random.range(0.1, 4.0),
                    random.range(0.1, 4.0),
                )),
                2 => DMat3::from_diagonal(DVec3::splat(random.range(1e-3, 10.0))),
                _ => DMat3::from_cols(random.vector(2.0), random.vector(2.0), random.vector(2.0)),
            };
            let translation = far + random.vector(60.0);
            let rows = linear.transpose();
            let row = |index: usize| {
                let row = rows.col(index);
                [row.x, row.y, row.z, translation[index]]
            };
            Instance {
                asset: random.below(dags.len()) as u32,
                world_from_object: [row(0), row(1), row(2)],
            }
        });
        let scene = Scene {
            instances: instances.collect(),
            assets: dags
                .iter()
                .map(|dag| SceneAsset {
                    name: String::new(),
                    asset: dag.asset.pack,
                    materials: vec![0],
                    steps: InstanceSteps::default(),
                })
                .collect(),
            ..Scene::default()
        };
        let arrays = SceneArrays::new(&scene, dags.iter().map(|dag| (&dag.asset, &dag.hierarchy)));
        let page_table = arrays.empty_page_table();
        Self {
            arrays,
            dags,
            page_table,
            pool: Vec::new(),
        }
    }

    /// Installs root pages and a random share of the others whose dependencies are installed, at random places.
    pub fn install(&mut self, random: &mut Random, share: f64) {
        self.page_table = self.arrays.empty_page_table();
        self.pool.clear();
        for (dag, record) in self.dags.iter().zip(&self.arrays.assets) {
            for (page, entry) in dag.asset.pages.iter().enumerate() {
                let installed = |page: &u32| {
                    self.page_table[(record.page_base + page) as usize] != NOT_INSTALLED
                };
                let wanted = (page as u32) < dag.asset.root_page_count || random.unit() < share;
                if wanted && entry.dependencies.iter().all(installed) {
                    self.pool.extend((0..random.below(5)).map(|_| 0xdead_beef));
                    self.page_table[record.page_base as usize + page] = self.pool.len() as u32;
                    let words =
                        memory_form::encode(&dag.pages[page], dag.asset.attributes, page as u32);
                    self.pool.extend(words.expect("a valid page"));
                }
            }
        }
    }

    /// The box of each group of the scene, from the hierarchy's leaves.
    pub fn group_aabbs(&self) -> Vec<Aabb> {
        let mut aabbs = vec![Aabb::EMPTY; self.arrays.groups.len()];
        for (dag, record) in self.dags.iter().zip(&self.arrays.assets) {
            for child in dag.hierarchy.nodes.iter().flat_map(|node| &node.children) {
                if child.reference != NO_CHILD && child.reference & LEAF_FLAG != 0 {
                    aabbs[(record.group_base + (child.reference & !LEAF_FLAG)) as usize] =
                        child.aabb();
                }
            }
        }
        aabbs
    }
}

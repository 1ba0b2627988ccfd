//! A built asset read back, and what may be drawn of it.
//!
//! An edge between two places counts +1 for each triangle along it and -1 for each against it. The sums of a
//! cut must be the sums of the source: then no edge is open that was closed, none is closed that was open, and no
//! open edge has moved. Triangles may be counted per cluster because sums add up.

use std::collections::HashMap;

use lodestream_format::cluster::NO_GROUP;
use lodestream_format::{Asset, Cluster, Hierarchy};
use lodestream_server::build::{BuiltAsset, Point, TriangleTree, decode_pages, unpack_pages};

use super::Random;

/// Edge between two places, the smaller first, with its sum.
pub type Sums = HashMap<(u32, u32), i64>;

/// A built asset, every byte of it read back with the reader's checks.
pub struct ReadAsset {
    pub asset: Asset,
    pub hierarchy: Hierarchy,
    pub clusters: Vec<Cluster>,
    /// Corners of every cluster's triangles as places.
    pub corners: Vec<Vec<[u32; 3]>>,
    /// Local position of every place, metres.
    pub places: Vec<[f32; 3]>,
    /// Edge sums of every cluster.
    pub sums: Vec<Vec<((u32, u32), i64)>>,
    /// Groups that hold what each group became.
    pub parents: Vec<Vec<u32>>,
}

impl ReadAsset {
    /// Reads everything back; panics where a check of the format fails.
    pub fn new(built: &BuiltAsset) -> Self {
        let asset = Asset::decode(&built.asset_bytes).expect("asset");
        assert_eq!(asset, built.asset);
        let pages = asset.pages.len() as u32;
        let hierarchy = Hierarchy::decode(&built.hierarchy_bytes, pages).expect("hierarchy");
        for (page, form) in decode_pages(built).expect("pages").iter().enumerate() {
            assert_eq!(form.page() as usize, page);
            assert_eq!(form.memory_words(), asset.pages[page].memory_words as usize);
            hierarchy
                .check_page(form)
                .expect("page agrees with the hierarchy");
        }
        let clusters = unpack_pages(built).expect("pages").concat();
        assert_eq!(clusters.len() as u64, asset.clusters);
        let mut number = HashMap::new();
        let mut places = Vec::new();
        let corners: Vec<Vec<[u32; 3]>> = clusters
            .iter()
            .map(|cluster| {
                let place: Vec<u32> = cluster
                    .positions
                    .iter()
                    .map(|&q| {
                        *number.entry(q).or_insert_with(|| {
                            let step = asset.position_grid.step();
                            places.push(q.map(|q| (q as f64 * step) as f32));
                            places.len() as u32 - 1
                        })
                    })
                    .collect();
                cluster
                    .triangles
                    .iter()
                    .map(|t| t.map(|i| place[i as usize]))
                    .collect()
            })
            .collect();
        let sums = corners
            .iter()
            .map(|corners| {
                let mut sums = Sums::new();
                corners
                    .iter()
                    .for_each(|&triangle| add(&mut sums, triangle, 1));
                sums.into_iter().filter(|&(_, sum)| sum != 0).collect()
            })
            .collect();
        let mut parents = vec![Vec::new(); hierarchy.groups.len()];
        for cluster in clusters
            .iter()
            .filter(|cluster| cluster.child_group != NO_GROUP)
        {
            parents[cluster.child_group as usize].push(cluster.group);
        }
        Self {
            asset,
            hierarchy,
            clusters,
            corners,
            places,
            sums,
            parents,
        }
    }

    /// Error of a cluster, metres.
    pub fn error_metres(&self, cluster: usize) -> f32 {
        match self.clusters[cluster].child_group {
            NO_GROUP => 0.0,
            child => self.hierarchy.groups[child as usize].parent_error_metres,
        }
    }

    /// Clusters drawn where `refine` says which groups are refined: the whole predicate of a viewer.
    pub fn drawn(&self, refine: &[bool]) -> Vec<usize> {
        let drawn = |cluster: &Cluster| {
            refine[cluster.group as usize]
                && (cluster.child_group == NO_GROUP || !refine[cluster.child_group as usize])
        };
        (0..self.clusters.len())
            .filter(|&index| drawn(&self.clusters[index]))
            .collect()
    }

    /// A random set of installed pages, closed under dependencies, root pages always in it.
    pub fn random_residency(&self, random: &mut Random) -> Vec<bool> {
        let share = random.unit();
        let mut installed = vec![false; self.asset.pages.len()];
        for (page, entry) in self.asset.pages.iter().enumerate() {
            let needed = entry
                .dependencies
                .iter()
                .all(|&needed| installed[needed as usize]);
            let root = page < self.asset.root_page_count as usize;
            assert!(!root || needed, "root pages depend on root pages only");
            installed[page] = root || needed && random.unit() < share;
        }
        installed
    }

    /// Which groups a random camera refines, with `installed` pages.
    pub fn random_refinement(&self, random: &mut Random, installed: &[bool]) -> Vec<bool> {
        let aabb = &self.asset.aabb;
        let extent = (0..3)
            .map(|axis| aabb.max[axis] - aabb.min[axis])
            .fold(1e-30, f32::max) as f64;
        let center = aabb.center().map(f64::from);
        let reach = extent * 10f64.powf(random.between(-1.0, 1.5));
        let eye = center.map(|middle| middle + random.between(-reach, reach));
        let pixel_error = 10f64.powf(random.between(-2.0, 2.0));
        let groups = self.hierarchy.groups.iter();
        groups
            .map(|group| {
                let away: f64 = (0..3)
                    .map(|axis| (group.lod_center[axis] as f64 - eye[axis]).powi(2))
                    .sum::<f64>()
                    .sqrt();
                // 1000 pixels a radian; at the nearest point of the sphere.
                let nearest = (away - group.lod_radius as f64).max(0.0);
                let projected_px = 1000.0 * group.parent_error_metres as f64 / nearest;
                let ready = group.pages().all(|page| installed[page as usize]);
                ready && (group.is_root() || projected_px > pixel_error)
            })
            .collect()
    }

    /// Which groups are refined for an error of at most `metres` everywhere.
    pub fn uniform_refinement(&self, metres: f32) -> Vec<bool> {
        self.hierarchy
            .groups
            .iter()
            .map(|group| group.parent_error_metres > metres)
            .collect()
    }

    /// Edge sums over some clusters.
    pub fn sums_of(&self, clusters: impl Iterator<Item = usize>) -> Sums {
        let mut total = Sums::new();
        for cluster in clusters {
            for &(edge, sum) in &self.sums[cluster] {
                *total.entry(edge).or_insert(0) += sum;
            }
        }
        total.retain(|_, sum| *sum != 0);
        total
    }

    /// Edge sums of the source triangles.
    pub fn source_sums(&self) -> Sums {
        let leaves = (0..self.clusters.len())
            .filter(|&cluster| self.clusters[cluster].child_group == NO_GROUP);
        self.sums_of(leaves)
    }

    /// For each group what its replacement adds to the edge sums; empty unless open edges moved.
    pub fn moved_edges(&self) -> Vec<Sums> {
        let mut moved = vec![Sums::new(); self.hierarchy.groups.len()];
        for (cluster, own) in self.clusters.iter().zip(&self.sums) {
            for &(edge, sum) in own {
                if !self.hierarchy.groups[cluster.group as usize].is_root() {
                    *moved[cluster.group as usize].entry(edge).or_insert(0) -= sum;
                }
                if cluster.child_group != NO_GROUP {
                    *moved[cluster.child_group as usize].entry(edge).or_insert(0) += sum;
                }
            }
        }
        moved
            .iter_mut()
            .for_each(|sums| sums.retain(|_, sum| *sum != 0));
        moved
    }

    /// Panics unless what is drawn with `refine` covers the source once: refinement is closed toward the root (so each
    /// group is either wholly replaced or wholly not), and the edge sums are those of the source, but for groups
    /// whose own replacement moved open edges.
    pub fn check_cut(&self, refine: &[bool], source: &Sums, moved: &[Sums]) -> usize {
        for (group, parents) in self.parents.iter().enumerate() {
            let orphan = refine[group] && parents.iter().any(|&parent| !refine[parent as usize]);
            assert!(
                !orphan,
                "group {group} is refined, what holds its replacement is not"
            );
            assert!(refine[group] || !self.hierarchy.groups[group].is_root());
        }
        let drawn = self.drawn(refine);
        let mut expected = source.clone();
        for (_, sums) in moved
            .iter()
            .enumerate()
            .filter(|&(group, _)| !refine[group])
        {
            for (&edge, &sum) in sums {
                *expected.entry(edge).or_insert(0) += sum;
            }
        }
        expected.retain(|_, sum| *sum != 0);
        assert!(
            self.sums_of(drawn.iter().copied()) == expected,
            "edges opened, closed or moved"
        );
        drawn.len()
    }

    /// Draws `pairs` random (camera, residency) pairs and checks each cut; gives the number of clusters drawn in all.
    pub fn check_random_cuts(&self, pairs: usize, seed: u64) -> usize {
        let mut random = Random(seed);
        let (source, moved) = (self.source_sums(), self.moved_edges());
        (0..pairs)
            .map(|_| {
                let installed = self.random_residency(&mut random);
                let refine = self.random_refinement(&mut random, &installed);
                self.check_cut(&refine, &source, &moved)
            })
            .sum()
    }

    /// Panics unless errors and spheres only grow toward the root and pages hold what groups need.
    pub fn check_monotone(&self) {
        for (index, group) in self.hierarchy.groups.iter().enumerate() {
            for &parent in &self.parents[index] {
                let coarser = &self.hierarchy.groups[parent as usize];
                assert!(
                    coarser.parent_error_metres >= group.parent_error_metres,
                    "group {index}"
                );
                assert!(
                    coarser.lod_sphere().contains(&group.lod_sphere()),
                    "group {index}"
                );
                assert!(
                    (parent as usize) < index && coarser.level > group.level,
                    "group {index}"
                );
                for page in group.pages() {
                    let entry = &self.asset.pages[page as usize];
                    let held = coarser
                        .pages()
                        .all(|needed| needed == page || entry.dependencies.contains(&needed));
                    assert!(held, "page {page} does not depend on group {parent}");
                }
            }
        }
        for (cluster, corners) in self.clusters.iter().zip(&self.corners) {
            let sphere = self.hierarchy.groups[cluster.group as usize].lod_sphere();
            let inside = |&place: &u32| {
                let center = self.places[place as usize];
                sphere.contains(&lodestream_format::Sphere {
                    center,
                    radius: 0.0,
                })
            };
            assert!(
                corners.iter().flatten().all(inside),
                "a cluster outside its lod sphere"
            );
        }
    }

    /// Triangles of some clusters as places.
    pub fn triangles(&self, clusters: impl Iterator<Item = usize>) -> Vec<[u32; 3]> {
        clusters
            .flat_map(|cluster| self.corners[cluster].iter().copied())
            .collect()
    }

    /// Measures cuts of uniform error from fine to coarse: (largest stored error, largest distance both ways) each, metres.
    /// Panics where a cluster lies farther from the source than its stored error says, or the source from the cut.
    pub fn check_errors(&self) -> Vec<(f64, f64)> {
        let leaf = |&cluster: &usize| self.clusters[cluster].child_group == NO_GROUP;
        let source = self.triangles((0..self.clusters.len()).filter(leaf));
        let tree = TriangleTree::new(&self.places, &source);
        let mut errors: Vec<f32> = self
            .hierarchy
            .groups
            .iter()
            .map(|group| group.parent_error_metres)
            .collect();
        errors.sort_unstable_by(f32::total_cmp);
        let finite = errors.iter().take_while(|&&error| error < 1e29).count();
        let mut rows = Vec::new();
        for share in [0.25, 0.5, 0.75, 0.9, 0.97, 1.0] {
            let Some(&threshold) = errors[..finite].get((share * finite as f64) as usize) else {
                continue;
            };
            let drawn = self.drawn(&self.uniform_refinement(threshold));
            let mut stored: f64 = 0.0;
            let mut distance: f64 = 0.0;
            for &cluster in &drawn {
                let error = self.error_metres(cluster) as f64;
                stored = stored.max(error);
                for &corners in &self.corners[cluster] {
                    for sample in self.samples(corners) {
                        let own = tree.distance_squared(sample, -1.0).sqrt();
                        assert!(
                            own <= error * (1.0 + 1e-6),
                            "{own} m off, {error} m promised"
                        );
                        distance = distance.max(own);
                    }
                }
            }
            let cut = TriangleTree::new(&self.places, &self.triangles(drawn.iter().copied()));
            for &corners in &source {
                for sample in self.samples(corners) {
                    let away = cut.distance_squared(sample, -1.0).sqrt();
                    assert!(
                        away <= stored * (1.0 + 1e-6),
                        "source {away} m off, {stored} m promised"
                    );
                    distance = distance.max(away);
                }
            }
            rows.push((stored, distance));
        }
        rows
    }

    /// Fifteen points spread over a triangle, local metres.
    fn samples(&self, corners: [u32; 3]) -> impl Iterator<Item = Point> {
        let corners = corners.map(|place| self.places[place as usize].map(f64::from));
        (0..=4).flat_map(move |i| {
            (0..=4 - i).map(move |j| {
                let (u, v) = (i as f64 / 4.0, j as f64 / 4.0);
                std::array::from_fn(|axis| {
                    corners[0][axis] * (1.0 - u - v) + corners[1][axis] * u + corners[2][axis] * v
                })
            })
        })
    }
}

fn add(sums: &mut Sums, [a, b, c]: [u32; 3], sign: i64) {
    for (from, to) in [(a, b), (b, c), (c, a)] {
        let edge = (from.min(to), from.max(to));
        let along = if from < to { sign } else { -sign };
        if from != to {
            *sums.entry(edge).or_insert(0) += along;
        }
    }
}

//! What any builder made, in one shape: clusters over places, and the groups that refine them.
//!
//! Places are local: metres from the asset's centre, so that f32 holds them wherever the object stands. Vertices at one
//! place are one here, whatever their attributes.

use std::collections::HashMap;

use lodestream_format::cluster::NO_GROUP;
use lodestream_format::page_reader::PageReader;
use lodestream_format::{Asset, FormatError, Hierarchy, cluster_view};
use lodestream_server::build::{BuiltAsset, decode_pages};
use lodestream_server::import::Mesh;

/// A cluster: a run of [`ClusterDag::triangles`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DagCluster {
    /// First triangle.
    pub first: u32,
    /// Triangles.
    pub count: u32,
    /// Vertices that are drawn, attributes told apart.
    pub vertices: u32,
    /// 0 holds the source.
    pub level: u32,
    /// Group that it is a member of.
    pub group: u32,
    /// Finer group that it replaces a part of; `None` at the source.
    pub child_group: Option<u32>,
}

/// Clusters that are replaced together.
#[derive(Debug, Clone, PartialEq)]
pub struct DagGroup {
    /// Stored error of what replaces the group, metres; infinite where nothing does.
    pub parent_error_metres: f64,
    /// Level of its coarsest clusters.
    pub level: u32,
    /// Its clusters.
    pub members: Vec<u32>,
    /// The clusters that replace it.
    pub replacement: Vec<u32>,
}

impl DagGroup {
    /// Whether nothing coarser exists.
    pub fn is_root(&self) -> bool {
        self.parent_error_metres.is_infinite()
    }
}

/// Places by their grid indices.
pub(super) type Places = HashMap<[i32; 3], u32>;

/// What a builder made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ClusterDag {
    /// Local metres.
    pub places: Vec<[f32; 3]>,
    /// Places of the corners, cluster after cluster.
    pub triangles: Vec<[u32; 3]>,
    /// Clusters.
    pub clusters: Vec<DagCluster>,
    /// Groups.
    pub groups: Vec<DagGroup>,
}

impl ClusterDag {
    /// Reads our asset back from its bytes, with all checks of the format.
    ///
    /// # Errors
    /// Bytes that break the format, which [`lodestream_server::build::build`] never gives.
    pub fn of_asset(built: &BuiltAsset) -> Result<Self, FormatError> {
        let asset = Asset::decode(&built.asset_bytes)?;
        let hierarchy = Hierarchy::decode(&built.hierarchy_bytes, asset.pages.len() as u32)?;
        let step = asset.position_grid.step();
        let mut dag = Self::default();
        let mut places = Places::default();
        let mut reader = PageReader::new(&asset);
        for form in &decode_pages(built)? {
            hierarchy.check_page(form)?;
            dag.add_page(reader.read(form)?, step, &mut places);
        }
        dag.finish(&hierarchy);
        Ok(dag)
    }

    /// Takes up the clusters of a page in memory form; `step` is the position step, metres.
    pub(super) fn add_page(&mut self, page: &[u32], step: f64, known: &mut Places) {
        for cluster in cluster_view::clusters(page) {
            let places: Vec<u32> = cluster
                .positions
                .iter()
                .map(|&q| {
                    *known.entry(q).or_insert_with(|| {
                        self.places.push(q.map(|q| (q as f64 * step) as f32));
                        self.places.len() as u32 - 1
                    })
                })
                .collect();
            let corners = cluster.triangles.iter();
            self.push(
                corners.map(|corners| corners.map(|corner| places[corner as usize])),
                DagCluster {
                    first: 0,
                    count: 0,
                    vertices: cluster.positions.len() as u32,
                    level: cluster.level.into(),
                    group: cluster.group,
                    child_group: Some(cluster.child_group).filter(|&it| it != NO_GROUP),
                },
            );
        }
    }

    /// Takes up the groups, once all pages are in.
    pub(super) fn finish(&mut self, hierarchy: &Hierarchy) {
        self.groups = hierarchy
            .groups
            .iter()
            .map(|group| DagGroup {
                parent_error_metres: match group.is_root() {
                    true => f64::INFINITY,
                    false => group.parent_error_metres.into(),
                },
                level: group.level,
                members: Vec::new(),
                replacement: Vec::new(),
            })
            .collect();
        self.link();
    }

    /// Appends a cluster; its run is filled in.
    pub(super) fn push(&mut self, corners: impl Iterator<Item = [u32; 3]>, cluster: DagCluster) {
        let first = self.triangles.len() as u32;
        self.triangles.extend(corners);
        self.clusters.push(DagCluster {
            first,
            count: self.triangles.len() as u32 - first,
            ..cluster
        });
    }

    /// Fills in members and replacements; groups must be there.
    pub(super) fn link(&mut self) {
        for (index, cluster) in (0..).zip(&self.clusters) {
            self.groups[cluster.group as usize].members.push(index);
            if let Some(child) = cluster.child_group {
                self.groups[child as usize].replacement.push(index);
            }
        }
    }

    /// Triangles of a cluster.
    pub fn triangles_of(&self, cluster: u32) -> &[[u32; 3]] {
        let cluster = &self.clusters[cluster as usize];
        &self.triangles[cluster.first as usize..][..cluster.count as usize]
    }

    /// Triangles of some clusters.
    pub fn gather(&self, clusters: impl IntoIterator<Item = u32>) -> Vec<[u32; 3]> {
        let clusters = clusters.into_iter();
        clusters
            .flat_map(|cluster| self.triangles_of(cluster).iter().copied())
            .collect()
    }

    /// Stored error of a cluster, metres.
    pub fn error_metres(&self, cluster: u32) -> f64 {
        self.clusters[cluster as usize]
            .child_group
            .map_or(0.0, |child| self.groups[child as usize].parent_error_metres)
    }

    /// Clusters drawn where `refine` says which groups are refined; groups without a replacement always are.
    pub fn cut(&self, refine: impl Fn(&DagGroup) -> bool) -> Vec<u32> {
        let refined: Vec<bool> = self
            .groups
            .iter()
            .map(|group| group.is_root() || refine(group))
            .collect();
        let drawn = |&index: &u32| {
            let cluster = &self.clusters[index as usize];
            let child = cluster.child_group;
            refined[cluster.group as usize] && child.is_none_or(|it| !refined[it as usize])
        };
        (0..self.clusters.len() as u32).filter(drawn).collect()
    }

    /// The cut where every group finer than `level` is replaced.
    pub fn level_cut(&self, level: u32) -> Vec<u32> {
        self.cut(|group| group.level >= level)
    }

    /// The cut whose stored error is at most `metres` everywhere it can be.
    pub fn error_cut(&self, metres: f64) -> Vec<u32> {
        self.cut(|group| group.parent_error_metres > metres)
    }

    /// Levels, the source included.
    pub fn levels(&self) -> u32 {
        let finest = self.clusters.iter().map(|cluster| cluster.level);
        finest.max().map_or(0, |level| level + 1)
    }

    /// Stored errors at which uniform cuts halve about as levels do, fine to coarse, at most `most`.
    pub fn ladder(&self, most: usize) -> Vec<f64> {
        let mut errors: Vec<f64> = self
            .groups
            .iter()
            .filter(|group| !group.is_root())
            .map(|group| group.parent_error_metres)
            .collect();
        errors.sort_unstable_by(f64::total_cmp);
        let mut ladder = Vec::new();
        let mut left = errors.len();
        while left > 0 && ladder.len() + 1 < most {
            ladder.push(errors[errors.len() - left]);
            left /= 2;
        }
        ladder.extend(errors.last());
        ladder.dedup();
        ladder
    }
}

/// The mesh as it came, in the local places of an asset centred at `center_metres`; source triangles of two equal
/// places stay.
pub fn source_places(mesh: &Mesh, center_metres: [f64; 3]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let mut places = Vec::new();
    let mut known: HashMap<[u32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
    let place_of: Vec<u32> = mesh
        .positions
        .iter()
        .map(|position| {
            // Adding zero takes the sign from a negative one.
            let bits = position.map(|x| (x + 0.0).to_bits());
            *known.entry(bits).or_insert_with(|| {
                places.push(std::array::from_fn(|axis| {
                    (position[axis] as f64 - center_metres[axis]) as f32
                }));
                places.len() as u32 - 1
            })
        })
        .collect();
    let corners = mesh.triangles.iter();
    let triangles = corners.map(|corners| corners.map(|vertex| place_of[vertex as usize]));
    (places, triangles.collect())
}

/// Object-space centre of a built asset, metres.
pub fn center_metres(built: &BuiltAsset) -> [f64; 3] {
    let grid = built.asset.position_grid;
    built.asset.center_q.map(|q| grid.dequantize(q))
}

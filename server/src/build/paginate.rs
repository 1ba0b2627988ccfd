//! Groups to pages: coarse to fine, near to near, full pages.

use std::ops::Range;

use lodestream_format::Cluster;
use lodestream_format::cluster::{Attributes, NO_GROUP};
use lodestream_format::disk_form;
use lodestream_format::hierarchy::{Part, ROOT_ERROR};
use lodestream_format::limits::{
    MAX_DISK_FORM_BYTES, MAX_PAGE_CLUSTERS, PAGE_WORDS, ROOT_PAGE_TARGET_BYTES,
};
use lodestream_format::memory_form::{ClusterHeader, PAGE_HEADER_WORDS, cluster_words};
use rayon::prelude::*;

use super::dag::{self, Dag};
use super::quantize::QuantizedMesh;

/// A group where it lies.
#[derive(Debug)]
pub(super) struct PlacedGroup {
    /// Number in the DAG.
    pub group: u32,
    /// Its clusters in [`Pages::clusters`].
    pub clusters: Range<usize>,
    pub first_page: u32,
    /// One a page from `first_page` on.
    pub parts: Vec<Part>,
}

impl PlacedGroup {
    fn pages(&self) -> Range<u32> {
        self.first_page..self.first_page + self.parts.len() as u32
    }
}

/// Every cluster in its page.
#[derive(Debug)]
pub(super) struct Pages {
    /// Clusters of all pages, in order, as the format stores them.
    pub clusters: Vec<Cluster>,
    /// Each page's clusters.
    pub pages: Vec<Range<usize>>,
    /// Each page's dependencies, ascending.
    pub dependencies: Vec<Vec<u32>>,
    /// Groups in page order; what a cluster names is an index into this.
    pub groups: Vec<PlacedGroup>,
    pub root_page_count: u32,
}

/// Lays out a DAG.
pub(super) fn paginate(mesh: &QuantizedMesh, dag: &Dag) -> Pages {
    let order = order(dag);
    let mut number = vec![NO_GROUP; dag.groups.len()];
    for (new, &old) in order.iter().enumerate() {
        number[old as usize] = new as u32;
    }
    let clusters: Vec<Cluster> = order
        .par_iter()
        .flat_map_iter(|&old| {
            let group = number[old as usize];
            let number = &number;
            dag.groups[old as usize]
                .members
                .iter()
                .map(move |&cluster| {
                    let cluster = &dag.clusters[cluster as usize];
                    let child_group = match cluster.child_group {
                        NO_GROUP => NO_GROUP,
                        child => number[child as usize],
                    };
                    to_format(mesh, cluster, group, child_group)
                })
        })
        .collect();
    let sizes: Vec<ClusterSize> = clusters
        .par_iter()
        .map(|cluster| ClusterSize::of(cluster, mesh.attributes))
        .collect();

    let mut first = 0;
    let groups = order
        .iter()
        .map(|&old| {
            let count = dag.groups[old as usize].members.len();
            first += count;
            (old, first - count..first)
        })
        .collect();
    let roots = dag
        .groups
        .iter()
        .filter(|group| group.parent_error_metres >= ROOT_ERROR)
        .count();
    let mut pages = place(groups, &sizes, roots, mesh.attributes);
    pages.dependencies = dependencies(&pages, &clusters);
    pages.clusters = clusters;
    pages
}

/// Groups, last round first, so that what replaces a group always comes before it; inside a round along a Morton curve.
fn order(dag: &Dag) -> Vec<u32> {
    let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
    for group in &dag.groups {
        for axis in 0..3 {
            low[axis] = low[axis].min(group.lod_sphere.center[axis] as f64);
            high[axis] = high[axis].max(group.lod_sphere.center[axis] as f64);
        }
    }
    let extent = (0..3)
        .map(|axis| high[axis] - low[axis])
        .fold(0.0, f64::max);
    let scale = if extent > 0.0 {
        ((1 << 21) - 1) as f64 / extent
    } else {
        0.0
    };
    let curve = |center: [f32; 3]| {
        (0..63).fold(0u64, |code, bit| {
            let axis = bit % 3;
            let cell = ((center[axis] as f64 - low[axis]) * scale) as u64;
            code | (cell >> (bit / 3) & 1) << bit
        })
    };
    let mut order: Vec<u32> = (0..dag.groups.len() as u32).collect();
    order.sort_by_cached_key(|&group| {
        let group = &dag.groups[group as usize];
        // Roots are all of the last round.
        (u32::MAX - group.round, curve(group.lod_sphere.center))
    });
    order
}

/// What a cluster adds to a page.
struct ClusterSize {
    memory_words: usize,
    triangles: usize,
    vertices: usize,
    table_words: usize,
    /// Bytes of x, y, z, u, v.
    plane_bytes: [u32; 5],
}

impl ClusterSize {
    fn of(cluster: &Cluster, attributes: Attributes) -> Self {
        let (header, table) = ClusterHeader::of(cluster);
        Self {
            memory_words: cluster_words(cluster, attributes),
            triangles: cluster.triangles.len(),
            vertices: cluster.positions.len(),
            table_words: table.len(),
            plane_bytes: header.widths().map(|bits| bits.div_ceil(8)),
        }
    }
}

/// A page being filled. Both forms have a limit; the disk form's planes are as wide as the widest cluster.
#[derive(Default, Clone)]
struct Filling {
    clusters: usize,
    memory_words: usize,
    triangles: usize,
    vertices: usize,
    table_words: usize,
    plane_bytes: [u32; 5],
}

impl Filling {
    fn with(&self, size: &ClusterSize) -> Self {
        Self {
            clusters: self.clusters + 1,
            memory_words: self.memory_words + size.memory_words,
            triangles: self.triangles + size.triangles,
            vertices: self.vertices + size.vertices,
            table_words: self.table_words + size.table_words,
            plane_bytes: std::array::from_fn(|plane| {
                self.plane_bytes[plane].max(size.plane_bytes[plane])
            }),
        }
    }

    fn fits(&self, memory_words: usize, attributes: Attributes) -> bool {
        let when = |flag, bytes| if attributes.has(flag) { bytes } else { 0 };
        let vertex_planes = self.plane_bytes.iter().sum::<u32>() as usize
            + when(Attributes::NORMAL, 4)
            + when(Attributes::COLOR, 4);
        let disk_words = disk_form::HEADER_WORDS
            + disk_form::COLUMNS * self.clusters
            + 3 * self.triangles.div_ceil(4)
            + vertex_planes * self.vertices.div_ceil(4)
            + self.table_words;
        self.clusters <= MAX_PAGE_CLUSTERS
            && PAGE_HEADER_WORDS + self.memory_words <= memory_words
            && disk_words <= MAX_DISK_FORM_BYTES / 4
    }
}

/// Fills pages in order. The first is small where the root groups allow it and holds no torn group; root groups that
/// need more get pages of their own.
fn place(
    groups: Vec<(u32, Range<usize>)>,
    sizes: &[ClusterSize],
    roots: usize,
    attributes: Attributes,
) -> Pages {
    let fill = |filling: &Filling, range: Range<usize>| {
        sizes[range]
            .iter()
            .fold(filling.clone(), |sum, size| sum.with(size))
    };
    let small = ROOT_PAGE_TARGET_BYTES / 4;
    let all_roots = 0..groups[roots - 1].1.end;
    let first_is_small = fill(&Filling::default(), all_roots).fits(small, attributes);
    let mut pages: Vec<Range<usize>> = std::iter::once(0..0).collect();
    let mut filling = Filling::default();
    let mut placed = Vec::with_capacity(groups.len());
    let mut root_page_count = 1;
    for (index, (group, clusters)) in groups.into_iter().enumerate() {
        let whole = fill(&filling, clusters.clone());
        let in_small = first_is_small && pages.len() == 1;
        let leave_roots = index == roots && !first_is_small;
        if leave_roots || in_small && !whole.fits(small, attributes) {
            pages.push(clusters.start..clusters.start);
            filling = Filling::default();
        }
        let mut first_page = pages.len() as u32 - 1;
        let mut parts: Vec<Part> = Vec::new();
        for cluster in clusters.clone() {
            let mut next = filling.with(&sizes[cluster]);
            if filling.clusters > 0 && !next.fits(PAGE_WORDS, attributes) {
                if parts.is_empty() {
                    first_page += 1;
                }
                pages.push(cluster..cluster);
                next = Filling::default().with(&sizes[cluster]);
            }
            filling = next;
            let page = pages.len() - 1;
            pages[page].end = cluster + 1;
            let part = page - first_page as usize;
            if part == parts.len() {
                parts.push(Part {
                    first_cluster: (cluster - pages[page].start) as u32,
                    cluster_count: 0,
                });
            }
            parts[part].cluster_count += 1;
        }
        if index < roots {
            root_page_count = pages.len() as u32;
        }
        placed.push(PlacedGroup {
            group,
            clusters,
            first_page,
            parts,
        });
    }
    Pages {
        clusters: Vec::new(),
        pages,
        dependencies: Vec::new(),
        groups: placed,
        root_page_count,
    }
}

/// For each page the pages of the groups that hold what its groups became.
fn dependencies(pages: &Pages, clusters: &[Cluster]) -> Vec<Vec<u32>> {
    let mut parents: Vec<Vec<u32>> = vec![Vec::new(); pages.groups.len()];
    for cluster in clusters
        .iter()
        .filter(|cluster| cluster.child_group != NO_GROUP)
    {
        parents[cluster.child_group as usize].push(cluster.group);
    }
    let mut dependencies = vec![Vec::new(); pages.pages.len()];
    for (group, mut parents) in pages.groups.iter().zip(parents) {
        parents.dedup();
        for page in group.pages() {
            let needed = parents
                .iter()
                .flat_map(|&parent| pages.groups[parent as usize].pages());
            dependencies[page as usize].extend(needed.filter(|&needed| needed != page));
        }
    }
    for list in &mut dependencies {
        list.sort_unstable();
        list.dedup();
    }
    dependencies
}

/// A cluster as the format stores it: triangles by material, vertices in order of first use and each once.
fn to_format(
    mesh: &QuantizedMesh,
    cluster: &dag::Cluster,
    group: u32,
    child_group: u32,
) -> Cluster {
    let mut triangles = cluster.triangles.clone();
    triangles.sort_by_key(|triangle| triangle.material);
    let mut used: Vec<u32> = Vec::new();
    let mut local = std::collections::HashMap::new();
    let mut out = Cluster {
        level: cluster.level,
        group,
        child_group,
        ..Cluster::default()
    };
    for triangle in &triangles {
        out.triangles.push(triangle.vertices.map(|vertex| {
            *local.entry(vertex).or_insert_with(|| {
                used.push(vertex);
                // At most 256 vertices.
                (used.len() - 1) as u8
            })
        }));
    }
    for run in triangles.chunk_by(|a, b| a.material == b.material) {
        out.materials
            .push(lodestream_format::cluster::MaterialRange {
                slot: run[0].material,
                triangle_count: run.len() as u16,
            });
    }
    let vertices = || used.iter().map(|&vertex| &mesh.vertices[vertex as usize]);
    out.positions = vertices().map(|vertex| vertex.position).collect();
    if mesh.attributes.has(Attributes::NORMAL) {
        out.normals = vertices().map(|vertex| vertex.normal).collect();
    }
    if mesh.attributes.has(Attributes::UV) {
        out.uvs = vertices().map(|vertex| vertex.uv).collect();
    }
    if mesh.attributes.has(Attributes::COLOR) {
        out.colors = vertices().map(|vertex| vertex.color).collect();
    }
    out
}

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

use super::cluster::ClusterView;
use super::dag::Dag;
use super::error::BuildError;
use super::vertex::Grids;

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

/// Every cluster's page.
#[derive(Debug)]
pub(super) struct Pages {
    /// Clusters of all pages, in order, as numbers in the DAG.
    pub clusters: Vec<u32>,
    /// Each page's clusters, as a range of `clusters`.
    pub pages: Vec<Range<usize>>,
    /// Each page's dependencies, ascending.
    pub dependencies: Vec<Vec<u32>>,
    /// Groups in page order; what a cluster names is an index into this.
    pub groups: Vec<PlacedGroup>,
    pub root_page_count: u32,
    /// Place in `groups` of every group of the DAG.
    pub number: Vec<u32>,
}

impl Pages {
    /// The page of a place in `clusters`.
    pub fn page_of(&self, place: usize) -> usize {
        self.pages.partition_point(|range| range.end <= place)
    }

    /// The placed group of a place in `clusters`.
    pub fn group_of(&self, place: usize) -> usize {
        self.groups
            .partition_point(|group| group.clusters.end <= place)
    }
}

/// Clusters converted at a time.
const WINDOW: usize = 4096;

/// Lays out a DAG.
pub(super) fn paginate(grids: &Grids, dag: &Dag) -> Result<Pages, BuildError> {
    let order = order(dag);
    let mut number = vec![NO_GROUP; dag.groups.len()];
    for (new, &old) in order.iter().enumerate() {
        number[old as usize] = new as u32;
    }
    let members = |&old: &u32| dag.groups[old as usize].members.iter().copied();
    let clusters: Vec<u32> = order.iter().flat_map(members).collect();
    let mut sizes: Vec<ClusterSize> = Vec::with_capacity(clusters.len());
    for window in clusters.chunks(WINDOW) {
        let of_window: Vec<ClusterSize> = window
            .par_iter()
            .map(|&cluster| {
                let part = dag.parts(&[cluster])?;
                let cluster = to_format(grids, &ClusterView::new(&part[0]));
                // The order of the triangles decides how many words they take.
                let cluster = disk_form::canonical(&cluster);
                Ok(ClusterSize::of(&cluster, grids.attributes))
            })
            .collect::<Result<_, BuildError>>()?;
        sizes.extend(of_window);
    }

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
    let mut pages = place(groups, &sizes, roots, grids.attributes);
    pages.dependencies = dependencies(dag, &pages, &number);
    pages.clusters = clusters;
    pages.number = number;
    Ok(pages)
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
            + (disk_form::COLUMNS + 4) * self.clusters
            + 5 * self.triangles.div_ceil(4)
            + self.vertices
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
        number: Vec::new(),
    }
}

/// For each page the pages of the groups that hold what its groups became.
fn dependencies(dag: &Dag, pages: &Pages, number: &[u32]) -> Vec<Vec<u32>> {
    let mut parents: Vec<Vec<u32>> = vec![Vec::new(); pages.groups.len()];
    for (group, placed) in pages.groups.iter().enumerate() {
        for &member in &dag.groups[placed.group as usize].members {
            let child = dag.clusters[member as usize].child_group;
            if child != NO_GROUP {
                parents[number[child as usize] as usize].push(group as u32);
            }
        }
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

/// A cluster as the format stores it, still without its place in the DAG.
pub(super) fn to_format(grids: &Grids, view: &ClusterView) -> Cluster {
    let has = |flag| grids.attributes.has(flag);
    let vertices = view.vertices.iter();
    Cluster {
        positions: vertices.clone().map(|vertex| vertex.position).collect(),
        normals: match has(Attributes::NORMAL) {
            true => vertices.clone().map(|vertex| vertex.normal).collect(),
            false => Vec::new(),
        },
        uvs: match has(Attributes::UV) {
            true => vertices.clone().map(|vertex| vertex.uv).collect(),
            false => Vec::new(),
        },
        colors: match has(Attributes::COLOR) {
            true => vertices.map(|vertex| vertex.color).collect(),
            false => Vec::new(),
        },
        triangles: view
            .triangles
            .iter()
            .map(|&[a, b, c, _]| [a, b, c])
            .collect(),
        materials: view.material_ranges(),
        ..Cluster::default()
    }
}

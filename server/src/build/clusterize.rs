//! Clusterize: triangles to clusters of at most 128 triangles and 256 vertices, as full as that allows.

use lodestream_format::cluster::NO_GROUP;
use lodestream_format::limits::{MAX_CLUSTER_TRIANGLES, MAX_CLUSTER_VERTICES};

use super::centroids::Centroids;
use super::cluster::{self, ClusterInfo, ClusterView, Witness};
use super::split::{Shape, Splitter};
use super::vertex::Vertex;

/// Triangles over vertices; a vertex has one material.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface<'a> {
    pub vertices: &'a [(Vertex, u16)],
    pub place_of: &'a [u32],
    pub place_count: usize,
    pub triangles: &'a [[u32; 3]],
    /// Sorted by triangle.
    pub witnesses: &'a [Witness],
}

/// Clusters in the order they were made.
#[derive(Debug, Default)]
pub(super) struct Clusters {
    pub words: Vec<u32>,
    pub infos: Vec<ClusterInfo>,
}

/// Slots of the table of edges: more than twice the edges of a cluster.
const EDGE_SLOTS: usize = 1024;
const EMPTY: u32 = u32::MAX;

/// Kept between calls: this runs for every group.
#[derive(Debug)]
pub(super) struct Clusterizer {
    splitter: Splitter,
    centroids: Centroids,
    order: Vec<u32>,
    /// Number of the cluster that last used each vertex, and its number there.
    vertex_of: Vec<(u32, u8)>,
    /// Likewise for places.
    place_local: Vec<(u32, u16)>,
    stamp: u32,
    vertices: Vec<Vertex>,
    triangles: Vec<[u8; 4]>,
    border: Vec<[u8; 4]>,
    materials: Vec<[u16; 2]>,
    witnesses: Vec<Witness>,
    edges: Edges,
}

impl Default for Clusterizer {
    fn default() -> Self {
        Self {
            splitter: Splitter::default(),
            centroids: Centroids::default(),
            order: Vec::new(),
            vertex_of: Vec::new(),
            place_local: Vec::new(),
            stamp: 0,
            vertices: Vec::new(),
            triangles: Vec::new(),
            border: Vec::new(),
            materials: Vec::new(),
            witnesses: Vec::new(),
            edges: Edges::new(),
        }
    }
}

impl Clusterizer {
    /// Splits all triangles; `blob` is left for the store to say.
    pub fn clusterize(&mut self, surface: &Surface, level: u8) -> Clusters {
        let mut out = Clusters::default();
        let count = surface.triangles.len();
        if count == 0 {
            return out;
        }
        self.centroids.find(surface);
        self.vertex_of.clear();
        self.vertex_of.resize(surface.vertices.len(), (u32::MAX, 0));
        self.place_local.clear();
        self.place_local.resize(surface.place_count, (u32::MAX, 0));
        self.stamp = 0;
        let mut order = std::mem::take(&mut self.order);
        order.clear();
        order.extend(0..count as u32);
        let parts = parts_of(count, surface.vertices.len());
        let mut splitter = std::mem::take(&mut self.splitter);
        let centroids = std::mem::take(&mut self.centroids);
        let shape = Shape {
            triangles: surface.triangles,
            centroids: &centroids.of,
            vertices: surface.vertices.len(),
        };
        splitter.split(&shape, &mut order, parts, &mut |part| {
            self.take(surface, level, &shape, part, &mut out);
        });
        (self.splitter, self.centroids, self.order) = (splitter, centroids, order);
        out
    }

    /// Makes a cluster of `part`, or two of its halves where it has too many vertices.
    fn take(
        &mut self,
        surface: &Surface,
        level: u8,
        shape: &Shape,
        part: &mut [u32],
        out: &mut Clusters,
    ) {
        if !self.gather(surface, part) {
            let mut halves = Vec::new();
            Splitter::default().split(shape, part, 2, &mut |half| halves.push(half.to_vec()));
            for mut half in halves {
                self.take(surface, level, shape, &mut half, out);
            }
            return;
        }
        let view = ClusterView {
            vertices: &self.vertices,
            triangles: &self.triangles,
            border: &self.border,
            materials: &self.materials,
            witnesses: &self.witnesses,
        };
        let first_word = out.words.len();
        cluster::write(&view, &mut out.words);
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for vertex in &self.vertices {
            for axis in 0..3 {
                low[axis] = low[axis].min(vertex.position[axis]);
                high[axis] = high[axis].max(vertex.position[axis]);
            }
        }
        out.infos.push(ClusterInfo {
            blob: 0,
            first_word: first_word as u32,
            words: (out.words.len() - first_word) as u32,
            triangle_count: self.triangles.len() as u8,
            level,
            child_group: NO_GROUP,
            low,
            high,
        });
    }

    /// Fills the arrays; false where the vertices are too many.
    fn gather(&mut self, surface: &Surface, part: &mut [u32]) -> bool {
        let slot =
            |triangle: u32| surface.vertices[surface.triangles[triangle as usize][0] as usize].1;
        part.sort_by_key(|&triangle| slot(triangle));
        self.stamp += 1;
        self.vertices.clear();
        self.triangles.clear();
        self.border.clear();
        self.materials.clear();
        self.witnesses.clear();
        self.edges.clear();
        let mut places = 0u16;
        let one_material = slot(part[0]) == slot(part[part.len() - 1]);
        for (number, &triangle) in part.iter().enumerate() {
            let mut corners = [0u8; 4];
            let mut at = [0u16; 3];
            for corner in 0..3 {
                let vertex = surface.triangles[triangle as usize][corner];
                let known = &mut self.vertex_of[vertex as usize];
                if known.0 != self.stamp {
                    let value = surface.vertices[vertex as usize].0;
                    // Vertices that differ only in material are one.
                    let same = match one_material {
                        true => None,
                        false => self.vertices.iter().position(|other| *other == value),
                    };
                    let local = same.unwrap_or(self.vertices.len());
                    if local == MAX_CLUSTER_VERTICES {
                        return false;
                    }
                    if same.is_none() {
                        self.vertices.push(value);
                    }
                    *known = (self.stamp, local as u8);
                }
                corners[corner] = known.1;
                let place = &mut self.place_local[surface.place_of[vertex as usize] as usize];
                if place.0 != self.stamp {
                    *place = (self.stamp, places);
                    places += 1;
                }
                at[corner] = place.1;
            }
            self.triangles.push(corners);
            for side in 0..3 {
                let next = (side + 1) % 3;
                self.edges
                    .add([at[side], at[next]], [corners[side], corners[next]]);
            }
            let slot = slot(triangle);
            match self.materials.last_mut() {
                Some(run) if run[0] == slot => run[1] += 1,
                _ => self.materials.push([slot, 1]),
            }
            if surface.witnesses.is_empty() {
                continue;
            }
            let own = surface
                .witnesses
                .partition_point(|witness| witness.triangle < triangle);
            self.witnesses.extend(
                surface.witnesses[own..]
                    .iter()
                    .take_while(|witness| witness.triangle == triangle)
                    .map(|witness| Witness {
                        triangle: number as u32,
                        ..*witness
                    }),
            );
        }
        self.edges.open(&mut self.border);
        true
    }
}

/// Clusters that so many triangles need: fewer triangles a cluster where corners share few vertices.
fn parts_of(triangles: usize, vertices: usize) -> usize {
    let by_vertices = MAX_CLUSTER_VERTICES * triangles / vertices.max(1);
    // Parts differ: what is just full on average would be halved as often as not.
    let most = match by_vertices < MAX_CLUSTER_TRIANGLES {
        true => by_vertices - by_vertices / 24,
        false => MAX_CLUSTER_TRIANGLES,
    };
    triangles.div_ceil(most.clamp(MAX_CLUSTER_VERTICES / 3, MAX_CLUSTER_TRIANGLES))
}

/// Edges of a cluster between places, with the sum of their signs.
#[derive(Debug)]
struct Edges {
    keys: Box<[u32; EDGE_SLOTS]>,
    sums: Box<[i16; EDGE_SLOTS]>,
    /// Vertices at the ends, along the edge.
    ends: Box<[[u8; 2]; EDGE_SLOTS]>,
    used: Vec<u16>,
}

impl Edges {
    fn new() -> Self {
        Self {
            keys: Box::new([EMPTY; EDGE_SLOTS]),
            sums: Box::new([0; EDGE_SLOTS]),
            ends: Box::new([[0; 2]; EDGE_SLOTS]),
            used: Vec::new(),
        }
    }

    fn clear(&mut self) {
        for slot in self.used.drain(..) {
            self.keys[slot as usize] = EMPTY;
        }
    }

    fn add(&mut self, [a, b]: [u16; 2], [from, to]: [u8; 2]) {
        let along = a < b;
        let (low, high) = if along { (a, b) } else { (b, a) };
        let key = (low as u32) << 16 | high as u32;
        let mut slot = (key.wrapping_mul(0x9e37_79b1) >> 22) as usize;
        while self.keys[slot] != key {
            if self.keys[slot] == EMPTY {
                self.keys[slot] = key;
                self.sums[slot] = 0;
                self.ends[slot] = if along { [from, to] } else { [to, from] };
                self.used.push(slot as u16);
                break;
            }
            slot = (slot + 1) % EDGE_SLOTS;
        }
        self.sums[slot] += if along { 1 } else { -1 };
    }

    /// Appends every edge whose sum is not 0, as often as the sum says.
    fn open(&self, border: &mut Vec<[u8; 4]>) {
        for &slot in &self.used {
            let sum = self.sums[slot as usize];
            let [a, b] = self.ends[slot as usize];
            let edge = if sum > 0 { [a, b, 0, 0] } else { [b, a, 0, 0] };
            border.extend(std::iter::repeat_n(edge, sum.unsigned_abs() as usize));
        }
    }
}

//! Scatter: the triangles of a mesh, piece by piece, into buckets that are compact in space and fit the cache.
//!
//! A kd tree over a sample of the centroids says which bucket a triangle belongs to. What a run of source triangles adds
//! to a bucket is a block: its vertices, on the grids, and its triangles over them. Blocks lie in a [`Store`], so the mesh
//! itself may be let go, or may never have been in memory as a whole.

use rayon::prelude::*;

use super::error::BuildError;
use super::packed::pack;
use super::split::ascending;
use super::store::Store;
use super::survey::{Survey, centroid, unreadable};
use super::vertex::{Grids, Vertex};
use crate::import::{Mesh, MeshSource};

/// Triangles of a bucket, about: their vertices and centroids stay in a core's cache.
const BUCKET_TRIANGLES: u64 = 32 * 1024;
/// Triangles that one task takes. Blocks do not share vertices across tasks.
const TASK_TRIANGLES: usize = 256 * 1024;

/// Runs of the store that hold the blocks of each bucket, in the mesh's order.
pub(super) type Buckets = Vec<Vec<u32>>;

/// Puts every triangle of `source` into a bucket.
pub(super) fn scatter(
    source: &impl MeshSource,
    survey: &Survey,
    grids: &Grids,
    store: &mut Store,
) -> Result<Buckets, BuildError> {
    let tree = Tree::new(survey);
    let mut buckets: Buckets = vec![Vec::new(); tree.buckets];
    let mut keep = |blocks: Vec<(u32, Vec<u32>)>| -> Result<(), BuildError> {
        for (bucket, words) in blocks {
            buckets[bucket as usize].push(store.put(words)?);
        }
        Ok(())
    };
    if source.piece_count() == 1 {
        let piece = source.piece(0).map_err(unreadable)?;
        let tasks: Vec<usize> = (0..piece.triangles.len()).step_by(TASK_TRIANGLES).collect();
        // As many at a time as there are threads: what waits for the store is memory.
        for tasks in tasks.chunks(rayon::current_num_threads()) {
            let blocks: Vec<_> = tasks
                .par_iter()
                .map(|&first| {
                    let end = piece.triangles.len().min(first + TASK_TRIANGLES);
                    blocks(&piece, first..end, &tree, grids)
                })
                .collect();
            blocks.into_iter().try_for_each(&mut keep)?;
        }
        return Ok(buckets);
    }
    let pieces: Vec<usize> = (0..source.piece_count()).collect();
    for pieces in pieces.chunks(rayon::current_num_threads()) {
        let blocks: Vec<_> = pieces
            .par_iter()
            .map(|&index| {
                let piece = source.piece(index).map_err(unreadable)?;
                Ok(blocks(&piece, 0..piece.triangles.len(), &tree, grids))
            })
            .collect::<Result<_, BuildError>>()?;
        blocks.into_iter().try_for_each(&mut keep)?;
    }
    Ok(buckets)
}

/// A block read back.
#[derive(Debug)]
pub(super) struct Block<'a> {
    pub vertices: &'a [Vertex],
    pub triangles: &'a [[u32; 3]],
    /// Slot of each triangle; an odd one out at the end.
    pub materials: &'a [u16],
}

const VERTEX_WORDS: usize = size_of::<Vertex>() / 4;
/// Words of a record of each table of a block; two slots are one.
pub(super) const RECORD_WORDS: [usize; 3] = [VERTEX_WORDS, 3, 1];

impl<'a> Block<'a> {
    /// Reads the words of a run.
    pub fn new(words: &'a [u32]) -> Self {
        let (counts, words) = words.split_at(RECORD_WORDS.len());
        let (vertices, words) = words.split_at(counts[0] as usize * VERTEX_WORDS);
        let (triangles, materials) = words.split_at(3 * counts[1] as usize);
        Self {
            vertices: bytemuck::cast_slice(vertices),
            triangles: bytemuck::cast_slice(triangles),
            materials: bytemuck::cast_slice(materials),
        }
    }
}

/// Blocks of some triangles of a piece, with their buckets, ascending.
fn blocks(
    piece: &Mesh,
    range: std::ops::Range<usize>,
    tree: &Tree,
    grids: &Grids,
) -> Vec<(u32, Vec<u32>)> {
    const NOBODY: u32 = u32::MAX;
    let first = range.start;
    let bucket_of: Vec<u32> = piece.triangles[range.clone()]
        .iter()
        .map(|corners| {
            let corners = corners.map(|index| piece.positions[index as usize]);
            tree.bucket(centroid(&corners))
        })
        .collect();
    let mut starts = vec![0u32; tree.buckets + 1];
    bucket_of
        .iter()
        .for_each(|&bucket| starts[bucket as usize + 1] += 1);
    for bucket in 0..tree.buckets {
        starts[bucket + 1] += starts[bucket];
    }
    let mut order = vec![0u32; bucket_of.len()];
    let mut next = starts.clone();
    for (index, &bucket) in bucket_of.iter().enumerate() {
        let at = &mut next[bucket as usize];
        order[*at as usize] = index as u32;
        *at += 1;
    }
    // Bucket that last used each vertex, and its number in that block.
    let (low, high) = piece.triangles[range]
        .iter()
        .flatten()
        .fold((u32::MAX, 0), |(low, high), &index| {
            (low.min(index), high.max(index))
        });
    let mut known = vec![(NOBODY, 0u32); (high as usize + 1).saturating_sub(low as usize)];
    let mut out = Vec::new();
    let mut vertices: Vec<Vertex> = Vec::new();
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    let mut materials: Vec<u16> = Vec::new();
    let (mut words, mut bytes): (Vec<u32>, Vec<u8>) = Default::default();
    for bucket in 0..tree.buckets as u32 {
        let own = starts[bucket as usize] as usize..starts[bucket as usize + 1] as usize;
        if own.is_empty() {
            continue;
        }
        vertices.clear();
        triangles.clear();
        materials.clear();
        for &index in &order[own] {
            let source = first + index as usize;
            triangles.push(piece.triangles[source].map(|vertex| {
                let known = &mut known[(vertex - low) as usize];
                if known.0 != bucket {
                    *known = (bucket, vertices.len() as u32);
                    vertices.push(grids.vertex(piece, vertex as usize));
                }
                known.1
            }));
            materials.push(piece.triangle_materials[source]);
        }
        if materials.len() % 2 == 1 {
            materials.push(0);
        }
        let counts = [vertices.len(), triangles.len(), materials.len() / 2];
        words.clear();
        words.extend(counts.map(|count| count as u32));
        words.extend_from_slice(bytemuck::cast_slice(&vertices));
        words.extend_from_slice(bytemuck::cast_slice(&triangles));
        let pairs = materials.as_chunks::<2>().0.iter();
        words.extend(pairs.map(|&pair| bytemuck::cast::<_, u32>(pair)));
        let mut packed = Vec::new();
        pack(&words, RECORD_WORDS, &mut bytes, &mut packed);
        out.push((bucket, packed));
    }
    out
}

/// Splits of space, root first; each node's children stand at twice its number and one more.
struct Tree {
    /// Axis and the smallest coordinate of the upper side; node 0 is not used.
    splits: Vec<(u8, f32)>,
    buckets: usize,
}

impl Tree {
    fn new(survey: &Survey) -> Self {
        let mut buckets = 1usize;
        while (buckets as u64) * BUCKET_TRIANGLES < survey.triangles {
            buckets *= 2;
        }
        let mut tree = Self {
            splits: vec![(0, f32::MAX); buckets],
            buckets,
        };
        let mut order: Vec<u32> = (0..survey.centroids.len() as u32).collect();
        tree.split(1, &survey.centroids, &mut order);
        tree
    }

    fn split(&mut self, node: usize, centroids: &[[f32; 3]], order: &mut [u32]) {
        if node >= self.buckets || order.is_empty() {
            return;
        }
        let axis = longest_side(centroids, order);
        let key = |&index: &u32| (ascending(centroids[index as usize][axis]), index);
        let middle = order.len() / 2;
        order.select_nth_unstable_by_key(middle, key);
        self.splits[node] = (axis as u8, centroids[order[middle] as usize][axis]);
        let (lower, upper) = order.split_at_mut(middle);
        self.split(2 * node, centroids, lower);
        self.split(2 * node + 1, centroids, upper);
    }

    fn bucket(&self, centroid: [f32; 3]) -> u32 {
        let mut node = 1;
        while node < self.buckets {
            let (axis, from) = self.splits[node];
            node = 2 * node + usize::from(centroid[axis as usize] >= from);
        }
        (node - self.buckets) as u32
    }
}
/// The axis along which the centroids reach farthest.
fn longest_side(centroids: &[[f32; 3]], order: &[u32]) -> usize {
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for &index in order {
        for axis in 0..3 {
            low[axis] = low[axis].min(centroids[index as usize][axis]);
            high[axis] = high[axis].max(centroids[index as usize][axis]);
        }
    }
    let side = |axis: usize| high[axis] - low[axis];
    (1..3).fold(
        0,
        |best, axis| if side(axis) > side(best) { axis } else { best },
    )
}

//! Leaves: the source triangles of each bucket, welded, as clusters.

use rayon::prelude::*;

use super::clusterize::{Clusterizer, Surface};
use super::error::BuildError;
use super::packed::{Packed, unpack};
use super::scatter::{self, Block, Buckets};
use super::store::Store;
use super::vertex::{Vertex, Welder};

/// Clusters of every bucket in order, and the triangles that had two corners at one place.
pub(super) fn leaves(
    buckets: &Buckets,
    blocks: &mut Store,
    mut keep: impl FnMut(Packed) -> Result<(), BuildError>,
) -> Result<u64, BuildError> {
    let mut collapsed = 0;
    let (mut any, mut first) = (false, None);
    for buckets in buckets.chunks(2 * rayon::current_num_threads()) {
        let made: Vec<Made> = buckets
            .par_iter()
            .map_init(Workspace::default, |workspace, runs| {
                workspace.bucket(runs, blocks)
            })
            .collect::<Result<_, _>>()?;
        for made in made {
            collapsed += made.collapsed;
            first = first.or(made.first_collapsed);
            if !made.clusters.infos.is_empty() {
                any = true;
                keep(made.clusters)?;
            }
        }
        buckets.iter().flatten().for_each(|&run| blocks.forget(run));
    }
    if let (false, Some((vertices, slot))) = (any, first) {
        // An asset has at least one triangle, with or without area.
        let surface = Surface {
            vertices: &vertices.map(|vertex| (vertex, slot)),
            place_of: &[0, 1, 2],
            place_count: 3,
            triangles: &[[0, 1, 2]],
            witnesses: &[],
        };
        keep(Packed::new(&Clusterizer::default().clusterize(&surface, 0)))?;
    }
    Ok(collapsed)
}

/// What a bucket became.
struct Made {
    clusters: Packed,
    /// Triangles with two corners at one place, left out.
    collapsed: u64,
    first_collapsed: Option<([Vertex; 3], u16)>,
}

/// Kept between buckets.
#[derive(Default)]
struct Workspace {
    welder: Welder,
    numbers: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    clusterizer: Clusterizer,
}

const UNSEEN: u32 = u32::MAX;

impl Workspace {
    fn bucket(&mut self, runs: &[u32], blocks: &Store) -> Result<Made, BuildError> {
        let runs: Vec<_> = runs
            .iter()
            .map(|&run| Ok(unpack(&blocks.get(run)?, scatter::RECORD_WORDS)))
            .collect::<Result<_, BuildError>>()?;
        let count = runs.iter().map(|words| Block::new(words).vertices.len());
        self.welder.clear(count.sum());
        self.triangles.clear();
        let (mut collapsed, mut first_collapsed) = (0, None);
        for words in &runs {
            let block = Block::new(words);
            self.numbers.clear();
            self.numbers.resize(block.vertices.len(), UNSEEN);
            // By material, so that a number holds for a run of triangles.
            let mut order: Vec<u32> = (0..block.triangles.len() as u32).collect();
            order.sort_by_key(|&triangle| block.materials[triangle as usize]);
            let mut current = block.materials.first().copied();
            for triangle in order {
                let corners = block.triangles[triangle as usize];
                let slot = block.materials[triangle as usize];
                let [a, b, c] = corners.map(|index| block.vertices[index as usize].position);
                if a == b || b == c || c == a {
                    collapsed += 1;
                    let vertices = || corners.map(|index| block.vertices[index as usize]);
                    first_collapsed.get_or_insert_with(|| (vertices(), slot));
                    continue;
                }
                if current != Some(slot) {
                    current = Some(slot);
                    self.numbers.fill(UNSEEN);
                }
                self.triangles.push(corners.map(|index| {
                    let number = &mut self.numbers[index as usize];
                    if *number == UNSEEN {
                        *number = self.welder.number(&block.vertices[index as usize], slot);
                    }
                    *number
                }));
            }
        }
        let surface = Surface {
            vertices: &self.welder.vertices,
            place_of: &self.welder.place_of,
            place_count: self.welder.place_count(),
            triangles: &self.triangles,
            witnesses: &[],
        };
        Ok(Made {
            clusters: Packed::new(&self.clusterizer.clusterize(&surface, 0)),
            collapsed,
            first_collapsed,
        })
    }
}

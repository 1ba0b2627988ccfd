//! Rims: the vertices of a mesh that other instances may share, and its open edges among them.

use std::collections::HashMap;

use foldhash::fast::RandomState;

use super::meetings::Meeting;
use crate::import::{ImportError, MeshSource};

/// Vertices of a mesh inside its meeting boxes.
#[derive(Debug, Default)]
pub(super) struct Rim {
    /// Object space; equal ones once.
    pub positions: Vec<[f32; 3]>,
    /// Open edges, as indices into `positions`, the smaller first. Ascending.
    pub edges: Vec<OpenEdge>,
    /// Whether each of `positions` lies on an open edge.
    pub is_open: Vec<bool>,
}

/// An edge with a triangle on one side only.
#[derive(Debug, Clone, Copy)]
pub(super) struct OpenEdge {
    pub ends: [u32; 2],
    /// Third corner of its triangle, object space.
    pub third: [f32; 3],
}

impl Rim {
    /// Collects the vertices of `mesh` inside `meeting`. `None` where they are more than `most`.
    pub(super) fn new(
        mesh: &dyn MeshSource,
        meeting: &Meeting,
        most: usize,
    ) -> Result<Option<Self>, ImportError> {
        let mut rim = Self::default();
        if meeting.is_empty() {
            return Ok(Some(rim));
        }
        let mut number_of: HashMap<[u32; 3], u32, RandomState> = HashMap::default();
        // Sum of the directions in which triangles take the edge, and a third corner.
        let mut sums: HashMap<[u32; 2], (i32, [f32; 3]), RandomState> = HashMap::default();
        for index in 0..mesh.piece_count() {
            let piece = mesh.piece(index)?;
            const OUTSIDE: u32 = u32::MAX;
            let mut number = |position: [f32; 3]| -> u32 {
                if !meeting.holds(position) {
                    return OUTSIDE;
                }
                // Both zeros are one place.
                let key = position.map(|value| (value + 0.0).to_bits());
                *number_of.entry(key).or_insert_with(|| {
                    rim.positions.push(position);
                    rim.positions.len() as u32 - 1
                })
            };
            let numbers: Vec<u32> = piece.positions.iter().map(|&at| number(at)).collect();
            for corners in &piece.triangles {
                let ends = corners.map(|corner| numbers[corner as usize]);
                for side in 0..3 {
                    let (from, to) = (ends[side], ends[(side + 1) % 3]);
                    if from == to || from == OUTSIDE || to == OUTSIDE {
                        continue;
                    }
                    let third = piece.positions[corners[(side + 2) % 3] as usize];
                    let sum = sums.entry([from.min(to), from.max(to)]);
                    let sum = sum.or_insert((0, third));
                    sum.0 += if from < to { 1 } else { -1 };
                }
            }
            if rim.positions.len() > most || sums.len() > 3 * most {
                return Ok(None);
            }
        }
        let open = sums.into_iter().filter(|&(_, (sum, _))| sum != 0);
        rim.edges = open
            .map(|(ends, (_, third))| OpenEdge { ends, third })
            .collect();
        rim.edges.sort_unstable_by_key(|edge| edge.ends);
        rim.is_open = vec![false; rim.positions.len()];
        for end in rim.edges.iter().flat_map(|edge| edge.ends) {
            rim.is_open[end as usize] = true;
        }
        Ok(Some(rim))
    }

    /// The open edge between two vertices.
    pub(super) fn edge(&self, a: u32, b: u32) -> Option<&OpenEdge> {
        let ends = [a.min(b), a.max(b)];
        let place = self.edges.binary_search_by_key(&ends, |edge| edge.ends);
        place.ok().map(|place| &self.edges[place])
    }
}

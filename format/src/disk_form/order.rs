//! The order of a cluster's triangles and vertices in a page: that of the steps around its open edges (see `topology`).

use super::ring::{Gate, Ring};
use crate::cluster::Cluster;

/// Number of a vertex that no triangle has had.
const UNSEEN: u16 = u16::MAX;
/// No corner.
const NONE: u16 = u16::MAX;

/// The same cluster with its triangles in the order of the steps, each run of one material by itself, and its vertices as
/// they come; those that no triangle has are gone.
pub fn canonical(cluster: &Cluster) -> Cluster {
    let mut number = [UNSEEN; 256];
    let mut order: Vec<u8> = Vec::with_capacity(cluster.positions.len());
    let mut triangles: Vec<[u8; 3]> = Vec::with_capacity(cluster.triangles.len());
    let mut ring = Ring::default();
    let mut gate: Option<Gate> = None;
    let mut first = 0;
    for range in &cluster.materials {
        let own = &cluster.triangles[first..first + range.triangle_count as usize];
        first += own.len();
        let mut run = Run::new(own);
        for _ in 0..own.len() {
            // An edge that only another run's triangle lies beyond counts as border.
            let mut beyond = None;
            while let Some(edge) = gate {
                beyond = run.beyond(edge, &order);
                if beyond.is_some() {
                    break;
                }
                gate = ring.border(edge);
            }
            let (index, turn) = beyond.unwrap_or_else(|| {
                let index = run.most_known(&number);
                (index, new_last(own[index], &number))
            });
            run.take(index);
            let mut corners = own[index];
            corners.rotate_left(turn);
            let is_new = number[corners[2] as usize] == UNSEEN;
            let triangle = corners.map(|vertex| {
                let own = &mut number[vertex as usize];
                if *own == UNSEEN {
                    *own = order.len() as u16;
                    order.push(vertex);
                }
                *own as u8
            });
            let third = triangle[2];
            gate = match gate {
                None => Some(ring.begin(triangle)),
                Some(edge) if is_new => Some(ring.corner(edge, third)),
                Some(edge) if ring.third_before(edge) == Some(third) => ring.before(edge),
                Some(edge) if ring.third_after(edge) == Some(third) => ring.after(edge),
                Some(edge) => Some(ring.corner(edge, third)),
            };
            triangles.push(triangle);
        }
    }
    fn picked<T: Copy>(order: &[u8], from: &[T]) -> Vec<T> {
        let some = if from.is_empty() { &[] } else { order };
        some.iter().map(|&vertex| from[vertex as usize]).collect()
    }
    Cluster {
        positions: picked(&order, &cluster.positions),
        normals: picked(&order, &cluster.normals),
        uvs: picked(&order, &cluster.uvs),
        colors: picked(&order, &cluster.colors),
        triangles,
        materials: cluster.materials.clone(),
        level: cluster.level,
        group: cluster.group,
        child_group: cluster.child_group,
    }
}

/// How far a triangle has to turn so that its new corners are the last: strips list no vertex of those.
fn new_last(triangle: [u8; 3], number: &[u16; 256]) -> usize {
    let is_new = triangle.map(|vertex| number[vertex as usize] == UNSEEN);
    (0..3)
        .find(|turn| !is_new[*turn] && is_new[(turn + 2) % 3])
        .unwrap_or(0)
}

/// Triangles of one material that are put in order.
struct Run<'a> {
    triangles: &'a [[u8; 3]],
    left: [bool; 256],
    /// First corner at each vertex and the next of each, ascending; corner = 3 triangle + turn.
    first: [u16; 256],
    next: Vec<u16>,
    /// The vertex after each corner's.
    after: Vec<u8>,
}

impl<'a> Run<'a> {
    fn new(triangles: &'a [[u8; 3]]) -> Self {
        let mut first = [NONE; 256];
        let mut next = vec![NONE; 3 * triangles.len()];
        for (corner, &vertex) in triangles.as_flattened().iter().enumerate().rev() {
            next[corner] = std::mem::replace(&mut first[vertex as usize], corner as u16);
        }
        let after = triangles.iter().flat_map(|&[a, b, c]| [b, c, a]).collect();
        Self {
            triangles,
            left: [true; 256],
            first,
            next,
            after,
        }
    }

    /// The first triangle left beyond an edge, and how far it has to turn to begin with it.
    fn beyond(&self, gate: Gate, order: &[u8]) -> Option<(usize, usize)> {
        let [from, to, _] = gate.edge();
        let [from, to] = [from, to].map(|vertex| order[vertex as usize]);
        let mut corner = self.first[from as usize];
        while corner != NONE {
            let own = corner as usize;
            if self.after[own] == to && self.left[own / 3] {
                return Some((own / 3, own % 3));
            }
            corner = self.next[own];
        }
        None
    }

    fn take(&mut self, index: usize) {
        self.left[index] = false;
    }

    /// The triangle that is left with the most known corners, the first of those.
    fn most_known(&self, number: &[u16; 256]) -> usize {
        let known = |triangle: &[u8; 3]| {
            let seen = |vertex: &&u8| number[**vertex as usize] != UNSEEN;
            triangle.iter().filter(seen).count()
        };
        let left = (0..self.triangles.len()).filter(|&index| self.left[index]);
        let most = left
            .rev()
            .max_by_key(|&index| known(&self.triangles[index]));
        most.unwrap_or(0)
    }
}

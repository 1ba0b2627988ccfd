//! Pairs: which vertex of one place takes the corners of which vertex of another, so that seams stay seams.

use super::collapse::{Collapser, Freedom, NONE};
use super::group::GroupMesh;
use super::quadric::sum;

/// Most vertices of a place that are told apart.
const MOST_WEDGES: usize = 16;

/// Pairs of vertices, one to go and one to take its corners, and how many there are.
pub(super) type Pairs = ([[u16; 2]; MOST_WEDGES], usize);

impl<const L: usize> Collapser<L> {
    /// The vertex of `to` in some triangle that it shares with `from`.
    pub(super) fn partner(&self, from: u16, to: u16) -> Option<u16> {
        self.star(from).find_map(|(triangle, _)| {
            let vertices = self.triangle(triangle);
            vertices
                .into_iter()
                .find(|&vertex| self.place(vertex) == to)
        })
    }

    /// For every vertex of `from` the one of `to` that takes its corners: of the triangle that both share, else the nearest
    /// one in attributes on the same side of all seams, else, where seams are released, of the same material.
    pub(super) fn pairs(
        &self,
        mesh: &GroupMesh,
        from: u16,
        to: u16,
        freedom: Freedom,
    ) -> Option<Pairs> {
        let mut pairs = [[NONE; 2]; MOST_WEDGES];
        let alone = [from, to].map(|place| self.only[place as usize]);
        if !alone.contains(&NONE) {
            pairs[0] = alone;
            return Some((pairs, 1));
        }
        let mut count = 0;
        for (triangle, k) in self.star(from) {
            let vertices = self.corners[triangle];
            let shared = (1..3)
                .map(|step| vertices[(k + step) % 3])
                .find(|&vertex| self.place(vertex) == to);
            let Some(target) = shared else { continue };
            let own = vertices[k];
            match pairs[..count].iter().find(|pair| pair[0] == own) {
                // The same vertex here, two there: a seam begins at this place.
                Some(pair) => {
                    if freedom == Freedom::Kept && seam(mesh, pair[1], target) {
                        return None;
                    }
                }
                None if count == MOST_WEDGES => return None,
                None => {
                    pairs[count] = [own, target];
                    count += 1;
                }
            }
        }
        if count == 0 {
            return None;
        }
        let sharing = count;
        let first = self.first_vertex(mesh, from);
        let mut vertex = first;
        loop {
            let used = self.uses[vertex as usize] > 0;
            if used && !pairs[..count].iter().any(|pair| pair[0] == vertex) {
                if count == MOST_WEDGES {
                    return None;
                }
                let beside = pairs[..sharing]
                    .iter()
                    .find(|pair| !seam(mesh, pair[0], vertex));
                let target = match beside {
                    Some(pair) => {
                        self.nearest_vertex(mesh, vertex, to, |other| !seam(mesh, other, pair[1]))
                    }
                    None if freedom == Freedom::Kept => None,
                    None => {
                        let slot = |vertex: u16| mesh.welder.vertices[vertex as usize].1;
                        self.nearest_vertex(mesh, vertex, to, |other| slot(other) == slot(vertex))
                    }
                };
                pairs[count] = [vertex, target?];
                count += 1;
            }
            vertex = self.ring[vertex as usize];
            if vertex == first {
                return Some((pairs, count));
            }
        }
    }

    /// The vertex of `to`, of those that are `fit`, whose attributes are nearest.
    fn nearest_vertex(
        &self,
        mesh: &GroupMesh,
        own: u16,
        to: u16,
        fit: impl Fn(u16) -> bool,
    ) -> Option<u16> {
        let first = self.first_vertex(mesh, to);
        let mut best = None;
        let mut vertex = first;
        loop {
            if fit(vertex) {
                let away: f32 = match L {
                    0 => 0.0,
                    _ => sum(self
                        .change(own, vertex)
                        .iter()
                        .map(|four| four * four)
                        .sum()),
                };
                if best.is_none_or(|(least, _)| away < least) {
                    best = Some((away, vertex));
                }
            }
            vertex = self.ring[vertex as usize];
            if vertex == first {
                return best.map(|(_, vertex)| vertex);
            }
        }
    }
}

/// Whether two vertices of one place lie on different sides of a seam of texture coordinates or materials. Normals and
/// colours that differ are no seam: crossing costs what they differ by.
pub(super) fn seam(mesh: &GroupMesh, a: u16, b: u16) -> bool {
    let [a, b] = [a, b].map(|vertex| &mesh.welder.vertices[vertex as usize]);
    a.0.uv != b.0.uv || a.1 != b.1
}

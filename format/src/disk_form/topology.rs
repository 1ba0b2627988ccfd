//! Topology: a cluster's triangles as steps around its open edges (after Rossignac, "Edgebreaker: connectivity compression for
//! triangle meshes", 1999, with clusters' borders as a step of their own and a vertex number where a step would split the ring).
//!
//! The open edges lie in a ring, in the order of the border that they make; one of them is the gate. A step says what lies beyond the
//! gate: a triangle with a new vertex, with the vertex that the edge before the gate comes from, with the one that the edge
//! after it leads to, with any other vertex (an extra byte: how many come between it and the newest), or nothing. When no edge is
//! open the next triangle begins anew: an extra byte with a bit for each corner that is new, and one for each that is not.
//! Vertices are numbered as they come.

use super::digits::{DigitReader, DigitWriter};
use crate::limits::MAX_CLUSTER_TRIANGLES;

/// Beginning and end of an edge as the triangle beyond it has them, and the third corner on this side.
pub(super) type Edge = [u8; 3];

/// What lies beyond the gate.
pub(super) mod step {
    /// A triangle with the next vertex.
    pub const NEW: u8 = 0;
    /// A triangle with the vertex that the edge before the gate comes from.
    pub const BEFORE: u8 = 1;
    /// A triangle with the vertex that the edge after the gate leads to.
    pub const AFTER: u8 = 2;
    /// No triangle.
    pub const BORDER: u8 = 3;
    /// A triangle with the vertex that an extra byte names.
    pub const FAR: u8 = 4;
}

/// Steps, three to a byte.
pub(super) type StepWriter = DigitWriter<5>;
/// Reads them.
pub(super) type StepReader<'a> = DigitReader<'a, 5>;

/// No edge.
const NONE: u8 = u8::MAX;
/// Edges of one ring over time: three of its first triangle, one more with each other.
const MOST_EDGES: usize = MAX_CLUSTER_TRIANGLES + 2;

/// An edge of the ring, and its neighbours there.
#[derive(Debug, Clone, Copy, Default)]
struct Open {
    from: u8,
    to: u8,
    opposite: u8,
    before: u8,
    after: u8,
}

impl Open {
    fn new([from, to, opposite]: Edge, before: u8, after: u8) -> Self {
        Self {
            from,
            to,
            opposite,
            before,
            after,
        }
    }
}

/// The open edges.
#[derive(Debug)]
pub(super) struct Ring {
    edges: [Open; MOST_EDGES],
    count: u8,
    gate: u8,
}

impl Default for Ring {
    fn default() -> Self {
        Self {
            edges: [Open::default(); MOST_EDGES],
            count: 0,
            gate: NONE,
        }
    }
}

impl Ring {
    fn at(&self, edge: u8) -> Open {
        self.edges[edge as usize]
    }

    /// The edge that the next step is about; `None` where the next triangle begins anew.
    #[inline]
    pub fn gate(&self) -> Option<Edge> {
        (self.gate != NONE).then(|| {
            let gate = self.at(self.gate);
            [gate.from, gate.to, gate.opposite]
        })
    }

    /// Where the edge before the gate comes from, if the two meet.
    #[inline]
    pub fn third_before(&self) -> Option<u8> {
        let gate = self.at(self.gate);
        let before = self.at(gate.before);
        (gate.before != self.gate && before.to == gate.from).then_some(before.from)
    }

    /// Where the edge after the gate leads to, if the two meet.
    #[inline]
    pub fn third_after(&self) -> Option<u8> {
        let gate = self.at(self.gate);
        let after = self.at(gate.after);
        (gate.after != self.gate && after.from == gate.to).then_some(after.to)
    }

    /// The first triangle of a ring. None may be open.
    pub fn begin(&mut self, [a, b, c]: [u8; 3]) {
        self.edges[0] = Open::new([b, a, c], 2, 1);
        self.edges[1] = Open::new([a, c, b], 0, 2);
        self.edges[2] = Open::new([c, b, a], 1, 0);
        (self.count, self.gate) = (3, 2);
    }

    /// Nothing beyond the gate.
    #[inline]
    pub fn border(&mut self) {
        let gate = self.gate;
        self.gate = match self.at(gate).after {
            after if after == gate => NONE,
            after => after,
        };
        self.unlink(gate);
    }

    /// A triangle whose third corner is [`Self::third_before`].
    #[inline]
    pub fn before(&mut self) {
        let Open { from, before, .. } = self.at(self.gate);
        let third = self.at(before).from;
        self.unlink(before);
        let gate = &mut self.edges[self.gate as usize];
        (gate.from, gate.opposite) = (third, from);
        self.fold(self.gate);
    }

    /// A triangle whose third corner is [`Self::third_after`].
    #[inline]
    pub fn after(&mut self) {
        let Open { to, after, .. } = self.at(self.gate);
        let third = self.at(after).to;
        self.unlink(after);
        let gate = &mut self.edges[self.gate as usize];
        (gate.to, gate.opposite) = (third, to);
        self.fold(self.gate);
    }

    /// A triangle with a vertex that no open edge has: its edge from there on is the gate.
    #[inline]
    pub fn new_corner(&mut self, third: u8) {
        let gate = self.gate;
        let Open {
            from, to, before, ..
        } = self.at(gate);
        let left = self.count;
        self.count += 1;
        self.edges[left as usize] = Open::new([from, third, to], before, gate);
        self.edges[before as usize].after = left;
        let own = &mut self.edges[gate as usize];
        (own.from, own.opposite, own.before) = (third, from, left);
    }

    /// A triangle with any vertex: the same, but its edges may meet their like.
    pub fn far_corner(&mut self, third: u8) {
        let (gate, left) = (self.gate, self.count);
        self.new_corner(third);
        self.fold(left);
        if self.gate == gate {
            self.fold(gate);
        }
    }

    fn unlink(&mut self, edge: u8) {
        let Open { before, after, .. } = self.at(edge);
        self.edges[before as usize].after = after;
        self.edges[after as usize].before = before;
    }

    /// Closes an edge against the one after or before it, where that is the same edge from the other side.
    #[inline]
    fn fold(&mut self, edge: u8) {
        let Open {
            from,
            to,
            before,
            after,
            ..
        } = self.at(edge);
        for other in [after, before] {
            let beside = self.at(other);
            if other == edge || beside.from != to || beside.to != from {
                continue;
            }
            let next = match after == other {
                true => beside.after,
                false => after,
            };
            self.unlink(other);
            self.unlink(edge);
            if self.gate == edge || self.gate == other {
                let is_last = next == edge || next == other;
                self.gate = if is_last { NONE } else { next };
            }
            return;
        }
    }
}

/// What comes out, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Event {
    /// The next vertex, beyond an edge or at a beginning.
    Vertex(Option<Edge>),
    Triangle([u8; 3]),
}

/// Vertices so far.
#[derive(Debug, Default)]
struct Numbers(usize);

impl Numbers {
    #[inline]
    fn next(&mut self) -> Result<u8, &'static str> {
        self.0 += 1;
        u8::try_from(self.0 - 1).map_err(|_| "more than 256 vertices")
    }

    fn far(&self, back: u8) -> Result<u8, &'static str> {
        let vertex = self.0.checked_sub(back as usize + 1);
        vertex
            .map(|vertex| vertex as u8)
            .ok_or("an extra byte that names no vertex")
    }
}

/// Reads a cluster's triangles; gives the number of its vertices, or what is wrong. `each` may refuse.
#[inline]
pub(super) fn decode(
    steps: &mut StepReader<'_>,
    extra: &mut std::slice::Iter<'_, u8>,
    triangles: u32,
    mut each: impl FnMut(Event) -> Result<(), &'static str>,
) -> Result<usize, &'static str> {
    let mut ring = Ring::default();
    let mut numbers = Numbers::default();
    let mut far = || {
        extra
            .next()
            .copied()
            .ok_or("more extra bytes than there are")
    };
    let mut left = triangles;
    while left > 0 {
        let Some(gate) = ring.gate() else {
            let new = far()?;
            if new > 7 {
                return Err("a beginning with spare bits");
            }
            let mut triangle = [0; 3];
            for (corner, vertex) in triangle.iter_mut().enumerate() {
                *vertex = if new >> corner & 1 == 1 {
                    each(Event::Vertex(None))?;
                    numbers.next()?
                } else {
                    numbers.far(far()?)?
                };
            }
            ring.begin(triangle);
            each(Event::Triangle(triangle))?;
            left -= 1;
            continue;
        };
        let third = match steps.next()? {
            step::NEW => {
                each(Event::Vertex(Some(gate)))?;
                let third = numbers.next()?;
                ring.new_corner(third);
                third
            }
            step::BEFORE => {
                let third = ring.third_before().ok_or("a gate that no edge leads to")?;
                ring.before();
                third
            }
            step::AFTER => {
                let third = ring.third_after().ok_or("a gate that no edge follows")?;
                ring.after();
                third
            }
            step::FAR => {
                let third = numbers.far(far()?)?;
                ring.far_corner(third);
                third
            }
            _ => {
                ring.border();
                continue;
            }
        };
        each(Event::Triangle([gate[0], gate[1], third]))?;
        left -= 1;
    }
    Ok(numbers.0)
}

/// Writes triangles over vertices numbered as they come; gives the edge beyond which each vertex lies, where there is one.
pub(super) fn encode(
    triangles: &[[u8; 3]],
    steps: &mut StepWriter,
    extra: &mut Vec<u8>,
) -> Vec<Option<Edge>> {
    let mut ring = Ring::default();
    let mut beyond: Vec<Option<Edge>> = Vec::with_capacity(256);
    for &triangle in triangles {
        while ring.gate().is_some_and(|gate| gate[..2] != triangle[..2]) {
            steps.push(step::BORDER);
            ring.border();
        }
        let Some(gate) = ring.gate() else {
            let at = extra.len();
            extra.push(0);
            for (corner, &vertex) in triangle.iter().enumerate() {
                if vertex as usize == beyond.len() {
                    beyond.push(None);
                    extra[at] |= 1 << corner;
                } else {
                    extra.push((beyond.len() - 1) as u8 - vertex);
                }
            }
            ring.begin(triangle);
            continue;
        };
        let third = triangle[2];
        if third as usize == beyond.len() {
            beyond.push(Some(gate));
            steps.push(step::NEW);
            ring.new_corner(third);
        } else if ring.third_before() == Some(third) {
            steps.push(step::BEFORE);
            ring.before();
        } else if ring.third_after() == Some(third) {
            steps.push(step::AFTER);
            ring.after();
        } else {
            steps.push(step::FAR);
            extra.push((beyond.len() - 1) as u8 - third);
            ring.far_corner(third);
        }
    }
    beyond
}

#[cfg(test)]
mod tests {
    use super::super::order::canonical;
    use super::*;
    use crate::cluster::{Cluster, MaterialRange};
    use proptest::prelude::*;

    fn cluster(vertices: usize, triangles: Vec<[u8; 3]>) -> Cluster {
        Cluster {
            positions: (0..vertices as i32).map(|vertex| [vertex, 0, 0]).collect(),
            materials: vec![MaterialRange {
                slot: 0,
                triangle_count: triangles.len() as u16,
            }],
            triangles,
            ..Cluster::default()
        }
    }

    /// Triangles by the positions of their corners, turned so that equal ones look equal, sorted.
    fn surface(cluster: &Cluster) -> Vec<[i32; 3]> {
        let turned = |triangle: &[u8; 3]| {
            let mut corners = triangle.map(|vertex| cluster.positions[vertex as usize][0]);
            let turn = (0..3).min_by_key(|&turn| {
                [
                    corners[turn],
                    corners[(turn + 1) % 3],
                    corners[(turn + 2) % 3],
                ]
            });
            corners.rotate_left(turn.unwrap_or(0));
            corners
        };
        let mut all: Vec<_> = cluster.triangles.iter().map(turned).collect();
        all.sort_unstable();
        all
    }

    fn comes_back(ordered: &Cluster) {
        let (mut steps, mut extra) = (StepWriter::default(), Vec::new());
        let expected = encode(&ordered.triangles, &mut steps, &mut extra);
        let (mut read, mut beyond) = (Vec::new(), Vec::new());
        let (mut reader, mut bytes) = (StepReader::new(&steps.bytes), extra.iter());
        let count = ordered.triangles.len() as u32;
        let vertices = decode(&mut reader, &mut bytes, count, |event| {
            match event {
                Event::Triangle(triangle) => read.push(triangle),
                Event::Vertex(edge) => beyond.push(edge),
            }
            Ok(())
        });
        assert_eq!(vertices, Ok(ordered.positions.len()));
        assert_eq!((reader.finish(), bytes.len()), (Ok(()), 0));
        assert_eq!(read, ordered.triangles);
        assert_eq!(beyond, expected);
    }

    proptest! {
        #[test]
        fn any_triangles_come_back(
            vertices in 1usize..=256,
            triangles in prop::collection::vec(any::<[u8; 3]>(), 1..=128),
        ) {
            let within = |triangle: [u8; 3]| triangle.map(|vertex| (vertex as usize % vertices) as u8);
            let before = cluster(vertices, triangles.into_iter().map(within).collect());
            let ordered = canonical(&before);
            prop_assert_eq!(surface(&ordered), surface(&before));
            comes_back(&ordered);
        }

        /// Few vertices: closed pieces, edges of many triangles, both sides of one.
        #[test]
        fn crowded_triangles_come_back(
            triangles in prop::collection::vec(prop::array::uniform3(0u8..7), 1..=128),
        ) {
            let before = cluster(7, triangles);
            let ordered = canonical(&before);
            prop_assert_eq!(surface(&ordered), surface(&before));
            comes_back(&ordered);
        }
    }

    #[test]
    fn a_sheet_begins_once_and_names_no_vertex() {
        let triangles = (0..64u8).flat_map(|square| {
            let a = square / 8 * 9 + square % 8;
            [[a, a + 1, a + 10], [a, a + 10, a + 9]]
        });
        let ordered = canonical(&cluster(81, triangles.collect()));
        let (mut steps, mut extra) = (StepWriter::default(), Vec::new());
        encode(&ordered.triangles, &mut steps, &mut extra);
        assert!(steps.bytes.len() < 160 / 3, "{} bytes", steps.bytes.len());
        assert!(extra.len() < 6, "{extra:?}");
        comes_back(&ordered);
    }

    #[test]
    fn a_closed_piece_leaves_no_edge_open() {
        let tetrahedron = vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        let mut ring = Ring::default();
        let ordered = canonical(&cluster(4, tetrahedron));
        ring.begin(ordered.triangles[0]);
        for triangle in &ordered.triangles[1..] {
            let third = triangle[2];
            match () {
                () if third == 3 && triangle[..2] != [0, 0] && ring.count == 3 => {
                    ring.new_corner(third);
                }
                () if ring.third_before() == Some(third) => ring.before(),
                () => ring.after(),
            }
        }
        assert_eq!(ring.gate(), None);
    }

    #[test]
    fn what_names_nothing_is_refused() {
        let refused = |digits: &[u8], extra: &[u8]| {
            let mut steps = StepWriter::default();
            digits.iter().for_each(|&digit| steps.push(digit));
            let mut reader = StepReader::new(&steps.bytes);
            decode(&mut reader, &mut extra.iter(), 128, |_| Ok(())).unwrap_err()
        };
        assert!(refused(&[], &[]).contains("more extra bytes"));
        assert!(refused(&[], &[6]).contains("more extra bytes"));
        assert!(refused(&[], &[6, 0]).contains("names no vertex"));
        assert!(refused(&[step::FAR], &[7, 3]).contains("names no vertex"));
        assert!(refused(&[], &[8]).contains("spare bits"));
        assert!(refused(&[], &[7]).contains("more digits"));
        // Nothing beyond the edge that came before the gate: the two no longer meet.
        let cut = [step::BORDER, step::BEFORE];
        assert!(refused(&cut, &[7]).contains("no edge leads to"));
        let cut = [step::BORDER, step::BORDER, step::AFTER];
        assert!(refused(&cut, &[7]).contains("no edge follows"));
        let beginnings: Vec<u8> = [step::BORDER; 3].repeat(90);
        assert!(refused(&beginnings, &[7; 90]).contains("256 vertices"));
    }
}

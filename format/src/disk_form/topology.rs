//! Topology: a cluster's triangles as steps around its open edges (after Rossignac, "Edgebreaker: connectivity compression for
//! triangle meshes", 1999, with clusters' borders as a step of their own and a vertex number where a step would split the ring).
//!
//! The open edges lie in a ring, in the order of the border that they make; one of them is the gate. A step says what lies beyond the
//! gate: a triangle with a new vertex, with the vertex that the edge before the gate comes from, with the one that the edge
//! after it leads to, with any other vertex (an extra byte: how many come between it and the newest), or nothing. When no edge is
//! open the next triangle begins anew: an extra byte with a bit for each corner that is new, and one for each that is not.
//! Vertices are numbered as they come.

use super::digits::{DigitWriter, Digits};
use super::ring::{Edge, Gate, Ring};
use crate::limits::{MAX_CLUSTER_TRIANGLES, MAX_CLUSTER_VERTICES};

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

/// A cluster's triangles as they are read.
#[derive(Debug)]
pub(super) struct Triangles {
    /// Vertices of the triangles, a plane a corner.
    pub corners: [[u8; MAX_CLUSTER_TRIANGLES]; 3],
    /// For each vertex the edge beyond which it lies, a byte each, or [`ANEW`].
    pub beyond: [u32; MAX_CLUSTER_VERTICES],
}

/// A vertex of a beginning.
pub(super) const ANEW: u32 = super::source_word::ANEW << super::source_word::KIND_SHIFT;

impl Default for Triangles {
    fn default() -> Self {
        Self {
            corners: [[0; MAX_CLUSTER_TRIANGLES]; 3],
            beyond: [0; MAX_CLUSTER_VERTICES],
        }
    }
}

impl Triangles {
    #[inline(always)]
    fn vertex(&mut self, number: usize, beyond: u32) {
        // A cluster of too many is refused when it is counted.
        self.beyond[number % MAX_CLUSTER_VERTICES] = beyond;
    }

    /// The first triangles, corner by corner.
    pub fn first(&self, count: usize) -> impl ExactSizeIterator<Item = [u8; 3]> + '_ {
        let [a, b, c] = &self.corners;
        let bc = b.iter().zip(c);
        a[..count].iter().zip(bc).map(|(&a, (&b, &c))| [a, b, c])
    }

    #[inline(always)]
    fn triangle(&mut self, number: usize, corners: [u8; 3]) {
        for (plane, corner) in self.corners.iter_mut().zip(corners) {
            plane[number % MAX_CLUSTER_TRIANGLES] = corner;
        }
    }
}

/// Steps and extra bytes as they are read. What is wrong is noted, and zeros are read on: a cluster has few triangles.
#[derive(Debug)]
pub(super) struct Steps<'a> {
    pub digits: Digits,
    pub extra: std::slice::Iter<'a, u8>,
    pub wrong: Option<&'static str>,
}

impl Steps<'_> {
    #[cold]
    fn refuse(&mut self, found: &'static str) {
        self.wrong.get_or_insert(found);
    }

    fn extra(&mut self) -> u8 {
        self.extra.next().copied().unwrap_or_else(|| {
            self.wrong.get_or_insert("more extra bytes than there are");
            0
        })
    }

    /// The vertex that an extra byte names.
    fn far(&mut self, vertices: usize) -> u8 {
        let back = self.extra() as usize;
        vertices.checked_sub(back + 1).map_or_else(
            || {
                self.refuse("an extra byte that names no vertex");
                0
            },
            |vertex| vertex as u8,
        )
    }

    /// Reads a cluster's triangles, at most 128; gives the number of its vertices.
    pub fn read(&mut self, count: usize, into: &mut Triangles) -> usize {
        let mut ring = Ring::default();
        let mut gate = None;
        let (mut vertices, mut triangle) = (0usize, 0usize);
        // In a register, not behind a reference that every store might change.
        let mut next = self.digits.next;
        while triangle < count {
            let Some(edge) = gate else {
                gate = Some(ring.begin(self.begin(&mut vertices, triangle, into)));
                triangle += 1;
                continue;
            };
            let step = self.digits.digits.get(next).copied().unwrap_or(0);
            next += 1;
            let third = match step {
                step::NEW => {
                    let third = vertices as u8;
                    into.vertex(vertices, edge.word());
                    vertices += 1;
                    gate = Some(ring.corner(edge, third));
                    third
                }
                step::BEFORE => {
                    let Some(third) = ring.third_before(edge) else {
                        self.refuse("a gate that no edge leads to");
                        break;
                    };
                    gate = ring.before(edge);
                    third
                }
                step::AFTER => {
                    let Some(third) = ring.third_after(edge) else {
                        self.refuse("a gate that no edge follows");
                        break;
                    };
                    gate = ring.after(edge);
                    third
                }
                step::BORDER => {
                    gate = ring.border(edge);
                    continue;
                }
                _ => {
                    let third = self.far(vertices);
                    gate = Some(ring.corner(edge, third));
                    third
                }
            };
            let [from, to, _] = edge.edge();
            into.triangle(triangle, [from, to, third]);
            triangle += 1;
        }
        self.digits.next = next;
        if vertices > MAX_CLUSTER_VERTICES {
            self.refuse("more than 256 vertices");
        }
        vertices
    }

    fn begin(&mut self, vertices: &mut usize, number: usize, into: &mut Triangles) -> [u8; 3] {
        let new = self.extra();
        if new > 7 {
            self.refuse("a beginning with spare bits");
        }
        let mut triangle = [0; 3];
        for (corner, vertex) in triangle.iter_mut().enumerate() {
            *vertex = if new >> corner & 1 == 1 {
                into.vertex(*vertices, ANEW);
                *vertices += 1;
                (*vertices - 1) as u8
            } else {
                self.far(*vertices)
            };
        }
        into.triangle(number, triangle);
        triangle
    }
}

/// Writes triangles over vertices numbered as they come; gives the edge beyond which each vertex lies, where there is one.
pub(super) fn encode(
    triangles: &[[u8; 3]],
    steps: &mut StepWriter,
    extra: &mut Vec<u8>,
) -> Vec<Option<Edge>> {
    let mut ring = Ring::default();
    let mut gate: Option<Gate> = None;
    let mut beyond: Vec<Option<Edge>> = Vec::with_capacity(256);
    for &triangle in triangles {
        while let Some(edge) = gate.filter(|gate| !gate.is_below(triangle)) {
            steps.push(step::BORDER);
            gate = ring.border(edge);
        }
        let Some(edge) = gate else {
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
            gate = Some(ring.begin(triangle));
            continue;
        };
        let third = triangle[2];
        gate = if third as usize == beyond.len() {
            beyond.push(Some(edge.edge()));
            steps.push(step::NEW);
            Some(ring.corner(edge, third))
        } else if ring.third_before(edge) == Some(third) {
            steps.push(step::BEFORE);
            ring.before(edge)
        } else if ring.third_after(edge) == Some(third) {
            steps.push(step::AFTER);
            ring.after(edge)
        } else {
            steps.push(step::FAR);
            extra.push((beyond.len() - 1) as u8 - third);
            Some(ring.corner(edge, third))
        };
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

    fn steps_of<'a>(steps: &StepWriter, extra: &'a [u8]) -> Steps<'a> {
        Steps {
            digits: Digits::new::<5>(&steps.bytes).unwrap(),
            extra: extra.iter(),
            wrong: None,
        }
    }

    fn comes_back(ordered: &Cluster) {
        let (mut steps, mut extra) = (StepWriter::default(), Vec::new());
        let expected = encode(&ordered.triangles, &mut steps, &mut extra);
        let mut read = Triangles::default();
        let mut reader = steps_of(&steps, &extra);
        let count = ordered.triangles.len();
        let vertices = reader.read(count, &mut read);
        assert_eq!(vertices, ordered.positions.len());
        assert_eq!((reader.wrong, reader.extra.len()), (None, 0));
        assert_eq!(reader.digits.finish(), Ok(()));
        let triangle = |at: usize| [0, 1, 2].map(|corner| read.corners[corner][at]);
        let triangles: Vec<[u8; 3]> = (0..count).map(triangle).collect();
        assert_eq!(triangles, ordered.triangles);
        let word = |edge: Option<Edge>| match edge {
            Some([from, to, opposite]) => u32::from_le_bytes([from, to, opposite, 0]),
            None => ANEW,
        };
        let expected: Vec<u32> = expected.into_iter().map(word).collect();
        assert_eq!(read.beyond[..vertices], expected);
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
        let [first, ..] = tetrahedron[..] else {
            unreachable!("four");
        };
        let mut ring = Ring::default();
        let gate = ring.begin(first);
        let gate = ring.corner(gate, 3);
        let gate = ring.third_after(gate).and_then(|_| ring.after(gate));
        let last = gate.expect("one triangle is missing");
        assert!(ring.third_before(last).is_some());
        assert!(ring.before(last).is_none());
        comes_back(&canonical(&cluster(4, tetrahedron)));
    }

    #[test]
    fn what_names_nothing_is_refused() {
        let refused = |digits: &[u8], extra: &[u8]| {
            let mut steps = StepWriter::default();
            digits.iter().for_each(|&digit| steps.push(digit));
            let mut reader = steps_of(&steps, extra);
            reader.read(128, &mut Triangles::default());
            let left = reader.digits.finish().err();
            reader.wrong.or(left).unwrap()
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
        let beginnings: Vec<u8> = [step::BORDER; 3].repeat(128);
        assert!(refused(&beginnings, &[7; 128]).contains("256 vertices"));
    }
}

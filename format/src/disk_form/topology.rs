//! Topology: a cluster's triangles as one byte each, where most lie beside one that came before (after Gumhold and Straßer,
//! "Real time compression of triangle mesh connectivity", 1998, with the open edges in a short list instead of a
//! border that is cut and joined).
//!
//! The list holds the last [`MOST_EDGES`] open edges, each as the triangle beyond it would have it, and the corner of the triangle on this
//! side. A control byte names the edge by its age in the high four bits, 0 the newest, and in the low four bits the third
//! corner: 0 a new vertex; 1 to 13 the vertex that edge of age 0 to 12 leads to, or comes from where it does not begin at the end of the
//! triangle's edge; 14 a new vertex that an earlier cluster of the page has; 15 an extra byte, the count of vertices between it and
//! the newest. A high half of 15 begins anew: the low bits say which of the three corners are new, the others are extra bytes. Vertices are numbered as they come.

use crate::cluster::Cluster;

/// Number of a vertex that no triangle has had.
const UNSEEN: u16 = u16::MAX;
/// Open edges that a triangle may lie beside.
const MOST_EDGES: usize = 15;
/// High half of a control byte: no edge.
const ANEW: u8 = 15;
/// Low half of a control byte: the third corner is a vertex of an earlier cluster.
const SHARED: u8 = 14;
/// Low half of a control byte: the third corner is an extra byte.
const FAR: u8 = 15;

/// Beginning and end of an edge as the triangle beyond it has it, and the third corner on this side.
pub(super) type Edge = [u8; 3];

/// The newest open edges, the newest last.
#[derive(Debug, Default)]
struct OpenEdges {
    edges: [Edge; MOST_EDGES],
    count: usize,
}

impl OpenEdges {
    /// Position of the edge of an age.
    fn position(&self, age: u8) -> Option<usize> {
        self.count.checked_sub(age as usize + 1)
    }

    fn push(&mut self, edge: Edge) {
        if self.count == MOST_EDGES {
            self.remove(0);
        }
        self.edges[self.count] = edge;
        self.count += 1;
    }

    fn remove(&mut self, position: usize) {
        self.edges.copy_within(position + 1..self.count, position);
        self.count -= 1;
    }

    /// The vertex that the edge of an age stands for as the third corner beyond an edge that ends at `end`.
    fn third(&self, age: u8, end: u8) -> Option<u8> {
        let [from, to, _] = self.edges[self.position(age)?];
        Some(if from == end { to } else { from })
    }

    /// Whether a triangle with corners `from`, `to`, `third` would close an open edge beside its first.
    fn closes(&self, from: u8, to: u8, third: u8) -> bool {
        let mut open = self.edges[..self.count].iter();
        open.any(|edge| edge[..2] == [to, third] || edge[..2] == [third, from])
    }

    /// Takes up a triangle beyond an edge: its other two edges are closed where they are open, else opened.
    fn extend(&mut self, [a, b, c]: [u8; 3]) {
        for [from, to, opposite] in [[b, c, a], [c, a, b]] {
            let open = &self.edges[..self.count];
            match open.iter().rposition(|edge| edge[..2] == [from, to]) {
                Some(position) => self.remove(position),
                None => self.push([to, from, opposite]),
            }
        }
    }

    fn begin(&mut self, [a, b, c]: [u8; 3]) {
        for edge in [[b, a, c], [c, b, a], [a, c, b]] {
            self.push(edge);
        }
    }
}

/// What comes out of the bytes, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Event {
    /// The next vertex, beyond an edge or after the vertex before it.
    Vertex(Option<Edge>),
    /// The next vertex, one that an earlier cluster has.
    Shared,
    Triangle([u8; 3]),
}

/// Reads `control` and as much of `extra` as it names; gives the number of vertices and of extra bytes, or what is wrong.
pub(super) fn decode(
    control: &[u8],
    extra: &[u8],
    mut each: impl FnMut(Event),
) -> Result<(usize, usize), &'static str> {
    let mut open = OpenEdges::default();
    let (mut vertices, mut extras) = (0usize, 0usize);
    let number = |vertices: &mut usize| {
        *vertices += 1;
        u8::try_from(*vertices - 1).map_err(|_| "more than 256 vertices")
    };
    let far = |vertices: usize, extras: &mut usize| {
        let back = *extra
            .get(*extras)
            .ok_or("more extra bytes than there are")?;
        *extras += 1;
        let vertex = vertices.checked_sub(back as usize + 1);
        vertex
            .map(|vertex| vertex as u8)
            .ok_or("an extra byte that names no vertex")
    };
    for &byte in control {
        let (age, low) = (byte >> 4, byte & 15);
        if age == ANEW {
            if low > 7 {
                return Err("a beginning with spare bits");
            }
            let mut triangle = [0; 3];
            for (corner, vertex) in triangle.iter_mut().enumerate() {
                *vertex = if low >> corner & 1 == 1 {
                    each(Event::Vertex(None));
                    number(&mut vertices)?
                } else {
                    far(vertices, &mut extras)?
                };
            }
            open.begin(triangle);
            each(Event::Triangle(triangle));
            continue;
        }
        let position = open.position(age).ok_or("an edge that is not open")?;
        let edge = open.edges[position];
        open.remove(position);
        let third = match low {
            0 => {
                each(Event::Vertex(Some(edge)));
                number(&mut vertices)?
            }
            SHARED => {
                each(Event::Shared);
                number(&mut vertices)?
            }
            FAR => far(vertices, &mut extras)?,
            _ => open
                .third(low - 1, edge[1])
                .ok_or("a corner at an edge that is not open")?,
        };
        let triangle = [edge[0], edge[1], third];
        open.extend(triangle);
        each(Event::Triangle(triangle));
    }
    Ok((vertices, extras))
}

/// Control and extra bytes of triangles over vertices numbered as they come; `shared` says which of them earlier clusters have.
pub(super) fn encode(
    triangles: &[[u8; 3]],
    shared: &[bool],
    control: &mut Vec<u8>,
    extra: &mut Vec<u8>,
) {
    let mut open = OpenEdges::default();
    let mut vertices = 0usize;
    for &triangle in triangles {
        let beside = (0..open.count as u8).find(|&age| {
            let edge = open.position(age).map(|position| open.edges[position]);
            edge.is_some_and(|edge| edge[..2] == triangle[..2])
        });
        match beside.and_then(|age| Some((age, open.position(age)?))) {
            Some((age, position)) => {
                open.remove(position);
                let [_, end, third] = triangle;
                let near = (0..SHARED - 1).find(|&age| open.third(age, end) == Some(third));
                let low = match near {
                    _ if third as usize == vertices => {
                        vertices += 1;
                        if shared[third as usize] { SHARED } else { 0 }
                    }
                    Some(age) => age + 1,
                    None => {
                        extra.push((vertices - 1) as u8 - third);
                        FAR
                    }
                };
                control.push(age << 4 | low);
                open.extend(triangle);
            }
            None => {
                let mut low = 0;
                for (corner, &vertex) in triangle.iter().enumerate() {
                    if vertex as usize == vertices {
                        vertices += 1;
                        low |= 1 << corner;
                    } else {
                        extra.push((vertices - 1) as u8 - vertex);
                    }
                }
                control.push(ANEW << 4 | low);
                open.begin(triangle);
            }
        }
    }
}

/// The same cluster with its triangles in the order that costs least, each run of one material by itself, and its vertices as
/// they come; those that no triangle has are gone.
pub fn canonical(cluster: &Cluster) -> Cluster {
    let mut number = [UNSEEN; 256];
    let mut order: Vec<u8> = Vec::with_capacity(cluster.positions.len());
    let mut triangles: Vec<[u8; 3]> = Vec::with_capacity(cluster.triangles.len());
    let mut open = OpenEdges::default();
    let mut first = 0;
    for range in &cluster.materials {
        let own = &cluster.triangles[first..first + range.triangle_count as usize];
        first += own.len();
        let mut run = Run::new(own);
        for _ in 0..own.len() {
            let beside = run.beside(&open, &number, &order);
            let (index, turn) = beside.unwrap_or_else(|| (run.most_known(&number), 0));
            run.left[index] = false;
            let mut corners = own[index];
            corners.rotate_left(turn);
            let triangle = corners.map(|vertex| {
                let own = &mut number[vertex as usize];
                if *own == UNSEEN {
                    *own = order.len() as u16;
                    order.push(vertex);
                }
                *own as u8
            });
            match beside {
                Some(_) => {
                    let open_edges = &open.edges[..open.count];
                    let position = open_edges
                        .iter()
                        .rposition(|edge| edge[..2] == triangle[..2]);
                    if let Some(position) = position {
                        open.remove(position);
                    }
                    open.extend(triangle);
                }
                None => open.begin(triangle),
            }
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

/// No corner.
const NONE: u16 = u16::MAX;

/// Triangles of one material that are put in order.
struct Run<'a> {
    triangles: &'a [[u8; 3]],
    left: [bool; 256],
    /// First corner at each vertex and the next of each, ascending; corner = 3 triangle + turn.
    first: [u16; 256],
    next: Vec<u16>,
}

impl<'a> Run<'a> {
    fn new(triangles: &'a [[u8; 3]]) -> Self {
        let mut first = [NONE; 256];
        let mut next = vec![NONE; 3 * triangles.len()];
        for (corner, &vertex) in triangles.as_flattened().iter().enumerate().rev() {
            next[corner] = std::mem::replace(&mut first[vertex as usize], corner as u16);
        }
        Self {
            triangles,
            left: [true; 256],
            first,
            next,
        }
    }

    /// The first triangle left with an edge, and how far it has to turn to begin with it.
    fn with_edge(&self, [from, to]: [u8; 2]) -> Option<(usize, usize)> {
        let mut corner = self.first[from as usize];
        while corner != NONE {
            let (index, turn) = (corner as usize / 3, corner as usize % 3);
            if self.left[index] && self.triangles[index][(turn + 1) % 3] == to {
                return Some((index, turn));
            }
            corner = self.next[corner as usize];
        }
        None
    }

    /// A triangle beyond an open edge, and how far it has to turn to begin with that edge: beyond the newest that it closes
    /// together with another one, so that few stay open, else beyond the newest.
    fn beside(
        &self,
        open: &OpenEdges,
        number: &[u16; 256],
        order: &[u8],
    ) -> Option<(usize, usize)> {
        let mut newest = None;
        for edge in open.edges[..open.count].iter().rev() {
            let ends = [edge[0], edge[1]].map(|vertex| order[vertex as usize]);
            let Some((index, turn)) = self.with_edge(ends) else {
                continue;
            };
            let third = number[self.triangles[index][(turn + 2) % 3] as usize];
            if third != UNSEEN && open.closes(edge[0], edge[1], third as u8) {
                return Some((index, turn));
            }
            newest = newest.or(Some((index, turn)));
        }
        newest
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::MaterialRange;
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

    proptest! {
        #[test]
        fn any_triangles_come_back(
            vertices in 1usize..=256,
            triangles in prop::collection::vec(any::<[u8; 3]>(), 1..=128),
            shared in prop::collection::vec(any::<bool>(), 256),
        ) {
            let within = |triangle: [u8; 3]| triangle.map(|vertex| (vertex as usize % vertices) as u8);
            let before = cluster(vertices, triangles.into_iter().map(within).collect());
            let ordered = canonical(&before);
            prop_assert_eq!(surface(&ordered), surface(&before));
            let (mut control, mut extra) = (Vec::new(), Vec::new());
            encode(&ordered.triangles, &shared, &mut control, &mut extra);
            let (mut read, mut vertices) = (Vec::new(), Vec::new());
            let counts = decode(&control, &extra, |event| match event {
                Event::Triangle(triangle) => read.push(triangle),
                Event::Vertex(beyond) => vertices.push((false, beyond.is_some())),
                Event::Shared => vertices.push((true, true)),
            });
            prop_assert_eq!(counts, Ok((ordered.positions.len(), extra.len())));
            prop_assert_eq!(read, ordered.triangles);
            // Those of a beginning are never shared.
            for ((is_shared, beyond), shared) in vertices.into_iter().zip(shared) {
                prop_assert_eq!(is_shared, shared && beyond);
            }
        }
    }

    #[test]
    fn a_sheet_begins_once_and_needs_no_extra_bytes() {
        let triangles = (0..64u8).flat_map(|square| {
            let a = square / 8 * 9 + square % 8;
            [[a, a + 1, a + 10], [a, a + 10, a + 9]]
        });
        let ordered = canonical(&cluster(81, triangles.collect()));
        let (mut control, mut extra) = (Vec::new(), Vec::new());
        encode(&ordered.triangles, &[false; 256], &mut control, &mut extra);
        let begun = control.iter().filter(|&&byte| byte >> 4 == ANEW).count();
        assert_eq!((control.len(), begun), (128, 1));
        assert!(extra.len() < 16, "{} extra bytes", extra.len());
    }

    #[test]
    fn what_names_nothing_is_refused() {
        let refused = |control: &[u8], extra: &[u8]| decode(control, extra, |_| ()).unwrap_err();
        assert!(refused(&[0x00], &[]).contains("not open"));
        assert!(refused(&[0xf6], &[]).contains("more extra bytes"));
        assert!(refused(&[0xf6], &[0]).contains("names no vertex"));
        assert!(refused(&[0xf7, 0x0f], &[3]).contains("names no vertex"));
        assert!(refused(&[0xf7, 0x0d], &[]).contains("corner at an edge"));
        assert!(refused(&[0xf8], &[]).contains("spare bits"));
        assert!(refused(&[0xf7; 86], &[]).contains("256 vertices"));
    }
}

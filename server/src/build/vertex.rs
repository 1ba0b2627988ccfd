//! Vertices on the grids: from here on every stage works on the numbers that will be drawn.

use bytemuck::{Pod, Zeroable};
use lodestream_format::cluster::Attributes;
use lodestream_format::grid::Grid;
use lodestream_format::octahedral;

use super::steps::MOST_UV_STEPS;
use crate::import::Mesh;

/// A vertex as the format stores it. Attributes that the mesh lacks are zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Vertex {
    /// Grid indices relative to the centre, within 2^23 of each other.
    pub position: [i32; 3],
    pub normal: [u16; 2],
    pub uv: [i32; 2],
    pub color: [u8; 4],
}

/// Which attributes an asset has, and the grids its vertices lie on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grids {
    pub attributes: Attributes,
    pub position: Grid,
    pub uv: Grid,
    /// Grid index in the middle of the bounds.
    pub center_q: [i64; 3],
    /// Smallest texture coordinates, in steps.
    pub uv_base: [i64; 2],
}

impl Grids {
    /// Metres of a step.
    pub fn step_metres(&self) -> f64 {
        self.position.step()
    }

    /// Local position of a grid index, metres; exact.
    pub fn local_metres(&self, position: [i32; 3]) -> [f32; 3] {
        let step = self.step_metres();
        position.map(|q| (q as f64 * step) as f32)
    }

    /// Largest distance of a rounded position from the source's, metres: half the diagonal of a
    /// cell.
    pub fn rounding_metres(&self) -> f64 {
        self.position.rounding()
    }

    /// Local grid index of a position.
    pub fn place(&self, position: [f32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| {
            let q = self.position.quantize(position[axis] as f64);
            (q - self.center_q[axis]) as i32
        })
    }

    /// A vertex of `mesh` on the grids.
    pub fn vertex(&self, mesh: &Mesh, index: usize) -> Vertex {
        let has = |flag| self.attributes.has(flag);
        let mut vertex = Vertex {
            position: self.place(mesh.positions[index]),
            ..Vertex::default()
        };
        if let (true, Some(normals)) = (has(Attributes::NORMAL), &mesh.normals) {
            vertex.normal = octahedral::encode(normals[index]);
        }
        if let (true, Some(uvs)) = (has(Attributes::UV), &mesh.uvs) {
            for axis in 0..2 {
                let q = self.uv.quantize(uvs[index][axis] as f64);
                let base = self.uv_base[axis];
                vertex.uv[axis] = q.clamp(base, base + MOST_UV_STEPS) as i32;
            }
        }
        if let (true, Some(colors)) = (has(Attributes::COLOR), &mesh.colors) {
            vertex.color = colors[index];
        }
        vertex
    }
}

/// Numbers vertices by value and their places by position. Vertices that differ only in attributes share a place.
#[derive(Debug, Default)]
pub(super) struct Welder {
    places: Places,
    /// First vertex of each place.
    first: Vec<u32>,
    /// Next vertex of the same place.
    next: Vec<u32>,
    /// Place of each vertex.
    pub place_of: Vec<u32>,
    /// Each vertex with its material slot, or 0 where materials do not split vertices.
    pub vertices: Vec<(Vertex, u16)>,
}

const NONE: u32 = u32::MAX;

impl Welder {
    /// Forgets everything and makes room for `count` vertices.
    pub fn clear(&mut self, count: usize) {
        self.places.clear(count);
        self.first.clear();
        self.next.clear();
        self.place_of.clear();
        self.vertices.clear();
    }

    /// Number of places.
    pub fn place_count(&self) -> usize {
        self.first.len()
    }

    /// Number of a vertex, new or known.
    pub fn number(&mut self, vertex: &Vertex, material: u16) -> u32 {
        let place = self.places.number(vertex.position);
        if place as usize == self.first.len() {
            self.first.push(NONE);
        }
        let mut at = &mut self.first[place as usize];
        let mut known = *at;
        while known != NONE {
            if self.vertices[known as usize] == (*vertex, material) {
                return known;
            }
            at = &mut self.next[known as usize];
            known = *at;
        }
        let number = self.vertices.len() as u32;
        *at = number;
        self.next.push(NONE);
        self.place_of.push(place);
        self.vertices.push((*vertex, material));
        number
    }

    /// One vertex of a place.
    pub fn first_vertex(&self, place: u32) -> u32 {
        self.first[place as usize]
    }

    /// Vertices of a place.
    pub fn vertices_at(&self, place: u32) -> impl Iterator<Item = u32> + '_ {
        let some = |vertex: u32| (vertex != NONE).then_some(vertex);
        std::iter::successors(some(self.first[place as usize]), move |&vertex| {
            some(self.next[vertex as usize])
        })
    }
}

/// Numbers grid positions in order of first sight: open addressing, since this runs for every vertex of every group.
#[derive(Debug, Default)]
pub(super) struct Places {
    slots: Vec<u32>,
    pub positions: Vec<[i32; 3]>,
}

impl Places {
    /// Forgets everything and makes room for `count` positions.
    pub fn clear(&mut self, count: usize) {
        self.slots.clear();
        self.slots.resize((2 * count + 1).next_power_of_two(), NONE);
        self.positions.clear();
    }

    /// Number of a position, new or known.
    pub fn number(&mut self, position: [i32; 3]) -> u32 {
        let mask = self.slots.len() - 1;
        let mut slot = hash(position) as usize & mask;
        loop {
            let place = self.slots[slot];
            if place == NONE {
                self.slots[slot] = self.positions.len() as u32;
                self.positions.push(position);
                return self.slots[slot];
            }
            if self.positions[place as usize] == position {
                return place;
            }
            slot = (slot + 1) & mask;
        }
    }
}

/// Spreads grid indices over 32 bits (Fibonacci hashing; Knuth, TAOCP 3, 6.4).
fn hash([x, y, z]: [i32; 3]) -> u32 {
    let low = (x as u32 as u64 | (y as u32 as u64) << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let all = (low ^ low >> 29 ^ z as u32 as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (all >> 32) as u32
}

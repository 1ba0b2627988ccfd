//! A few clusters' triangles over their own short vertex array, scaled to unit size: what the geometric stages work on.

use super::quantize::{QuantizedMesh, Triangle};

/// Triangles over local vertices. A vertex used by two materials is split, so that a vertex has one material and a
/// border between materials is a seam like any other.
#[derive(Debug)]
pub(super) struct LocalMesh {
    /// Vertex of the whole mesh, for each local vertex.
    pub vertices: Vec<u32>,
    /// Material slot of each local vertex.
    pub materials: Vec<u16>,
    /// Within half a unit of the origin at most, exact: a shifted grid index times a power of two, so that the same
    /// shape at another (power-of-two) size or place has the same numbers.
    pub positions: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// Metres of one unit of `positions`.
    pub metres_per_unit: f64,
}

impl LocalMesh {
    /// Gathers `triangles` of `mesh`.
    pub fn new(mesh: &QuantizedMesh, triangles: &[Triangle]) -> Self {
        let mut numbers = Numbering::with_room_for(4 * triangles.len());
        let local: Vec<[u32; 3]> = triangles
            .iter()
            .map(|triangle| {
                triangle
                    .vertices
                    .map(|vertex| numbers.number((triangle.material as u64) << 32 | vertex as u64))
            })
            .collect();
        let vertices: Vec<u32> = numbers.keys.iter().map(|&key| key as u32).collect();
        let materials = numbers.keys.iter().map(|&key| (key >> 32) as u16).collect();
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for &vertex in &vertices {
            let q = mesh.vertices[vertex as usize].position;
            for axis in 0..3 {
                low[axis] = low[axis].min(q[axis]);
                high[axis] = high[axis].max(q[axis]);
            }
        }
        let center: [i32; 3] = std::array::from_fn(|axis| low[axis] + (high[axis] - low[axis]) / 2);
        let extent = (0..3).map(|axis| high[axis] - low[axis]).max().unwrap_or(0);
        let unit = (extent.max(1) as u32).next_power_of_two();
        let scale = 1.0 / unit as f32;
        let positions = vertices
            .iter()
            .map(|&vertex| {
                let q = mesh.vertices[vertex as usize].position;
                std::array::from_fn(|axis| (q[axis] - center[axis]) as f32 * scale)
            })
            .collect();
        Self {
            vertices,
            materials,
            positions,
            triangles: local,
            metres_per_unit: unit as f64 * mesh.step_metres(),
        }
    }

    /// Triangles over this mesh's vertices as triangles of the whole mesh. Where corners disagree about the material
    /// (a collapse across a corner of three materials) the majority, or else the first corner, decides.
    pub fn to_whole(&self, triangles: &[[u32; 3]]) -> Vec<Triangle> {
        triangles
            .iter()
            .map(|corners| {
                let [a, b, c] = corners.map(|local| self.materials[local as usize]);
                Triangle {
                    vertices: corners.map(|local| self.vertices[local as usize]),
                    material: if b == c { b } else { a },
                }
            })
            .collect()
    }
}

/// Numbers keys in order of first sight: open addressing, since this runs for every corner of every group.
struct Numbering {
    slots: Vec<u32>,
    keys: Vec<u64>,
}

const EMPTY: u32 = u32::MAX;

impl Numbering {
    fn with_room_for(count: usize) -> Self {
        Self {
            slots: vec![EMPTY; (count + 1).next_power_of_two()],
            keys: Vec::new(),
        }
    }

    fn number(&mut self, key: u64) -> u32 {
        let mask = self.slots.len() - 1;
        // Fibonacci hashing (Knuth, TAOCP 3, 6.4).
        let mut slot = (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & mask;
        loop {
            let number = self.slots[slot];
            if number == EMPTY {
                self.slots[slot] = self.keys.len() as u32;
                self.keys.push(key);
                return self.slots[slot];
            }
            if self.keys[number as usize] == key {
                return number;
            }
            slot = (slot + 1) & mask;
        }
    }
}

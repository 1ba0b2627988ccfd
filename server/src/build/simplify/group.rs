//! The triangles of a group over their own vertices: what a simplification works on.

use super::super::borders::FREE;
use super::super::cluster::{ClusterView, Witness};
use super::super::vertex::{Grids, Welder};
use glam::Vec4;
use lodestream_format::cluster::Attributes;
use lodestream_format::octahedral;

/// Share of a triangle's size that a normal turned by one radian counts for: an arc whose ends turn so much rises so far.
const NORMAL_WEIGHT: f32 = 0.125;
/// Share of a texture's slide over the surface that counts as error.
const UV_WEIGHT: f32 = 0.5;
/// Share of a triangle's size that a full step of one colour channel counts for.
const COLOR_WEIGHT: f32 = 1.0;

/// A group's triangles. A vertex has one material, so that a border between materials is a seam like any other.
#[derive(Debug, Default)]
pub(in super::super) struct GroupMesh {
    pub welder: Welder,
    /// Of each place, within half a unit of the origin, exact: a shifted grid index times a power of two, so that the
    /// same shape at another (power-of-two) size or place has the same numbers.
    pub positions: Vec<[f32; 3]>,
    /// What may be done to each place; see `borders`.
    pub rules: Vec<u8>,
    pub triangles: Vec<[u16; 3]>,
    /// First of the gathered triangles of each cluster.
    pub first_triangles: Vec<usize>,
    /// Those that were gathered: what the new surface is measured against.
    pub gathered: Vec<[u16; 3]>,
    /// Places that points of the source bear witness for; see `parts`.
    pub answered: Vec<bool>,
    /// Points of the source that coarser levels answer for, and the triangle nearest to each.
    pub witnesses: Vec<Witness>,
    /// Grid index at the origin of `positions`.
    pub center: [i32; 3],
    /// Grid steps of a unit.
    pub unit: f32,
    numbers: Vec<u16>,
}

impl GroupMesh {
    /// Gathers clusters; `rules` gives those of each cluster's vertices.
    pub fn gather<'a>(
        &mut self,
        clusters: impl Iterator<Item = (ClusterView<'a>, &'a [u8])> + Clone,
    ) {
        self.welder
            .clear(clusters.clone().map(|(view, _)| view.vertices.len()).sum());
        self.triangles.clear();
        self.first_triangles.clear();
        self.witnesses.clear();
        self.rules.clear();
        for (view, rules) in clusters {
            let first = self.triangles.len();
            self.first_triangles.push(first);
            let mut slots = view.slots();
            let mut current = None;
            for corners in view.triangles {
                let slot = slots.next().unwrap_or(0);
                if current != Some(slot) {
                    current = Some(slot);
                    self.numbers.clear();
                    self.numbers.resize(view.vertices.len(), u16::MAX);
                }
                let triangle = [corners[0], corners[1], corners[2]].map(|corner| {
                    let number = &mut self.numbers[corner as usize];
                    if *number == u16::MAX {
                        let vertex = &view.vertices[corner as usize];
                        // At most 32 clusters of 256 vertices, each once for a material.
                        *number = self.welder.number(vertex, slot) as u16;
                        let place = self.welder.place_of[*number as usize] as usize;
                        if place == self.rules.len() {
                            self.rules.push(FREE);
                        }
                        let rule = rules.get(corner as usize).copied().unwrap_or(FREE);
                        self.rules[place] = self.rules[place].max(rule);
                    }
                    *number
                });
                self.triangles.push(triangle);
            }
            self.witnesses
                .extend(view.witnesses.iter().map(|witness| Witness {
                    triangle: witness.triangle + first as u32,
                    ..*witness
                }));
        }
        self.gathered.clone_from(&self.triangles);
        self.place_positions();
        self.answered.clear();
        self.answered.resize(self.positions.len(), false);
    }

    /// Triangles of each cluster as they were gathered.
    pub fn clusters(&self) -> impl Iterator<Item = &[[u16; 3]]> {
        let ends = self.first_triangles.iter().copied().skip(1);
        let ends = ends.chain([self.gathered.len()]);
        let firsts = self.first_triangles.iter().copied();
        firsts
            .zip(ends)
            .map(|(first, end)| &self.gathered[first..end])
    }

    /// Number of the cluster that a gathered triangle came from.
    pub fn cluster_of(&self, triangle: usize) -> usize {
        self.first_triangles
            .partition_point(|&first| first <= triangle)
            - 1
    }

    pub(super) fn place_positions(&mut self) {
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for (vertex, _) in &self.welder.vertices {
            for axis in 0..3 {
                low[axis] = low[axis].min(vertex.position[axis]);
                high[axis] = high[axis].max(vertex.position[axis]);
            }
        }
        self.center = std::array::from_fn(|axis| low[axis] + (high[axis] - low[axis]) / 2);
        let extent = (0..3).map(|axis| high[axis] - low[axis]).max().unwrap_or(0);
        self.unit = (extent.max(1) as u32).next_power_of_two() as f32;
        self.positions.clear();
        self.positions.resize(self.welder.place_count(), [0.0; 3]);
        for vertex in 0..self.welder.vertices.len() {
            let place = self.welder.place_of[vertex] as usize;
            self.positions[place] = self.local(self.welder.vertices[vertex].0.position);
        }
    }

    /// Units from grid indices.
    pub fn local(&self, position: [i32; 3]) -> [f32; 3] {
        let scale = 1.0 / self.unit;
        std::array::from_fn(|axis| (position[axis] - self.center[axis]) as f32 * scale)
    }

    /// Nearest grid indices.
    pub fn on_grid(&self, position: [f32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| {
            (position[axis] * self.unit).round_ties_even() as i32 + self.center[axis]
        })
    }

    /// Places of a triangle's corners.
    pub fn places(&self, triangle: [u16; 3]) -> [usize; 3] {
        triangle.map(|vertex| self.welder.place_of[vertex as usize] as usize)
    }

    /// Root of the mean square of the edges of `triangles`, units.
    pub fn typical_edge(&self, triangles: &[[u16; 3]]) -> f32 {
        let mut sum = 0.0;
        for &triangle in triangles {
            let [a, b, c] = self.places(triangle).map(|place| self.positions[place]);
            for side in [super::sub(b, a), super::sub(c, b), super::sub(a, c)] {
                sum += super::dot(side, side);
            }
        }
        (sum / (3 * triangles.len()).max(1) as f32).sqrt()
    }

    /// Units that a unit of each attribute counts for, in the order of [`GroupMesh::attributes`].
    pub fn weights(&self, grids: &Grids, edge: f32) -> Weights {
        Weights {
            normal: match grids.attributes.has(Attributes::NORMAL) {
                true => NORMAL_WEIGHT * edge,
                false => 0.0,
            },
            uv: match grids.attributes.has(Attributes::UV) {
                true => UV_WEIGHT * self.units_a_uv_step(),
                false => 0.0,
            },
            color: match grids.attributes.has(Attributes::COLOR) {
                true => COLOR_WEIGHT * edge / 255.0,
                false => 0.0,
            },
        }
    }

    /// Length on the surface that a step of the texture grid stands for on average; 0 where the texture coordinates span
    /// no area.
    fn units_a_uv_step(&self) -> f32 {
        let (mut surface, mut texture) = (0.0f32, 0.0f32);
        for &triangle in &self.triangles {
            let [a, b, c] = self.places(triangle).map(|place| self.positions[place]);
            let across = super::cross(super::sub(b, a), super::sub(c, a));
            surface += super::dot(across, across).sqrt();
            let [a, b, c] = triangle.map(|vertex| self.welder.vertices[vertex as usize].0.uv);
            let side = |to: [i32; 2]| [(to[0] - a[0]) as f32, (to[1] - a[1]) as f32];
            let ([x, y], [z, w]) = (side(b), side(c));
            texture += (x * w - y * z).abs();
        }
        if texture > 0.0 {
            (surface / texture).sqrt()
        } else {
            0.0
        }
    }

    /// Weighed attributes of a vertex. Texture coordinates count from `uv_base`.
    pub fn attributes<const L: usize>(
        &self,
        grids: &Grids,
        weights: &Weights,
        uv_base: [i32; 2],
        vertex: usize,
    ) -> [Vec4; L] {
        let vertex = &self.welder.vertices[vertex].0;
        let mut all = [Vec4::ZERO; L];
        let mut next = 0;
        let mut push = |value: f32| {
            if let Some(four) = all.get_mut(next / 4) {
                four[next % 4] = value;
            }
            next += 1;
        };
        if grids.attributes.has(Attributes::NORMAL) {
            octahedral::decode(vertex.normal)
                .iter()
                .for_each(|value| push(value * weights.normal));
        }
        if grids.attributes.has(Attributes::UV) {
            for axis in 0..2 {
                push((vertex.uv[axis] - uv_base[axis]) as f32 * weights.uv);
            }
        }
        if grids.attributes.has(Attributes::COLOR) {
            vertex
                .color
                .iter()
                .for_each(|&value| push(value as f32 * weights.color));
        }
        all
    }

    /// Turns weighed attributes back into those of a vertex; what weighs nothing stays.
    pub fn set_attributes<const L: usize>(
        &mut self,
        grids: &Grids,
        weights: &Weights,
        uv_base: [i32; 2],
        vertex: usize,
        values: &[Vec4; L],
    ) {
        let vertex = &mut self.welder.vertices[vertex].0;
        let mut values = values.iter().flat_map(|four| four.to_array());
        if grids.attributes.has(Attributes::NORMAL) {
            let normal: [f32; 3] = std::array::from_fn(|_| values.next().unwrap_or(0.0));
            if super::dot(normal, normal) > 0.0 {
                vertex.normal = octahedral::encode(normal);
            }
        }
        if grids.attributes.has(Attributes::UV) {
            for axis in 0..2 {
                let value = values.next().unwrap_or(0.0);
                if weights.uv > 0.0 {
                    let steps = (value / weights.uv).round_ties_even() as i32;
                    // Inside the asset's range of steps, see `Grids::vertex`.
                    let base = grids.uv_base[axis];
                    let most = base + super::super::steps::MOST_UV_STEPS;
                    vertex.uv[axis] =
                        (steps as i64 + uv_base[axis] as i64).clamp(base, most) as i32;
                }
            }
        }
        if grids.attributes.has(Attributes::COLOR) {
            for channel in 0..4 {
                let value = values.next().unwrap_or(0.0);
                if weights.color > 0.0 {
                    let level = (value / weights.color).round_ties_even();
                    vertex.color[channel] = level.clamp(0.0, 255.0) as u8;
                }
            }
        }
    }

    /// Texture coordinates of some vertex, so that differences stay exact in f32.
    pub fn uv_base(&self) -> [i32; 2] {
        self.welder
            .vertices
            .first()
            .map_or([0; 2], |(vertex, _)| vertex.uv)
    }
}

/// See [`GroupMesh::weights`].
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Weights {
    pub normal: f32,
    pub uv: f32,
    pub color: f32,
}

/// Attributes that a metric over `attributes` weighs.
pub(in super::super) fn attribute_count(attributes: Attributes) -> usize {
    let count = |flag, numbers| if attributes.has(flag) { numbers } else { 0 };
    count(Attributes::NORMAL, 3) + count(Attributes::UV, 2) + count(Attributes::COLOR, 4)
}

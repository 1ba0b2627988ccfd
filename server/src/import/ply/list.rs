//! Triangles as the faces list them, on their way to a mesh.

use std::collections::HashMap;

use glam::DVec3;

use super::faces::FaceRow;
use super::vertices::Table;
use crate::import::attributes::{self, finite_uv};
use crate::import::error::Read;
use crate::import::plain;
use crate::import::polygons::{Cutter, Polygon, corners};
use crate::import::scene::Mesh;
use crate::import::used::Used;
use crate::import::warnings::Warnings;
use crate::import::weld::Seeded;

/// Stands for a texture that the header does not name.
pub(super) const NO_TEXTURE: u16 = u16::MAX;

/// Texture coordinates of a triangle's corners, top-down.
type Uvs = [[f32; 2]; 3];

/// Triangles, with as much of each as the file has.
#[derive(Default)]
pub(super) struct TriangleList {
    /// Of the file's vertices.
    pub(super) triangles: Vec<[u32; 3]>,
    /// `None` where corners have none of their own.
    uvs: Option<Vec<Uvs>>,
    /// Numbers of textures; `None` where all have the first.
    textures: Option<Vec<u16>>,
    /// Fans that may not be right.
    polygons: Vec<Polygon>,
    uvs_replaced: u64,
}

impl TriangleList {
    pub(super) fn new(with_uvs: bool, with_textures: bool) -> Self {
        Self {
            uvs: with_uvs.then(Vec::new),
            textures: with_textures.then(Vec::new),
            ..Self::default()
        }
    }

    pub(super) fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Bytes that are held, and those that the mesh of it takes.
    pub(super) fn held_bytes(&self, vertex_count: u64) -> u64 {
        fn bytes<T>(list: &Vec<T>) -> u64 {
            (list.capacity() * size_of::<T>()) as u64
        }
        /// A vertex of the file with texture coordinates, and its place in a table.
        const CORNER_BYTES: u64 = 3 * 48;
        let triangles = self.len() as u64;
        let (vertices, welding) = match &self.uvs {
            Some(_) => (3 * triangles, CORNER_BYTES * triangles),
            None => (vertex_count.min(3 * triangles), 0),
        };
        bytes(&self.triangles)
            + self.uvs.as_ref().map_or(0, bytes)
            + self.textures.as_ref().map_or(0, bytes)
            + bytes(&self.polygons)
            + welding
            + plain::completing_bytes(vertices, triangles)
    }

    /// Notes that the triangles from `first` on are those of a face, of which `row` has the rest.
    pub(super) fn end_face(&mut self, first: usize, row: &FaceRow, texture: u16) {
        let count = self.triangles.len() - first;
        if count > 1 {
            let (first, count) = (first as u32, count as u32);
            self.polygons.push(Polygon { first, count });
        }
        if let Some(uvs) = &mut self.uvs {
            let replaced = &mut self.uvs_replaced;
            let mut uv = |corner: usize| {
                let [u, v] = row.uvs.get(corner).copied().unwrap_or([0.0, 1.0]);
                finite_uv([u as f32, (1.0 - v) as f32], replaced)
            };
            uvs.extend((0..count).map(|at| [0, at + 1, at + 2].map(&mut uv)));
        }
        if let Some(textures) = &mut self.textures {
            textures.resize(self.triangles.len(), texture);
        }
    }

    /// Notes that all triangles so far are no polygons, and have no more than their vertices.
    pub(super) fn end_strips(&mut self) {
        let count = self.triangles.len();
        if let Some(uvs) = &mut self.uvs {
            uvs.resize(count, Uvs::default());
        }
        if let Some(textures) = &mut self.textures {
            textures.resize(count, 0);
        }
    }

    /// Cuts polygons that their fans do not cover.
    pub(super) fn cut(&mut self, table: &Table, warnings: &mut Warnings) -> Read<()> {
        let polygons = std::mem::take(&mut self.polygons);
        if polygons.is_empty() {
            return Ok(());
        }
        let fans = polygons.iter().flat_map(|it| &self.triangles[it.range()]);
        let mut fans: Vec<[u32; 3]> = fans.copied().collect();
        let used = Used::by_first_use(&mut fans);
        let mut points = vec![DVec3::ZERO; used.len()];
        table.positions(&used, |slot, position| points[slot] = position.into())?;
        let mut cutter = Cutter::default();
        let mut fans = &fans[..];
        for polygon in polygons {
            let (fan, rest) = fans.split_at(polygon.count as usize);
            fans = rest;
            let local: Vec<DVec3> = corners(fan)
                .iter()
                .map(|&slot| points[slot as usize])
                .collect();
            if let Some(cut) = cutter.cut(&local) {
                replace(&mut self.triangles[polygon.range()], &cut);
                if let Some(uvs) = &mut self.uvs {
                    replace(&mut uvs[polygon.range()], &cut);
                }
            }
        }
        cutter.note("element face", warnings);
        Ok(())
    }

    /// Keeps `count` triangles from `first` on.
    pub(super) fn keep(&mut self, first: usize, count: usize) {
        fn keep<T>(list: &mut Vec<T>, first: usize, count: usize) {
            list.drain(..first);
            list.truncate(count);
        }
        keep(&mut self.triangles, first, count);
        if let Some(uvs) = &mut self.uvs {
            keep(uvs, first, count);
        }
        if let Some(textures) = &mut self.textures {
            keep(textures, first, count);
        }
    }

    /// The mesh of polygons that are cut, with what it uses of the table. Normals may be missing or
    /// of no length. `textures` has the number of each slot's texture, ascending.
    pub(super) fn into_mesh(
        mut self,
        table: &Table,
        textures: &[u16],
        warnings: &mut Warnings,
    ) -> Read<(Mesh, Used)> {
        let replaced = self.uvs_replaced;
        warnings.add(attributes::REPLACED_UVS, replaced, "element face");
        self.drop_repeated(warnings);
        let mut mesh = Mesh {
            triangle_materials: vec![0; self.triangles.len()],
            ..Mesh::default()
        };
        if let Some(numbers) = &self.textures {
            let slots = mesh.triangle_materials.iter_mut().zip(numbers);
            slots.for_each(|(slot, number)| {
                // Every number was seen when the file was walked over.
                *slot = textures.binary_search(number).unwrap_or(0) as u16;
            });
        }
        let (used, uvs) = match &self.uvs {
            None => (Used::by_first_use(&mut self.triangles), None),
            Some(uvs) => {
                let (used, uvs) = weld(&mut self.triangles, uvs);
                (used, Some(uvs))
            }
        };
        mesh.triangles = self.triangles;
        table.read(&used, &mut mesh, warnings)?;
        mesh.uvs = uvs.or(mesh.uvs);
        Ok((mesh, used))
    }

    fn drop_repeated(&mut self, warnings: &mut Warnings) {
        let is_kept = |[a, b, c]: [u32; 3]| a != b && b != c && c != a;
        let kept: Vec<bool> = self.triangles.iter().map(|it| is_kept(*it)).collect();
        if let Some(uvs) = &mut self.uvs {
            let mut kept = kept.iter();
            uvs.retain(|_| kept.next() == Some(&true));
        }
        if let Some(textures) = &mut self.textures {
            let mut kept = kept.iter();
            textures.retain(|_| kept.next() == Some(&true));
        }
        plain::drop_repeated(&mut self.triangles, "element face", warnings);
    }
}

/// Puts corners of a fan in the order of a cut.
fn replace<T: Copy>(fan: &mut [[T; 3]], cut: &[[u32; 3]]) {
    let corners = corners(fan);
    for (to, from) in fan.iter_mut().zip(cut) {
        *to = from.map(|at| corners[at as usize]);
    }
}

/// Points `triangles` at vertices that have one pair of texture coordinates each, in the order of
/// first use.
fn weld(triangles: &mut [[u32; 3]], uvs: &[Uvs]) -> (Used, Vec<[f32; 2]>) {
    let mut number_of: HashMap<[u32; 3], u32, Seeded> = HashMap::with_hasher(Seeded::new());
    let (mut vertices, mut vertex_uvs) = (Vec::new(), Vec::new());
    let all = triangles.iter_mut().flatten().zip(uvs.iter().flatten());
    for (corner, uv) in all {
        let next = vertices.len() as u32;
        let [u, v] = uv.map(|it| (it + 0.0).to_bits());
        let number = *number_of.entry([*corner, u, v]).or_insert(next);
        if number == next {
            vertices.push(*corner);
            vertex_uvs.push(*uv);
        }
        *corner = number;
    }
    (Used::of_vertices(&vertices), vertex_uvs)
}

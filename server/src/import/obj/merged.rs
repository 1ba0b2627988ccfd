//! Merged: the one mesh that all statements come to.

use std::collections::HashMap;

use glam::DVec3;

use super::faces::LISTS;
use super::{NONE, Parser};
use crate::import::color::linear_from_srgb;
use crate::import::error::{Read, malformed};
use crate::import::origin::{Bounds, Origin, is_finite};
use crate::import::polygons::{Cutter, corners};
use crate::import::scene::Mesh;
use crate::import::warnings::Warnings;
use crate::import::weld::Seeded;
use crate::import::{complete, plain};

impl Parser {
    /// Checks that every position is there and finite, now that all is read, and leaves out texture
    /// coordinates and normals that are not there.
    pub(super) fn check_indices(&mut self, warnings: &mut Warnings) -> Read<()> {
        let (largest, line) = self.largest[0];
        if line > 0 && largest as usize >= self.positions.len() {
            let expected = format!("an index into {} positions", self.positions.len());
            let found = u64::from(largest) + 1;
            return Err(malformed(format!("line {line}"), expected, found));
        }
        for vertex in &mut self.vertices {
            // Lines that could not be read, and that are told already.
            let uv = self.uvs.get(vertex[1] as usize);
            let normal = self.normals.get(vertex[2] as usize);
            if uv.is_some_and(|it| it[0].is_nan()) {
                vertex[1] = NONE;
            }
            if normal.is_some_and(|it| it[0].is_nan()) {
                vertex[2] = NONE;
            }
        }
        for (kind, length) in [(1, self.uvs.len()), (2, self.normals.len())] {
            let is_absent = |index: u32| index != NONE && index as usize >= length;
            let mut absent = 0;
            for vertex in &mut self.vertices {
                if is_absent(vertex[kind]) {
                    vertex[kind] = NONE;
                    absent += 1;
                }
            }
            let what = format!(
                "{} that faces name and the file lacks left out",
                LISTS[kind]
            );
            let (_, line) = self.largest[kind];
            warnings.add(what, absent, &format!("line {line}"));
        }
        self.check_finite(warnings)
    }

    /// Leaves out faces with a corner that is nowhere; refuses a file that has no others.
    fn check_finite(&mut self, warnings: &mut Warnings) -> Read<()> {
        if self.not_finite.is_empty() {
            return Ok(());
        }
        let positions = &self.positions;
        let vertices = &self.vertices;
        let used = vertices.iter().map(|it| it[0]);
        let wrong = used.filter(|&at| !is_finite(positions[at as usize])).min();
        let Some(wrong) = wrong else {
            let what = "positions that are not finite and that no face uses left out";
            let (_, line) = self.not_finite[0];
            let amount = self.not_finite.len() as u64;
            warnings.add(what, amount, &format!("line {line}"));
            return Ok(());
        };
        let place = self.not_finite.binary_search_by_key(&wrong, |it| it.0);
        let place = format!("line {}", place.map_or(0, |at| self.not_finite[at].1));
        let has_place = |&at: &u32| is_finite(positions[vertices[at as usize][0] as usize]);
        let is_whole = |it: &[u32; 3]| it.iter().all(has_place);
        let mut kept: Vec<bool> = self.triangles.iter().map(is_whole).collect();
        let mut left_out = kept.iter().filter(|it| !**it).count() as u64;
        let mut polygons = std::mem::take(&mut self.polygons);
        for polygon in &polygons {
            let fan = &mut kept[polygon.range()];
            let alone = fan.iter().filter(|it| !**it).count() as u64;
            if alone > 0 {
                // One face, however many of its triangles have the corner.
                left_out -= alone - 1;
                fan.fill(false);
            }
        }
        if !kept.contains(&true) {
            let found = format!("{:?}", positions[wrong as usize]);
            return Err(malformed(place, "three finite numbers within f32", found));
        }
        let what = "faces with a position that is not finite left out";
        warnings.add(what, left_out, &place);
        let kept_before = kept_before(&kept);
        polygons.retain_mut(|polygon| {
            let is_kept = kept[polygon.first as usize];
            polygon.first = kept_before[polygon.first as usize] as u32;
            is_kept
        });
        self.polygons = polygons;
        self.retain(&kept);
        Ok(())
    }

    /// Keeps the triangles that `kept` says.
    fn retain(&mut self, kept: &[bool]) {
        let mut keep = kept.iter();
        self.triangles.retain(|_| keep.next() == Some(&true));
        let mut keep = kept.iter();
        self.triangle_materials
            .retain(|_| keep.next() == Some(&true));
    }

    /// The mesh, and the point that its positions are told from.
    pub(super) fn into_mesh(mut self, warnings: &mut Warnings) -> (Mesh, Origin) {
        self.cut_polygons(warnings);
        self.part_bare();
        self.vertex_of_corner = HashMap::with_hasher(Seeded::new());
        self.drop_repeated(warnings);
        let all = |kind: usize| self.vertices.iter().all(|it| it[kind] == NONE);
        let (no_uvs, no_normals) = (all(1), all(2));
        let gather = |kind: usize| self.vertices.iter().map(move |it| it[kind] as usize);
        let origin = Origin::of(Bounds::of(gather(0).map(|at| self.positions[at])));
        let local = |at: usize| origin.local(self.positions[at]);
        let mut mesh = Mesh {
            positions: gather(0).map(local).collect(),
            ..Mesh::default()
        };
        if !no_uvs {
            let without = gather(1).filter(|&at| at == NONE as usize).count();
            let what = "vertices without texture coordinates beside others with them set to (0, 0)";
            warnings.add(what, without as u64, "file");
            let uv = |at: usize| self.uvs.get(at).copied().unwrap_or_default();
            mesh.uvs = Some(gather(1).map(uv).collect());
        }
        if !self.colors.is_empty() {
            let colors = linear_colors(&self.colors, warnings);
            let color = |at: usize| colors.get(at).copied().unwrap_or([u8::MAX; 4]);
            mesh.colors = Some(gather(0).map(color).collect());
        }
        let normal = |at: usize| self.normals.get(at).copied().unwrap_or_default();
        let given = match no_normals {
            true => Vec::new(),
            false => gather(2).map(normal).collect(),
        };
        mesh.triangles = self.triangles;
        mesh.triangle_materials = self.triangle_materials;
        if !mesh.triangles.is_empty() {
            complete::complete(&mut mesh, given, &self.bare, "file", warnings);
            plain::drop_unused(&mut mesh);
        }
        (mesh, origin)
    }

    /// Cuts the polygons that their fans do not cover.
    fn cut_polygons(&mut self, warnings: &mut Warnings) {
        let mut cutter = Cutter::default();
        for polygon in std::mem::take(&mut self.polygons) {
            let fan = &mut self.triangles[polygon.range()];
            let vertices = corners(fan);
            let position = |&vertex: &u32| {
                let [at, ..] = self.vertices[vertex as usize];
                DVec3::from(self.positions[at as usize])
            };
            let points: Vec<DVec3> = vertices.iter().map(position).collect();
            if let Some(cut) = cutter.cut(&points) {
                for (to, from) in fan.iter_mut().zip(cut) {
                    *to = from.map(|at| vertices[at as usize]);
                }
            }
        }
        cutter.note("file", warnings);
    }

    /// Gives triangles with a corner that lacks its normal vertices of their own: theirs are made.
    fn part_bare(&mut self) {
        let vertices = &self.vertices;
        let is_bare = |it: &[u32; 3]| it.iter().any(|&at| vertices[at as usize][2] == NONE);
        let bare: Vec<bool> = self.triangles.iter().map(is_bare).collect();
        let runs = bare.chunk_by(|a, b| a == b);
        let mut first = 0;
        self.bare.clear();
        for run in runs {
            let range = first..first + run.len();
            first = range.end;
            if run[0] {
                self.bare.push(range);
            }
        }
        for range in &self.bare {
            for corner in self.triangles[range.clone()].iter_mut().flatten() {
                let [position, uv, normal] = self.vertices[*corner as usize];
                if normal != NONE {
                    let next = self.vertices.len() as u32;
                    let bare = [position, uv, NONE];
                    *corner = *self.vertex_of_corner.entry(bare).or_insert(next);
                    if *corner == next {
                        self.vertices.push(bare);
                    }
                }
            }
        }
    }

    /// Drops triangles that repeat a position, and moves the ranges of the bare ones.
    fn drop_repeated(&mut self, warnings: &mut Warnings) {
        let vertices = &self.vertices;
        let keep = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|it| vertices[it as usize][0]);
            a != b && b != c && c != a
        };
        let kept: Vec<bool> = self.triangles.iter().map(keep).collect();
        let dropped = kept.iter().filter(|it| !**it).count() as u64;
        if dropped == 0 {
            return;
        }
        warnings.add("triangles with a repeated index left out", dropped, "file");
        let kept_before = kept_before(&kept);
        for range in &mut self.bare {
            *range = kept_before[range.start]..kept_before[range.end];
        }
        self.bare.retain(|range| !range.is_empty());
        self.retain(&kept);
    }
}

/// For each triangle how many are kept before it, and behind the last how many in all.
fn kept_before(kept: &[bool]) -> Vec<usize> {
    let mut length = 0;
    let mut kept_before = Vec::with_capacity(kept.len() + 1);
    for &keep in kept {
        kept_before.push(length);
        length += usize::from(keep);
    }
    kept_before.push(length);
    kept_before
}

/// Colours as written to linear bytes. Some programs write 0..=255.
fn linear_colors(written: &[[f32; 4]], warnings: &mut Warnings) -> Vec<[u8; 4]> {
    let (mut replaced, mut one) = (0, 1.0);
    if written
        .iter()
        .flatten()
        .any(|&it| it > 1.0 && it.is_finite())
    {
        one = 255.0;
        let count = written.len() as u64;
        warnings.add("vertex colours above 1 read as 0..255", count, "file");
    }
    let byte = |color: &[f32; 4]| {
        if !color.iter().all(|it| it.is_finite()) {
            replaced += 1;
            return [u8::MAX; 4];
        }
        let [r, g, b, a] = color.map(|it| f64::from(it.clamp(0.0, one) / one));
        let alpha = if one == 255.0 && color[3] == 1.0 {
            1.0
        } else {
            a
        };
        let [r, g, b] = [r, g, b].map(linear_from_srgb);
        [r, g, b, alpha].map(|it| (it * 255.0).round() as u8)
    };
    let colors = written.iter().map(byte).collect();
    let what = "vertex colours that are not finite set to white";
    warnings.add(what, replaced, "file");
    colors
}

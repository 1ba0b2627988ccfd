//! Faces: corners by index, as fans, and the materials that they are of.

use super::{NONE, Parser};
use crate::import::error::{Read, malformed};
use crate::import::plain;
use crate::import::polygons::Polygon;
use crate::import::warnings::Warnings;

/// Lists that a corner points into.
pub(super) const LISTS: [&str; 3] = ["positions", "texture coordinates", "normals"];

impl Parser {
    /// Reads a face.
    pub(super) fn face(&mut self, line: &[u8], warnings: &mut Warnings) -> Read<()> {
        let mut polygon = std::mem::take(&mut self.polygon);
        polygon.clear();
        let words = line
            .split(u8::is_ascii_whitespace)
            .filter(|it| !it.is_empty());
        for word in words {
            polygon.push(self.corner(word)?);
        }
        if polygon.len() < 3 {
            warnings.add(
                "faces of fewer than three corners left out",
                1,
                &self.place(),
            );
            self.polygon = polygon;
            return Ok(());
        }
        let slot = self.slot()?;
        let first_triangle = self.triangles.len();
        plain::check_triangle_count((first_triangle + polygon.len()) as u64, &self.place())?;
        let is_bare = polygon.iter().any(|corner| corner[2] == NONE);
        if is_bare {
            // No vertex is shared with triangles that have theirs.
            polygon.iter_mut().for_each(|corner| corner[2] = NONE);
        }
        let (mut first, mut last) = (0, 0);
        for (at, corner) in polygon.iter().enumerate() {
            let next = self.vertices.len() as u32;
            let vertex = *self.vertex_of_corner.entry(*corner).or_insert(next);
            if vertex == next {
                self.vertices.push(*corner);
            }
            match at {
                0 => first = vertex,
                1 => {}
                _ => {
                    self.triangles.push([first, last, vertex]);
                    self.triangle_materials.push(slot);
                }
            }
            last = vertex;
        }
        let count = polygon.len() - 2;
        if count > 1 {
            let (first, count) = (first_triangle as u32, count as u32);
            self.polygons.push(Polygon { first, count });
        }
        self.polygon = polygon;
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`, each from 1, or from -1 backwards. Some programs write 0
    /// for texture coordinates or a normal that a corner lacks.
    fn corner(&mut self, word: &[u8]) -> Read<[u32; 3]> {
        let lengths = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut corner = [NONE; 3];
        for (kind, part) in word.split(|&byte| byte == b'/').enumerate() {
            if part.is_empty() && kind > 0 {
                continue;
            }
            if kind > 2 || part.is_empty() {
                return Err(self.expected("v, v/vt, v//vn or v/vt/vn", word));
            }
            let index = std::str::from_utf8(part)
                .ok()
                .and_then(|it| it.parse::<i64>().ok());
            let index = match index {
                Some(0) if kind > 0 => continue,
                Some(index @ 1..) => Some(index - 1),
                Some(index @ ..0) => Some(lengths[kind] as i64 + index),
                _ => None,
            };
            let number = index.and_then(|it| u32::try_from(it).ok().filter(|&it| it < NONE));
            // Out of every range: found absent at the end, as those after the last.
            let absent = index.filter(|_| kind > 0).map(|_| NONE - 1);
            let Some(index) = number.or(absent) else {
                let list = LISTS[kind];
                let expected = format!("an index into {} {list}, from 1 or from -1", lengths[kind]);
                return Err(self.expected(&expected, word));
            };
            if index >= self.largest[kind].0 {
                self.largest[kind] = (index, self.line);
            }
            corner[kind] = index;
        }
        Ok(corner)
    }

    fn slot(&mut self) -> Read<u16> {
        if let Some(slot) = self.slot {
            return Ok(slot);
        }
        let next = self.material_names.len();
        let Ok(next) = u16::try_from(next) else {
            return Err(malformed(self.place(), "65536 materials at most", "more"));
        };
        let slot = *self
            .slot_of_material
            .entry(self.material.clone())
            .or_insert(next);
        if slot == next {
            self.material_names.push(self.material.clone());
            let length = self.material.as_ref().map_or(0, String::len) as u64;
            self.name_bytes += 3 * length;
        }
        self.slot = Some(slot);
        Ok(slot)
    }
}

//! The face element: polygons, cut into fans.

use super::header::{Element, Encoding, Kind, Scalar};
use super::values::Values;
use crate::import::error::{Fault, Read, malformed};
use crate::import::warnings::Warnings;

/// Most corners of a face: a piece that begins inside one reads it from its start.
const MOST_CORNERS: u64 = 1 << 22;

/// How a face stands in the body.
#[derive(Clone)]
pub(super) struct FaceLayout {
    element: Element,
    /// The property of `element` that lists the corners.
    corners: usize,
    /// Count and item of a face that is nothing but its corners.
    bare: Option<(Scalar, Scalar)>,
    encoding: Encoding,
    pub(super) count: u64,
    vertex_count: u64,
}

impl FaceLayout {
    /// `None` where no property lists corners.
    pub(super) fn find(
        element: &Element,
        vertex_count: u64,
        encoding: Encoding,
        warnings: &mut Warnings,
    ) -> Read<Option<Self>> {
        let is_corners =
            |name: &str| matches!(name, "vertex_indices" | "vertex_index" | "vertex_indexes");
        let corners = element
            .properties
            .iter()
            .position(|it| is_corners(&it.name));
        let Some(corners) = corners else {
            warnings.add(
                "faces without vertex_indices left out",
                element.count,
                "element face",
            );
            return Ok(None);
        };
        let Kind::List { count, item } = element.properties[corners].kind else {
            let place = "element face, property vertex_indices";
            return Err(malformed(place, "a list", "a number"));
        };
        if !item.is_integer() {
            let place = "element face, property vertex_indices";
            return Err(malformed(place, "integers", "floats"));
        }
        for (_, property) in element
            .properties
            .iter()
            .enumerate()
            .filter(|(at, _)| *at != corners)
        {
            let what = format!("face properties {} left out", property.name);
            warnings.add(what, 1, "element face");
        }
        Ok(Some(Self {
            element: element.clone(),
            corners,
            bare: (element.properties.len() == 1).then_some((count, item)),
            encoding,
            count: element.count,
            vertex_count,
        }))
    }

    /// Reads face number `face` and gives its triangles to `emit`; says whether it has any.
    pub(super) fn read(
        &self,
        values: &mut Values,
        face: u64,
        emit: &mut impl FnMut([u32; 3]),
    ) -> Read<bool> {
        if let (Some((Scalar::U8, item @ (Scalar::I32 | Scalar::U32))), Encoding::LittleEndian) =
            (self.bare, self.encoding)
        {
            return self.read_bare(values, face, item, emit);
        }
        let mut any = false;
        for (at, property) in self.element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(scalar) => values.skip(scalar, 1)?,
                Kind::List { count, item } => {
                    let length = values.count(count)?;
                    if at == self.corners {
                        any = length >= 3;
                        self.read_fan(values, face, length, item, emit)?;
                    } else {
                        values.skip(item, length)?;
                    }
                }
            }
        }
        Ok(any)
    }

    /// The layout that nearly all large files have, several times as fast.
    fn read_bare(
        &self,
        values: &mut Values,
        face: u64,
        item: Scalar,
        emit: &mut impl FnMut([u32; 3]),
    ) -> Read<bool> {
        let length = values.take(1)?[0];
        if length != 3 {
            self.read_fan(values, face, u64::from(length), item, emit)?;
            return Ok(length >= 3);
        }
        let bytes = values.take(12)?;
        let word = |at: usize| {
            bytes[at..]
                .first_chunk()
                .map_or(0, |it| u32::from_le_bytes(*it))
        };
        let triangle = [word(0), word(4), word(8)];
        // A negative i32 is a large u32, and no file has 2^31 vertices with signed indices.
        if let Some(&wrong) = triangle
            .iter()
            .find(|&&it| u64::from(it) >= self.vertex_count)
        {
            let wrong = match item {
                Scalar::I32 => f64::from(wrong as i32),
                _ => f64::from(wrong),
            };
            return Err(self.out_of_range(face, wrong));
        }
        emit(triangle);
        Ok(true)
    }

    fn read_fan(
        &self,
        values: &mut Values,
        face: u64,
        length: u64,
        item: Scalar,
        emit: &mut impl FnMut([u32; 3]),
    ) -> Read<()> {
        let (mut first, mut last) = (0, 0);
        for corner in 0..length {
            if corner == MOST_CORNERS {
                let expected = format!("{MOST_CORNERS} corners at most");
                return Err(malformed(format!("face {face}"), expected, length));
            }
            let index = values.scalar(item)?;
            if !(index >= 0.0 && index < self.vertex_count as f64 && index.fract() == 0.0) {
                return Err(self.out_of_range(face, index));
            }
            let index = index as u32;
            match corner {
                0 => first = index,
                1 => {}
                _ => emit([first, last, index]),
            }
            last = index;
        }
        Ok(())
    }

    fn out_of_range(&self, face: u64, found: f64) -> Fault {
        let expected = format!("indices below {}", self.vertex_count);
        malformed(format!("face {face}"), expected, found)
    }
}

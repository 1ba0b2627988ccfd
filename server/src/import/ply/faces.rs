//! The face element: polygons as fans, with the texture coordinates of their corners.

use super::header::{Element, Encoding, Kind, Scalar};
use super::values::Values;
use crate::import::error::{Fault, Read, malformed, short};
use crate::import::polygons;
use crate::import::warnings::Warnings;

/// Most corners of a face: a piece that begins inside one reads it from its start.
const MOST_CORNERS: u64 = 1 << 22;
/// The same of a face with texture coordinates, which are held until all of it is read.
const MOST_CORNERS_WITH_UVS: u64 = polygons::MOST_CORNERS as u64;

/// How a face stands in the body.
#[derive(Clone)]
pub(super) struct FaceLayout {
    element: Element,
    /// The property of `element` that lists the corners.
    corners: usize,
    /// The one that lists a pair of texture coordinates for each corner.
    uvs: Option<usize>,
    /// The one that numbers the texture.
    texture: Option<usize>,
    /// Count and item of a face that is nothing but its corners.
    bare: Option<(Scalar, Scalar)>,
    encoding: Encoding,
    pub(super) count: u64,
    vertex_count: u64,
}

/// A face beside its corners.
#[derive(Default)]
pub(super) struct FaceRow {
    /// A pair for each corner, bottom-up; none where the face has not as many.
    pub(super) uvs: Vec<[f64; 2]>,
    /// Number of its texture; 0 where faces have none.
    pub(super) texture: f64,
    /// Its corners.
    pub(super) corners: u64,
}

/// The property that lists vertices.
pub(super) fn is_corners(name: &str) -> bool {
    matches!(name, "vertex_indices" | "vertex_index" | "vertex_indexes")
}

impl FaceLayout {
    /// `None` where no property lists corners.
    pub(super) fn find(
        element: &Element,
        vertex_count: u64,
        encoding: Encoding,
        warnings: &mut Warnings,
    ) -> Read<Option<Self>> {
        let properties = &element.properties;
        let find = |is: fn(&str) -> bool| properties.iter().position(|it| is(&it.name));
        let Some(corners) = find(is_corners) else {
            warnings.add(
                "faces without vertex_indices left out",
                element.count,
                "element face",
            );
            return Ok(None);
        };
        let Kind::List { count, item } = properties[corners].kind else {
            let place = "element face, property vertex_indices";
            return Err(malformed(place, "a list", "a number"));
        };
        if !item.is_integer() {
            let place = "element face, property vertex_indices";
            return Err(malformed(place, "integers", "floats"));
        }
        let is_list = |at: &usize| matches!(properties[*at].kind, Kind::List { .. });
        let uvs = find(|name| matches!(name, "texcoord" | "texcoords")).filter(is_list);
        let texture = find(|name| name == "texnumber").filter(|at| !is_list(at));
        let read = [Some(corners), uvs, texture];
        for (at, property) in properties.iter().enumerate() {
            if !read.contains(&Some(at)) {
                let what = format!("face properties {} left out", short(&property.name));
                warnings.add(what, 1, "element face");
            }
        }
        Ok(Some(Self {
            element: element.clone(),
            corners,
            uvs,
            texture,
            bare: (properties.len() == 1).then_some((count, item)),
            encoding,
            count: element.count,
            vertex_count,
        }))
    }

    pub(super) fn has_uvs(&self) -> bool {
        self.uvs.is_some()
    }

    /// Whether faces name a texture of several.
    pub(super) fn has_textures(&self) -> bool {
        self.texture.is_some()
    }

    /// Reads face number `face`: gives its triangles to `emit`, each with the number of the face's
    /// corners, and all else in `row`.
    pub(super) fn read(
        &self,
        values: &mut Values,
        face: u64,
        row: &mut FaceRow,
        emit: &mut impl FnMut(u64, [u32; 3]),
    ) -> Read<()> {
        if let (Some((Scalar::U8, item @ (Scalar::I32 | Scalar::U32))), Encoding::LittleEndian) =
            (self.bare, self.encoding)
        {
            return self.read_bare(values, face, item, row, emit);
        }
        row.uvs.clear();
        for (at, property) in self.element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(scalar) if self.texture == Some(at) => {
                    row.texture = values.scalar(scalar)?;
                }
                Kind::Scalar(scalar) => values.skip(scalar, 1)?,
                Kind::List { count, item } => {
                    let length = values.count(count)?;
                    if at == self.corners {
                        row.corners = length;
                        self.read_fan(values, face, length, item, emit)?;
                    } else if self.uvs == Some(at) && length <= 2 * MOST_CORNERS_WITH_UVS {
                        for _ in 0..length / 2 {
                            let uv = [values.scalar(item)?, values.scalar(item)?];
                            row.uvs.push(uv);
                        }
                        values.skip(item, length % 2)?;
                    } else {
                        values.skip(item, length)?;
                    }
                }
            }
        }
        if row.uvs.len() as u64 != row.corners {
            row.uvs.clear();
        }
        Ok(())
    }

    /// The layout that nearly all large files have, several times as fast.
    fn read_bare(
        &self,
        values: &mut Values,
        face: u64,
        item: Scalar,
        row: &mut FaceRow,
        emit: &mut impl FnMut(u64, [u32; 3]),
    ) -> Read<()> {
        let length = values.take(1)?[0];
        row.corners = length.into();
        if length != 3 {
            return self.read_fan(values, face, row.corners, item, emit);
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
        emit(3, triangle);
        Ok(())
    }

    fn read_fan(
        &self,
        values: &mut Values,
        face: u64,
        length: u64,
        item: Scalar,
        emit: &mut impl FnMut(u64, [u32; 3]),
    ) -> Read<()> {
        let most = match self.uvs {
            Some(_) => MOST_CORNERS_WITH_UVS,
            None => MOST_CORNERS,
        };
        let (mut first, mut last) = (0, 0);
        for corner in 0..length {
            if corner == most {
                let expected = format!("{most} corners at most");
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
                _ => emit(length, [first, last, index]),
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

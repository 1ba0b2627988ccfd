//! The vertex element: columns of a table with a fixed stride.

use super::header::{Element, Encoding, Kind, Property, Scalar};
use super::values::Values;
use crate::import::attributes::{self, Present};
use crate::import::color::{LinearBytes, linear_from_srgb};
use crate::import::error::{Read, malformed, short};
use crate::import::file::Extent;
use crate::import::origin::{self, Bounds, Origin};
use crate::import::rows::Rows;
use crate::import::scene::Mesh;
use crate::import::used::Used;
use crate::import::warnings::Warnings;

#[derive(Clone, Copy)]
struct Column {
    offset: usize,
    scalar: Scalar,
}

/// Where the attributes stand in a row.
#[derive(Clone)]
pub(super) struct Columns {
    position: [Column; 3],
    normal: Option<[Column; 3]>,
    uv: Option<[Column; 2]>,
    color: Option<[Column; 3]>,
    alpha: Option<Column>,
    row_bytes: usize,
}

/// Names of the texture coordinates' properties, as different programs write them.
const UVS: &[[&str; 2]] = &[
    ["s", "t"],
    ["u", "v"],
    ["texture_u", "texture_v"],
    ["texture_s", "texture_t"],
];
const COLORS: &[[&str; 3]] = &[
    ["red", "green", "blue"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["r", "g", "b"],
];

impl Columns {
    /// Finds the attributes among the scalar properties; notes what is left out.
    pub(super) fn find(
        element: &Element,
        encoding: Encoding,
        warnings: &mut Warnings,
    ) -> Read<Self> {
        let mut columns: Vec<(&str, Column)> = Vec::new();
        let mut offset = 0;
        for property in &element.properties {
            if let Some(scalar) = held(property, encoding) {
                columns.push((&property.name, Column { offset, scalar }));
                offset += scalar.bytes();
            }
        }
        let find = |name: &str| {
            let column = columns.iter().find(|(other, _)| *other == name);
            column.map(|(_, column)| *column)
        };
        fn all<const N: usize>(
            names: &[&str; N],
            find: impl Fn(&str) -> Option<Column>,
        ) -> Option<[Column; N]> {
            let columns: Option<Vec<Column>> = names.iter().map(|name| find(name)).collect();
            columns?.try_into().ok()
        }
        let Some(position) = all(&["x", "y", "z"], find) else {
            let expected = "the properties x, y and z";
            return Err(malformed("element vertex", expected, "not all of them"));
        };
        let uv_names = UVS.iter().find(|names| all(names, find).is_some());
        let color_names = COLORS.iter().find(|names| all(names, find).is_some());
        let alpha_name = ["alpha", "diffuse_alpha", "a"]
            .into_iter()
            .find(|name| find(name).is_some());
        let normal_names = &["nx", "ny", "nz"];
        let normal = all(normal_names, find);
        let mut read: Vec<&str> = vec!["x", "y", "z"];
        read.extend(normal.iter().flat_map(|_| normal_names));
        read.extend(uv_names.into_iter().flatten());
        if let Some(names) = color_names {
            read.extend(names);
            read.extend(alpha_name);
        }
        for property in &element.properties {
            if !read.contains(&&*property.name) {
                let what = format!("vertex properties {} left out", short(&property.name));
                warnings.add(what, 1, "element vertex");
            }
        }
        Ok(Self {
            position,
            normal,
            uv: uv_names.and_then(|names| all(names, find)),
            color: color_names.and_then(|names| all(names, find)),
            alpha: color_names.and(alpha_name).and_then(find),
            row_bytes: offset,
        })
    }

    pub(super) fn present(&self) -> Present {
        Present {
            normals: self.normal.is_some(),
            uvs: self.uv.is_some(),
            colors: self.color.is_some(),
        }
    }
}

/// How a property is held in a table; `None` for a list. A text's positions have all their digits,
/// whatever type they are declared as.
fn held(property: &Property, encoding: Encoding) -> Option<Scalar> {
    let is_position = matches!(&*property.name, "x" | "y" | "z");
    match property.kind {
        Kind::Scalar(_) if encoding == Encoding::Text && is_position => Some(Scalar::F64),
        Kind::Scalar(scalar) => Some(scalar),
        Kind::List { .. } => None,
    }
}

/// The vertices of a file.
pub(super) struct Table {
    rows: Rows,
    columns: Columns,
    big_endian: bool,
    origin: Origin,
    /// The largest of red, green and blue, and of alpha.
    most_color: f64,
    most_alpha: f64,
}

impl Table {
    /// A table in the file: `count` binary rows at `offset`, which `values` moves over.
    pub(super) fn in_file(
        file: &Extent,
        values: &mut Values,
        columns: Columns,
        count: u64,
        encoding: Encoding,
    ) -> Read<Self> {
        let bytes = count.saturating_mul(columns.row_bytes as u64);
        let offset = values.position();
        values.skip_bytes(bytes)?;
        let extent = file.slice(offset, bytes);
        let extent = extent.ok_or_else(|| malformed("element vertex", "rows", "none"))?;
        Ok(Self::new(extent, columns, encoding == Encoding::BigEndian))
    }

    fn new(extent: Extent, columns: Columns, big_endian: bool) -> Self {
        Self {
            rows: Rows {
                extent,
                stride: columns.row_bytes,
                row_bytes: columns.row_bytes,
            },
            columns,
            big_endian,
            origin: Origin::default(),
            most_color: 0.0,
            most_alpha: 0.0,
        }
    }

    fn number(&self, row: &[u8], column: Column) -> f64 {
        column.scalar.read(&row[column.offset..], self.big_endian)
    }

    fn position(&self, row: &[u8]) -> [f64; 3] {
        self.columns.position.map(|column| self.number(row, column))
    }

    /// Gives the positions of the vertices `used`, each with its slot, to `visit`.
    pub(super) fn positions(
        &self,
        used: &Used,
        mut visit: impl FnMut(usize, [f64; 3]),
    ) -> Read<()> {
        self.rows.visit(&used.ascending, |place, row| {
            visit(used.slot(place), self.position(row));
        })
    }

    /// Moves the origin near to the vertices that `is_used` says; gives it. Gives those of them
    /// that are not finite to `lack`. Finds the range of colours.
    pub(super) fn measure(
        &mut self,
        is_used: impl Fn(u64) -> bool,
        mut lack: impl FnMut(u32, [f64; 3]),
        warnings: &mut Warnings,
    ) -> Read<Origin> {
        let mut bounds = Bounds::EMPTY;
        let (mut most_color, mut most_alpha) = (0.0f64, 0.0f64);
        let rows = self.rows.extent.len() / self.rows.stride.max(1) as u64;
        self.rows.visit_range(0..rows, |row, bytes| {
            if is_used(row) {
                let position = self.position(bytes);
                bounds.add(position);
                if !origin::is_finite(position) {
                    lack(row as u32, position);
                }
            }
            // `max` passes over NaN.
            for column in self.columns.color.into_iter().flatten() {
                most_color = most_color.max(self.number(bytes, column));
            }
            if let Some(column) = self.columns.alpha {
                most_alpha = most_alpha.max(self.number(bytes, column));
            }
            Ok(())
        })?;
        (self.most_color, self.most_alpha) = (most_color, most_alpha);
        if let Some([red, ..]) = self.columns.color
            && !red.scalar.is_integer()
            && most_color > 1.0
        {
            let what = "vertex colours above 1 read as 0..255";
            warnings.add(what, rows, "element vertex");
        }
        self.origin = Origin::of(bounds);
        Ok(self.origin)
    }

    /// The number that stands for all of a colour, and for opaque.
    fn ones(&self) -> (f64, f64) {
        let columns = &self.columns;
        let color = columns.color.map_or(Scalar::U8, |it| it[0].scalar);
        let alpha = columns.alpha.map_or(Scalar::U8, |it| it.scalar);
        let (mut most_color, mut most_alpha) = (self.most_color, self.most_alpha);
        if color == alpha && color.is_integer() {
            most_color = most_color.max(most_alpha);
            most_alpha = most_color;
        }
        (one(color, most_color), one(alpha, most_alpha))
    }

    /// Bytes of [`Table::in_memory`]: what the file cannot hold is not made room for.
    pub(super) fn most_bytes(
        values: &Values,
        element: &Element,
        columns: &Columns,
        encoding: Encoding,
    ) -> u64 {
        let least = element.least_row_bytes(encoding).max(1);
        let rows = element.count.min(values.left() / least + 1);
        rows.saturating_mul(columns.row_bytes as u64)
    }

    /// Rows of text, or with lists between them, brought to such a table without the lists.
    pub(super) fn in_memory(
        values: &mut Values,
        element: &Element,
        columns: Columns,
        encoding: Encoding,
    ) -> Read<Self> {
        let most = Self::most_bytes(values, element, &columns, encoding);
        let mut bytes = Vec::with_capacity(most as usize);
        for _ in 0..element.count {
            for property in &element.properties {
                match (property.kind, held(property, encoding)) {
                    (Kind::Scalar(scalar), Some(held)) => {
                        held.push(values.scalar(scalar)?, &mut bytes);
                    }
                    (Kind::Scalar(scalar), None) => values.skip(scalar, 1)?,
                    (Kind::List { count, item }, _) => {
                        let count = values.count(count)?;
                        values.skip(item, count)?;
                    }
                }
            }
        }
        Ok(Self::new(Extent::memory(bytes), columns, false))
    }

    /// Fills the vertex arrays of `mesh` with the vertices `used`.
    pub(super) fn read(&self, used: &Used, mesh: &mut Mesh, warnings: &mut Warnings) -> Read<()> {
        let columns = &self.columns;
        let number = |row: &[u8], column: Column| self.number(row, column);
        let length = used.len();
        let filled = |present: bool| if present { length } else { 0 };
        let mut positions = vec![[0.0f32; 3]; length];
        let mut normals = vec![[0.0f32; 3]; filled(columns.normal.is_some())];
        let mut uvs = vec![[0.0f32; 2]; filled(columns.uv.is_some())];
        let mut colors = vec![[0u8; 4]; filled(columns.color.is_some())];
        let linear = LinearBytes::new();
        let (one_color, one_alpha) = self.ones();
        let mut not_finite = None;
        let (mut rescaled, mut replaced) = (0, 0);
        self.rows.visit(&used.ascending, |place, row| {
            let slot = used.slot(place);
            let position = self.position(row);
            positions[slot] = self.origin.local(position);
            if !origin::is_finite(position) {
                not_finite.get_or_insert((used.ascending[place], position));
            }
            if let Some(normal) = columns.normal {
                let normal = normal.map(|column| number(row, column));
                normals[slot] = attributes::unit_normal(normal, &mut rescaled);
            }
            if let Some(uv) = columns.uv {
                // Bottom-up in these files, top-down in the scene.
                let [u, v] = uv.map(|column| number(row, column));
                uvs[slot] = attributes::finite_uv([u as f32, (1.0 - v) as f32], &mut replaced);
            }
            if let Some([r, g, b]) = columns.color {
                let byte = |column: Column, one| color_byte(number(row, column) / one);
                let of = |column: Column| match column.scalar {
                    Scalar::F32 | Scalar::F64 => linear_byte(number(row, column) / one_color),
                    _ => linear.of([byte(column, one_color), 0, 0, 0])[0],
                };
                let alpha = columns.alpha.map_or(u8::MAX, |it| byte(it, one_alpha));
                colors[slot] = [of(r), of(g), of(b), alpha];
            }
        })?;
        if let Some((vertex, position)) = not_finite {
            let (place, found) = (format!("vertex {vertex}"), format!("{position:?}"));
            return Err(malformed(place, "finite numbers within f32", found));
        }
        warnings.add(attributes::RESCALED, rescaled, "element vertex");
        warnings.add(attributes::REPLACED_UVS, replaced, "element vertex");
        mesh.positions = positions;
        mesh.normals = columns.normal.map(|_| normals);
        mesh.uvs = columns.uv.map(|_| uvs);
        mesh.colors = columns.color.map(|_| colors);
        Ok(())
    }
}

/// The number of type `scalar` that stands for all of a colour of which a file has `most`. Bytes
/// are often declared as a wider type, and floats often run to 255.
fn one(scalar: Scalar, most: f64) -> f64 {
    const BYTE: f64 = 255.0;
    let widest = match scalar {
        Scalar::U8 => return BYTE,
        Scalar::I8 => return 127.0,
        Scalar::F32 | Scalar::F64 => return if most > 1.0 { BYTE } else { 1.0 },
        Scalar::I16 => f64::from(i16::MAX),
        Scalar::U16 => f64::from(u16::MAX),
        Scalar::I32 => f64::from(i32::MAX),
        Scalar::U32 => f64::from(u32::MAX),
    };
    if most > BYTE { widest } else { BYTE }
}

fn color_byte(part: f64) -> u8 {
    (part * 255.0).clamp(0.0, 255.0).round() as u8
}

fn linear_byte(srgb: f64) -> u8 {
    (linear_from_srgb(srgb.clamp(0.0, 1.0)) * 255.0).round() as u8
}

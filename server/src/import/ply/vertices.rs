//! The vertex element: columns of a table with a fixed stride.

use super::header::{Element, Encoding, Kind, Scalar};
use super::values::Values;
use crate::import::attributes::{self, Present};
use crate::import::color::{LinearBytes, linear_from_srgb};
use crate::import::error::{Read, malformed};
use crate::import::file::Extent;
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
    pub(super) fn find(element: &Element, warnings: &mut Warnings) -> Read<Self> {
        let mut columns: Vec<(&str, Column)> = Vec::new();
        let mut offset = 0;
        for property in &element.properties {
            if let Kind::Scalar(scalar) = property.kind {
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
                let what = format!("vertex properties {} left out", property.name);
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

/// The vertices of a file.
pub(super) struct Table {
    rows: Rows,
    columns: Columns,
    big_endian: bool,
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
        }
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
                match property.kind {
                    Kind::Scalar(scalar) => scalar.push(values.scalar(scalar)?, &mut bytes),
                    Kind::List { count, item } => {
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
        let number =
            |row: &[u8], column: Column| column.scalar.read(&row[column.offset..], self.big_endian);
        let length = used.len();
        let filled = |present: bool| if present { length } else { 0 };
        let mut positions = vec![[0.0f32; 3]; length];
        let mut normals = vec![[0.0f32; 3]; filled(columns.normal.is_some())];
        let mut uvs = vec![[0.0f32; 2]; filled(columns.uv.is_some())];
        let mut colors = vec![[0u8; 4]; filled(columns.color.is_some())];
        let linear = LinearBytes::new();
        let mut not_finite: Option<usize> = None;
        let (mut rescaled, mut replaced) = (0, 0);
        self.rows.visit(&used.ascending, |place, row| {
            let slot = used.slot(place);
            positions[slot] = columns.position.map(|column| number(row, column) as f32);
            if !positions[slot].iter().all(|it| it.is_finite()) {
                not_finite.get_or_insert(place);
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
                let byte = |column: Column| color_byte(column.scalar, number(row, column));
                let of = |column: Column| match column.scalar {
                    Scalar::F32 | Scalar::F64 => linear_byte(number(row, column)),
                    _ => linear.of([byte(column), 0, 0, 0])[0],
                };
                let alpha = columns.alpha.map_or(u8::MAX, byte);
                colors[slot] = [of(r), of(g), of(b), alpha];
            }
        })?;
        if let Some(place) = not_finite {
            let found = format!("{:?}", positions[used.slot(place)]);
            let place = format!("vertex {}", used.ascending[place]);
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

/// A colour's number as a byte: integers over the range of their type, floats over 0..=1.
fn color_byte(scalar: Scalar, value: f64) -> u8 {
    let one = match scalar {
        Scalar::U8 => return value as u8,
        Scalar::I8 => 127.0,
        Scalar::I16 => 32767.0,
        Scalar::U16 => 65535.0,
        Scalar::I32 => f64::from(i32::MAX),
        Scalar::U32 => f64::from(u32::MAX),
        Scalar::F32 | Scalar::F64 => 1.0,
    };
    (value / one * 255.0).clamp(0.0, 255.0).round() as u8
}

fn linear_byte(srgb: f64) -> u8 {
    (linear_from_srgb(srgb.clamp(0.0, 1.0)) * 255.0).round() as u8
}

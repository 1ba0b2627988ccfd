//! PLY (Turk, 1994): text and both byte orders; polygons of any size, positions, normals, texture coordinates and colours.
//!
//! Texture coordinates run bottom-up in these files and top-down in the scene, so `v` becomes `1 - v`. Colours are sRGB
//! by the scanning programs' habit and become linear; alpha is linear. Other elements and properties are left out and named.

mod faces;
mod header;
mod values;
mod vertices;

use super::allowance::Allowance;
use super::attributes::Present;
use super::error::{Read, malformed};
use super::file::Extent;
use super::images::Gauge;
use super::opened::{
    OpenOptions, OpenedMesh, OpenedScene, PIECE_TRIANGLES, Piece, Pieces, StreamedMesh, array_bytes,
};
use super::plain;
use super::scene::{Image, Material, Mesh};
use super::used::Used;
use super::warnings::Warnings;
use faces::FaceLayout;
use header::{Element, Encoding, Header};
use values::Values;
use vertices::{Columns, Table};

/// Bytes of a triangle and its material in a mesh.
const TRIANGLE_BYTES: u64 = 14;

/// Whether the file starts as a PLY does.
pub(super) fn is_ply(head: &[u8]) -> bool {
    head.starts_with(b"ply\n") || head.starts_with(b"ply\r")
}

/// Reads the PLY in `file`, with the texture that it names.
pub(super) fn read(
    file: &Extent,
    allowance: &Allowance,
    name: &str,
    options: &OpenOptions,
) -> Read<OpenedScene> {
    let mut warnings = Warnings::default();
    let header = header::parse(file)?;
    let mut plan = Plan::new(&header, options, &mut warnings)?;
    let before = warnings.clone();
    let body = match read_body(file, &header, &plan, allowance, &mut warnings)? {
        Some(body) => body,
        None => {
            // Polygons of many corners: the number of faces told little.
            plan.streamed = true;
            warnings = before;
            let body = read_body(file, &header, &plan, allowance, &mut warnings)?;
            body.ok_or_else(|| malformed("file", "the file as it was", "another"))?
        }
    };
    let (materials, images) = materials(&header, &body, allowance, &mut warnings)?;
    let listed = body.triangle_count;
    if body.triangle_count == 0 {
        let points = body.vertex_count;
        warnings.add(
            "points without triangles left out",
            points,
            "element vertex",
        );
        return Ok(plain::scene(name, None, materials, images, 0, warnings));
    }
    let mesh = match body.triangles {
        Triangles::InMemory(triangles) => {
            plain::check_triangle_count(triangles.len() as u64, "element face")?;
            let (mesh, _) = mesh(triangles, &body.table, &mut warnings)?;
            loaded(mesh, name, &mut warnings)
        }
        Triangles::InFile { layout, pieces } => {
            if !body.present.normals {
                let what = "normals not made for meshes that are read in pieces";
                warnings.add(what, 1, "element vertex");
            }
            let pieces = FilePieces {
                file: file.clone(),
                encoding: header.encoding,
                table: body.table,
                layout,
                starts: pieces,
                triangle_count: listed,
            };
            let mesh = StreamedMesh::new(name.to_owned(), vec![0], listed, Box::new(pieces));
            Some(OpenedMesh::Streamed(mesh))
        }
    };
    Ok(plain::scene(
        name, mesh, materials, images, listed, warnings,
    ))
}

fn loaded(mut mesh: Mesh, name: &str, warnings: &mut Warnings) -> Option<OpenedMesh> {
    if mesh.triangles.is_empty() {
        return None;
    }
    plain::complete_normals(&mut mesh, warnings);
    mesh.name = name.to_owned();
    mesh.material_slots = vec![0];
    Some(OpenedMesh::Loaded(mesh))
}

/// `triangles` over the table's vertices, with what they use of it. Normals may be missing or of no length.
fn mesh(
    mut triangles: Vec<[u32; 3]>,
    table: &Table,
    warnings: &mut Warnings,
) -> Read<(Mesh, Used)> {
    plain::drop_repeated(&mut triangles, "element face", warnings);
    let used = Used::by_first_use(&mut triangles);
    let mut mesh = Mesh {
        triangle_materials: vec![0; triangles.len()],
        triangles,
        ..Mesh::default()
    };
    table.read(&used, &mut mesh, warnings)?;
    Ok((mesh, used))
}

/// What the header says of the body.
struct Plan {
    columns: Columns,
    vertex_count: u64,
    streamed: bool,
    /// It can be, where it is not.
    in_place: bool,
    /// More triangles are not loaded, where they need not be.
    most_triangles: u64,
}

impl Plan {
    fn new(header: &Header, options: &OpenOptions, warnings: &mut Warnings) -> Read<Self> {
        let find = |name: &str| header.elements.iter().find(|it| it.name == name);
        let Some(vertices) = find("vertex") else {
            return Err(malformed("header", "element vertex", "none"));
        };
        if vertices.count >= u64::from(u32::MAX) {
            let expected = "fewer than 2^32 - 1 vertices";
            return Err(malformed("element vertex", expected, vertices.count));
        }
        let columns = Columns::find(vertices, warnings)?;
        let faces = find("face").map_or(0, |it| it.count);
        let bytes = array_bytes(vertices.count, faces, columns.present());
        // A text, or a list before a vertex, hides where a row starts.
        let in_place = header.encoding != Encoding::Text && vertices.row_bytes().is_some();
        let large = bytes > options.max_mesh_bytes && faces > 0;
        if large && !in_place {
            let what = "large meshes of a PLY of text, or with lists in its vertices, loaded whole";
            warnings.add(what, 1, "file");
        }
        Ok(Self {
            vertex_count: vertices.count,
            columns,
            streamed: large && in_place,
            in_place,
            most_triangles: (options.max_mesh_bytes / TRIANGLE_BYTES).max(faces),
        })
    }
}

struct Body {
    table: Table,
    present: Present,
    vertex_count: u64,
    triangles: Triangles,
    triangle_count: u64,
}

enum Triangles {
    InMemory(Vec<[u32; 3]>),
    InFile {
        layout: Option<FaceLayout>,
        pieces: Vec<PieceStart>,
    },
}

/// Where a piece starts.
#[derive(Clone, Copy)]
struct PieceStart {
    /// Of its first face in the file.
    offset: u64,
    face: u64,
    /// Triangles of that face that the piece before has.
    skip: u64,
}

/// Walks over all elements in the file's order, every one checked to its end.
/// `None` where there are more triangles than `plan` loads.
fn read_body(
    file: &Extent,
    header: &Header,
    plan: &Plan,
    allowance: &Allowance,
    warnings: &mut Warnings,
) -> Read<Option<Body>> {
    let mut values = Values::new(file, header.encoding, header.body_offset);
    let present = plan.columns.present();
    let mut columns = Some(plan.columns.clone());
    let mut table = None;
    let mut layout = None;
    let mut triangles = Vec::new();
    let mut pieces = Vec::new();
    let mut triangle_count = 0;
    let mut next_look = plain::BETWEEN_LOOKS;
    let held = |triangles: &Vec<[u32; 3]>| {
        let list = (triangles.capacity() * size_of::<[u32; 3]>()) as u64;
        let vertices = plan.vertex_count.min(3 * triangles.len() as u64);
        list + plain::completing_bytes(vertices, triangles.len() as u64)
    };
    for element in &header.elements {
        if element.name == "vertex"
            && let Some(columns) = columns.take()
        {
            table = Some(match element.row_bytes() {
                Some(_) if header.encoding != Encoding::Text => {
                    let encoding = header.encoding;
                    Table::in_file(file, &mut values, columns, element.count, encoding)?
                }
                _ => {
                    let bytes = Table::most_bytes(&values, element, &columns, header.encoding);
                    allowance.take(bytes, "element vertex")?;
                    Table::in_memory(&mut values, element, columns, header.encoding)?
                }
            });
            continue;
        }
        if element.name == "face" {
            layout = FaceLayout::find(element, plan.vertex_count, header.encoding, warnings)?;
        } else {
            let what = format!("elements {} left out", element.name);
            warnings.add(what, element.count, "header");
        }
        let Some(faces) = layout.as_ref().filter(|_| element.name == "face") else {
            skip(&mut values, element, header.encoding)?;
            continue;
        };
        let mut without = 0;
        for face in 0..faces.count {
            let start = PieceStart {
                offset: values.position(),
                face,
                skip: 0,
            };
            let mut of_face = 0;
            without += u64::from(!faces.read(&mut values, face, &mut |triangle| {
                match plan.streamed {
                    false => triangles.push(triangle),
                    true if (triangle_count + of_face) % PIECE_TRIANGLES == 0 => {
                        pieces.push(PieceStart {
                            skip: of_face,
                            ..start
                        });
                    }
                    true => {}
                }
                of_face += 1;
            })?);
            triangle_count += of_face;
            if triangles.len() < next_look {
                continue;
            }
            next_look = triangles.len() + plain::BETWEEN_LOOKS;
            let need = held(&triangles);
            let too_many = triangles.len() as u64 > plan.most_triangles;
            if plan.in_place && (too_many || need > allowance.left_bytes()) {
                return Ok(None);
            }
            allowance.fits(need, values.place())?;
        }
        warnings.add(
            "faces of fewer than three corners left out",
            without,
            "element face",
        );
    }
    let left = match header.encoding {
        Encoding::Text => u64::from(!values.blank_left()?) * values.left(),
        _ => values.left(),
    };
    warnings.add("bytes after the last element left out", left, "file");
    Ok(Some(Body {
        table: table.ok_or_else(|| malformed("header", "element vertex", "none"))?,
        present,
        vertex_count: plan.vertex_count,
        triangles: match plan.streamed {
            false => Triangles::InMemory(triangles),
            true => Triangles::InFile { layout, pieces },
        },
        triangle_count,
    }))
}

/// Leaves out an element.
fn skip(values: &mut Values, element: &Element, encoding: Encoding) -> Read<()> {
    if encoding != Encoding::Text
        && let Some(row_bytes) = element.row_bytes()
    {
        return values.skip_bytes(element.count.saturating_mul(row_bytes as u64));
    }
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            match property.kind {
                header::Kind::Scalar(scalar) => values.skip(scalar, 1)?,
                header::Kind::List { count, item } => {
                    let length = values.count(count)?;
                    values.skip(item, length)?;
                }
            }
        }
    }
    Ok(())
}

/// The plain surface, with the first texture that the header names.
fn materials(
    header: &Header,
    body: &Body,
    allowance: &Allowance,
    warnings: &mut Warnings,
) -> Read<(Vec<Material>, Vec<Image>)> {
    let mut material = plain::material();
    let mut images = Vec::new();
    let place = "comment TextureFile";
    if let Some(name) = header.textures.first()
        && body.present.uvs
        && body.triangle_count > 0
        && let Some(image) = Gauge::new(allowance).beside(name, place, warnings)?
    {
        material.base_color_image = Some(0);
        images.push(image);
    }
    let others = header.textures.len().saturating_sub(1) as u64;
    warnings.add("textures beside the first left out", others, place);
    Ok((vec![material], images))
}

/// The pieces of a binary file whose vertices have a fixed stride.
struct FilePieces {
    file: Extent,
    encoding: Encoding,
    table: Table,
    layout: Option<FaceLayout>,
    starts: Vec<PieceStart>,
    triangle_count: u64,
}

impl Pieces for FilePieces {
    fn count(&self) -> usize {
        self.starts.len()
    }

    fn read(&self, index: usize, warnings: &mut Warnings) -> Read<Piece> {
        let (Some(start), Some(layout)) = (self.starts.get(index), &self.layout) else {
            let expected = format!("a piece below {}", self.starts.len());
            return Err(malformed("element face", expected, index));
        };
        let before = index as u64 * PIECE_TRIANGLES;
        let count = (self.triangle_count - before).min(PIECE_TRIANGLES) as usize;
        let mut values = Values::new(&self.file, self.encoding, start.offset);
        let mut triangles = Vec::with_capacity(count);
        let mut skip = start.skip;
        let mut face = start.face;
        while triangles.len() < count && face < layout.count {
            layout.read(&mut values, face, &mut |triangle| {
                if skip > 0 {
                    skip -= 1;
                } else if triangles.len() < count {
                    triangles.push(triangle);
                }
            })?;
            face += 1;
        }
        let (mesh, used) = mesh(triangles, &self.table, warnings)?;
        Ok(Piece {
            mesh,
            array: 0,
            used: Some(used),
        })
    }
}

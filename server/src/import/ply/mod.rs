//! PLY (Turk, 1994): text and both byte orders; polygons of any size, strips, positions, normals,
//! colours, and texture coordinates of vertices or of corners.
//!
//! Texture coordinates run bottom-up in these files and top-down in the scene, so `v` becomes `1 - v`. Colours are sRGB
//! by the scanning programs' habit and become linear; alpha is linear. Other elements and properties are left out and named.

mod body;
mod faces;
mod header;
mod list;
mod pieces;
mod strips;
mod surface;
mod values;
mod vertices;

use super::allowance::Allowance;
use super::error::{Read, malformed};
use super::file::Extent;
use super::opened::{OpenOptions, OpenedMesh, OpenedScene, StreamedMesh, array_bytes};
use super::plain;
use super::scene::Mesh;
use super::warnings::Warnings;
use body::{LeftOut, Triangles};
use header::{Encoding, Header};
use pieces::FilePieces;
use vertices::Columns;

/// Bytes of a triangle and its material in a mesh.
const TRIANGLE_BYTES: u64 = 14;

/// Whether the file starts as a PLY does, its byte order mark apart.
pub(super) fn is_ply(head: &[u8]) -> bool {
    head.starts_with(b"ply\n") || head.starts_with(b"ply\r")
}

/// Reads the PLY in `file`, with the textures that it names.
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
    let body = loop {
        let changed = || malformed("file", "the file as it was", "another");
        warnings = before.clone();
        let Some(mut body) = body::read(file, &header, &plan, allowance, &mut warnings)? else {
            // Polygons of many corners: the number of faces told little.
            if std::mem::replace(&mut plan.streamed, true) {
                return Err(changed());
            }
            continue;
        };
        match (body.left_out.take(), &plan.left_out) {
            (None, Some(left_out)) if body.triangle_count == 0 => return Err(left_out.fault()),
            (None, _) => break body,
            // Faces stand before their vertices are measured: all are read once more.
            (Some(left_out), None) => plan.left_out = Some(left_out),
            (Some(_), Some(_)) => return Err(changed()),
        }
    };
    let (materials, images) = surface::materials(&header, &body, allowance, &mut warnings)?;
    let listed = body.triangle_count;
    if listed == 0 {
        let points = body.vertex_count;
        warnings.add(
            "points without triangles left out",
            points,
            "element vertex",
        );
        return Ok(plain::scene(name, None, materials, images, 0, warnings));
    }
    let slots: Vec<u32> = (0..materials.len() as u32).collect();
    let mesh = match body.triangles {
        Triangles::InMemory(mut list) => {
            plain::check_triangle_count(list.len() as u64, "element face")?;
            list.cut(&body.table, &mut warnings)?;
            let (mesh, _) = list.into_mesh(&body.table, &body.textures, &mut warnings)?;
            loaded(mesh, name, slots, &mut warnings)
        }
        Triangles::InFile { layout, starts } => {
            if !body.present.normals {
                let what = "normals not made for meshes that are read in pieces";
                warnings.add(what, 1, "element vertex");
            }
            let pieces = FilePieces {
                file: file.clone(),
                header,
                table: body.table,
                left_out: plan.left_out,
                layout,
                starts,
                triangle_count: listed,
                textures: body.textures,
            };
            let mesh = StreamedMesh::new(name.to_owned(), slots, listed, Box::new(pieces));
            Some(OpenedMesh::Streamed(mesh))
        }
    };
    let mesh = mesh.map(|mesh| (mesh, body.origin));
    Ok(plain::scene(
        name, mesh, materials, images, listed, warnings,
    ))
}

fn loaded(
    mut mesh: Mesh,
    name: &str,
    slots: Vec<u32>,
    warnings: &mut Warnings,
) -> Option<OpenedMesh> {
    if mesh.triangles.is_empty() {
        return None;
    }
    plain::complete_normals(&mut mesh, warnings);
    mesh.name = name.to_owned();
    mesh.material_slots = slots;
    Some(OpenedMesh::Loaded(mesh))
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
    left_out: Option<LeftOut>,
}

impl Plan {
    /// Whether the face of a triangle is left out.
    fn leaves_out(&self, triangle: [u32; 3]) -> bool {
        let left_out = self.left_out.as_ref();
        left_out.is_some_and(|it| it.has(triangle))
    }

    fn new(header: &Header, options: &OpenOptions, warnings: &mut Warnings) -> Read<Self> {
        let find = |name: &str| header.elements.iter().find(|it| it.name == name);
        let Some(vertices) = find("vertex") else {
            return Err(malformed("header", "element vertex", "none"));
        };
        if vertices.count >= u64::from(u32::MAX) {
            let expected = "fewer than 2^32 - 1 vertices";
            return Err(malformed("element vertex", expected, vertices.count));
        }
        let columns = Columns::find(vertices, header.encoding, warnings)?;
        let faces = find("face").map_or(0, |it| it.count);
        let bytes = array_bytes(vertices.count, faces, columns.present());
        // A text, or a list before a vertex, hides where a row starts; a strip has no faces.
        let in_place = header.encoding != Encoding::Text
            && vertices.row_bytes().is_some()
            && find("tristrips").is_none();
        let large = bytes > options.max_mesh_bytes && faces > 0;
        if large && !in_place {
            let what = "large meshes of a PLY of text, of strips, or with lists in its vertices, \
                loaded whole";
            warnings.add(what, 1, "file");
        }
        Ok(Self {
            vertex_count: vertices.count,
            columns,
            streamed: large && in_place,
            in_place,
            left_out: None,
            most_triangles: (options.max_mesh_bytes / TRIANGLE_BYTES).max(faces),
        })
    }
}

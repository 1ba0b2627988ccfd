//! STL: facets, binary or as text. Their normals are not read: each is the facet's own, which its
//! corners say too, and a smooth surface needs others. Corners at the same place become one vertex.
//!
//! The binary layout is the one of the format's sheet (3D Systems, 1989): 80 bytes of anything, a
//! count, and 50 bytes a facet.

mod binary;
mod words;

use super::allowance::Allowance;
use super::error::Read;
use super::file::Extent;
use super::opened::{OpenOptions, OpenedMesh, OpenedScene};
use super::origin::{Bounds, Origin};
use super::scene::Mesh;
use super::warnings::Warnings;
use super::weld::Weld;
use super::{plain, text};

pub(super) use binary::is_binary;

/// Bytes that tell a text.
const HEAD_BYTES: u64 = 1 << 12;
/// Warning for facets with a corner that is nowhere.
const NOT_FINITE: &str = "facets that are not finite left out";

/// Whether the file starts as an STL of text does, its byte order mark apart.
pub(super) fn looks_like_text(head: &[u8]) -> bool {
    let start = head.trim_ascii_start();
    let keyword = start
        .get(..5)
        .is_some_and(|it| it.eq_ignore_ascii_case(b"solid"));
    // Binary files of some programs start with the word, too, and go on with zeros. Texts end with
    // zeros at most, but for broken ones.
    let has_vertex = || head.windows(6).any(|it| it.eq_ignore_ascii_case(b"vertex"));
    keyword && (!without_end(head).contains(&0) || has_vertex())
}

/// `head` without the zeros that some programs fill up a text with.
fn without_end(head: &[u8]) -> &[u8] {
    let length = head.iter().rposition(|&it| !words::is_end(it));
    &head[..length.map_or(0, |at| at + 1)]
}

/// Whether there is nothing but text, so that what is wrong is wrong with a text.
fn is_all_text(head: &[u8]) -> bool {
    let is_text = |it: &u8| !it.is_ascii_control() || it.is_ascii_whitespace();
    !head.trim_ascii().is_empty() && head.iter().all(is_text)
}

/// Reads the STL in `file`.
pub(super) fn read(
    file: &Extent,
    allowance: &Allowance,
    name: &str,
    options: &OpenOptions,
) -> Read<OpenedScene> {
    let mut warnings = Warnings::default();
    let head = file.head(HEAD_BYTES)?;
    let (mark, start) = (text::mark_bytes(&head), text::without_mark(&head));
    if is_binary(file)? || !(looks_like_text(start) || is_all_text(start)) {
        return binary::read(file, name, options, warnings);
    }
    let text = file.slice(mark, file.len() - mark);
    let listed = words::read(text.as_ref().unwrap_or(file), allowance, &mut warnings)?;
    let place = format!("facet that ends at line {}", listed.first_line);
    warnings.add(NOT_FINITE, listed.not_finite, &place);
    let origin = Origin::of(Bounds::of(listed.facets.iter().flatten().copied()));
    let mut corners = Corners::new(0);
    for (at, facet) in listed.facets.iter().enumerate() {
        corners.push(facet.map(|corner| origin.local(corner)));
        if at.is_multiple_of(plain::BETWEEN_LOOKS) {
            allowance.fits(listed.held_bytes() + corners.held_bytes(), "file")?;
        }
    }
    allowance.fits(listed.held_bytes() + corners.held_bytes(), "file")?;
    let count = listed.facets.len() as u64;
    drop(listed);
    let mesh = corners.into_mesh("file", &mut warnings);
    Ok(loaded(name, mesh, origin, count, warnings))
}

fn loaded(
    name: &str,
    mut mesh: Mesh,
    origin: Origin,
    listed: u64,
    mut warnings: Warnings,
) -> OpenedScene {
    let mesh = (!mesh.triangles.is_empty()).then(|| {
        plain::complete_normals(&mut mesh, &mut warnings);
        mesh.name = name.to_owned();
        mesh.material_slots = vec![0];
        (OpenedMesh::Loaded(mesh), origin)
    });
    let materials = vec![plain::material()];
    plain::scene(name, mesh, materials, vec![], listed, warnings)
}

/// Facets on their way to a mesh.
struct Corners {
    weld: Weld,
    triangles: Vec<[u32; 3]>,
}

impl Corners {
    /// `triangles`: about how many are awaited. A closed surface has half as many vertices.
    fn new(triangles: usize) -> Self {
        Self {
            weld: Weld::new(triangles / 2),
            triangles: Vec::with_capacity(triangles),
        }
    }

    /// Appends a facet, whose corners are finite.
    fn push(&mut self, facet: [[f32; 3]; 3]) {
        self.triangles
            .push(facet.map(|corner| self.weld.vertex(corner)));
    }

    /// Bytes that are held, and those that the mesh of it takes.
    fn held_bytes(&self) -> u64 {
        let triangles = self.triangles.capacity() * size_of::<[u32; 3]>();
        let completing = plain::completing_bytes(
            self.weld.positions.len() as u64,
            self.triangles.len() as u64,
        );
        triangles as u64 + self.weld.held_bytes() + completing
    }

    fn into_mesh(mut self, place: &str, warnings: &mut Warnings) -> Mesh {
        plain::drop_repeated(&mut self.triangles, place, warnings);
        let mut mesh = Mesh {
            positions: self.weld.positions,
            triangle_materials: vec![0; self.triangles.len()],
            triangles: self.triangles,
            ..Mesh::default()
        };
        plain::drop_unused(&mut mesh);
        mesh
    }
}

//! Mesh: the primitives of one glTF mesh over one vertex array.

use std::collections::HashMap;
use std::ops::Range;

use super::Document;
use super::attributes::{Attributes, Present};
use super::complete;
use super::error::{Read, malformed};
use super::materials;
use super::nodes::Shape;
use super::opened::{OpenedMesh, array_bytes};
use super::pose::Pose;
use super::primitive::{self, TrianglePrimitive, VertexSource};
use super::primitive_pieces;
use super::scene::{Mesh, short_name};
use super::used::Used;
use super::warnings::Warnings;

/// A mesh, or why it came to nothing.
pub(super) struct BuiltMesh {
    /// `None` without a triangle. Slots hold indices into the document's materials; their number stands for the default
    /// material.
    pub(super) mesh: Option<OpenedMesh>,
    pub(super) source_triangles: u64,
    pub(super) warnings: Warnings,
}

/// Builds a mesh of the document, or leaves it in its file where its arrays would take more than
/// `most_bytes`.
pub(super) fn build(document: &Document, shape: &Shape, most_bytes: u64) -> Read<BuiltMesh> {
    let index = shape.mesh;
    let pose = shape.pose.as_deref();
    let source = &document.root.meshes[index];
    let place = format!("meshes[{index}]");
    let name = source.name.0.as_deref().map(short_name);
    let name = name.unwrap_or_else(|| format!("mesh_{index}"));
    let mut warnings = Warnings::default();
    let mut primitives = Vec::new();
    for (at, primitive) in source.primitives.iter().enumerate() {
        let place = format!("{place}.primitives[{at}]");
        primitives.extend(primitive::check(
            document,
            primitive,
            pose,
            place,
            &mut warnings,
        )?);
    }
    primitives.retain(|primitive| primitive.triangle_count > 0);
    note_missing_uvs(document, &primitives, &mut warnings);
    let mut built = match arrays_bytes(&primitives) > most_bytes {
        true => stream(document, name, primitives, pose, &place, &mut warnings)?,
        false => load(document, name, primitives, pose, &place, &mut warnings)?,
    };
    if built.mesh.is_none() {
        warnings.add("meshes without triangles left out", 1, &place);
    }
    built.warnings = warnings;
    Ok(built)
}

fn note_missing_uvs(
    document: &Document,
    primitives: &[TrianglePrimitive],
    warnings: &mut Warnings,
) {
    for primitive in primitives {
        let material = primitive.material.map(|at| &document.root.materials[at]);
        if let Some(set) = material.and_then(materials::textured_uv_set)
            && primitive.source.uv.is_none()
        {
            let what = format!("textured primitives without TEXCOORD_{set}");
            warnings.add(what, 1, &primitive.place);
        }
    }
}

/// Which attributes the mesh has. `all_normals`: only where no primitive is without.
fn present(primitives: &[TrianglePrimitive], all_normals: bool) -> Present {
    let any = |has: fn(&VertexSource) -> bool| primitives.iter().any(|it| has(&it.source));
    let has_normals = |source: &VertexSource| source.normal.is_some();
    Present {
        normals: match all_normals {
            true => primitives.iter().all(|it| has_normals(&it.source)),
            false => any(has_normals),
        },
        uvs: any(|source| source.uv.is_some()),
        colors: any(|source| source.color.is_some()),
    }
}

/// What the arrays would take at most, going by the counts alone.
fn arrays_bytes(primitives: &[TrianglePrimitive]) -> u64 {
    let mut corners_of_source: HashMap<&VertexSource, (u64, u64)> = HashMap::new();
    let mut triangles = 0u64;
    for primitive in primitives {
        let entry = corners_of_source.entry(&primitive.source).or_default();
        entry.0 = primitive.vertex_count as u64;
        entry.1 = entry
            .1
            .saturating_add(primitive.triangle_count.saturating_mul(3));
        triangles = triangles.saturating_add(primitive.triangle_count);
    }
    let vertices = corners_of_source
        .values()
        .map(|(vertices, corners)| vertices.min(corners));
    let vertices = vertices.fold(0u64, |sum, it| sum.saturating_add(*it));
    array_bytes(vertices, triangles, present(primitives, false))
}

fn stream(
    document: &Document,
    name: String,
    primitives: Vec<TrianglePrimitive>,
    pose: Option<&Pose>,
    place: &str,
    warnings: &mut Warnings,
) -> Read<BuiltMesh> {
    let present = present(&primitives, true);
    if !present.normals {
        let what = "normals not made for meshes that are read in pieces";
        warnings.add(what, 1, place);
    }
    let mut source_triangles = 0;
    for primitive in &primitives {
        source_triangles += primitive.meant_triangles()?;
    }
    let mesh = primitive_pieces::open(document, name, primitives, present, pose, place)?;
    Ok(BuiltMesh {
        mesh: Some(OpenedMesh::Streamed(mesh)),
        source_triangles,
        warnings: Warnings::default(),
    })
}

fn load(
    document: &Document,
    name: String,
    primitives: Vec<TrianglePrimitive>,
    pose: Option<&Pose>,
    place: &str,
    warnings: &mut Warnings,
) -> Read<BuiltMesh> {
    let mut source_triangles = 0;
    let mut parts = Vec::with_capacity(primitives.len());
    for primitive in primitives {
        // Corners are counted in 32 bits from here on.
        let most = u64::from(u32::MAX) / 3;
        if primitive.triangle_count > most {
            let expected = format!("{most} triangles at most in a mesh");
            return Err(malformed(place, expected, primitive.triangle_count));
        }
        let triangles = primitive.triangles(0..primitive.triangle_count, warnings)?;
        source_triangles += match primitive.is_list() {
            true => primitive.triangle_count,
            false => triangles.len() as u64,
        };
        if !triangles.is_empty() {
            parts.push(Part {
                primitive,
                triangles,
            });
        }
    }
    let triangles: usize = parts.iter().map(|it| it.triangles.len()).sum();
    if triangles > u32::MAX as usize / 3 {
        let expected = format!("{} triangles at most in a mesh", u32::MAX / 3);
        return Err(malformed(place, expected, triangles));
    }
    let mut mesh = Mesh {
        name,
        ..Mesh::default()
    };
    merge_vertices(document, &mut parts, pose, &mut mesh, place, warnings)?;
    let bare = merge_triangles(document, parts, &mut mesh, place)?;
    if triangles > 0 {
        let given = mesh.normals.take().unwrap_or_default();
        complete::complete(&mut mesh, given, &bare, place, warnings);
    }
    Ok(BuiltMesh {
        mesh: (triangles > 0).then_some(OpenedMesh::Loaded(mesh)),
        source_triangles,
        warnings: Warnings::default(),
    })
}

/// A primitive with its triangles.
struct Part {
    primitive: TrianglePrimitive,
    triangles: Vec<[u32; 3]>,
}

/// The used vertices of one source, and where they stand in the mesh.
struct Group {
    source: VertexSource,
    /// The first primitive with this source, for messages.
    place: String,
    used: Used,
}

/// Fills the vertex arrays and points the triangles into them. Normals are zero where there are none, and are missing where
/// no primitive has them.
fn merge_vertices(
    document: &Document,
    parts: &mut [Part],
    pose: Option<&Pose>,
    mesh: &mut Mesh,
    place: &str,
    warnings: &mut Warnings,
) -> Read<()> {
    let groups = group(parts, place)?;
    let any = |has: fn(&VertexSource) -> bool| groups.iter().any(|group| has(&group.source));
    let present = Present {
        normals: any(|source| source.normal.is_some()),
        uvs: any(|source| source.uv.is_some()),
        colors: any(|source| source.color.is_some()),
    };
    for group in &groups {
        let attributes = Attributes::open(document, &group.source, pose, &group.place)?;
        attributes.read(&group.used, present, mesh, &group.place, warnings)?;
    }
    Ok(())
}

/// Gathers the primitives' vertices by source and numbers the triangles by the mesh's vertices to be.
fn group(parts: &mut [Part], place: &str) -> Read<Vec<Group>> {
    let mut members: Vec<Vec<usize>> = Vec::new();
    let mut group_of_source = HashMap::new();
    for (at, part) in parts.iter().enumerate() {
        let group = *group_of_source
            .entry(part.primitive.source.clone())
            .or_insert(members.len());
        if group == members.len() {
            members.push(Vec::new());
        }
        members[group].push(at);
    }
    let mut groups = Vec::with_capacity(members.len());
    let mut base = 0usize;
    for members in members {
        let first = &parts[members[0]].primitive;
        let (source, vertex_count) = (first.source.clone(), first.vertex_count);
        let first_place = first.place.clone();
        let used = used_vertices(&members, parts);
        // Every later index is below this one.
        if base + used.len() >= u32::MAX as usize {
            let found = format!("{} or more", base + used.len());
            return Err(malformed(place, "fewer than 2^32 - 1 vertices", found));
        }
        let numbers = Numbers::new(&used, vertex_count, base as u32);
        for &member in &members {
            for corner in parts[member].triangles.iter_mut().flatten() {
                *corner = numbers.of(&used, *corner);
            }
        }
        base += used.len();
        groups.push(Group {
            source,
            place: first_place,
            used: Used::in_order(used),
        });
    }
    Ok(groups)
}

fn used_vertices(members: &[usize], parts: &[Part]) -> Vec<u32> {
    let corners = || {
        let triangles = members.iter().flat_map(|&at| &parts[at].triangles);
        triangles.flatten().copied()
    };
    let vertex_count = parts[members[0]].primitive.vertex_count;
    if is_sparse(corners().count(), vertex_count) {
        let mut used: Vec<u32> = corners().collect();
        used.sort_unstable();
        used.dedup();
        return used;
    }
    let mut in_use = vec![false; vertex_count];
    for corner in corners() {
        in_use[corner as usize] = true;
    }
    let vertices = 0..vertex_count as u32;
    vertices.filter(|&vertex| in_use[vertex as usize]).collect()
}

/// A table over all vertices is only worth its memory where a good part of them is used: many primitives may each
/// use a little of one large accessor.
fn is_sparse(used: usize, vertex_count: usize) -> bool {
    used < vertex_count / 8
}

/// From a source's vertices to the mesh's.
enum Numbers {
    Table(Vec<u32>),
    Search { base: u32 },
}

impl Numbers {
    fn new(used: &[u32], vertex_count: usize, base: u32) -> Self {
        if is_sparse(used.len(), vertex_count) {
            return Self::Search { base };
        }
        let mut table = vec![0; vertex_count];
        for (number, &vertex) in used.iter().enumerate() {
            table[vertex as usize] = base + number as u32;
        }
        Self::Table(table)
    }

    fn of(&self, used: &[u32], vertex: u32) -> u32 {
        match self {
            Self::Table(table) => table[vertex as usize],
            Self::Search { base } => {
                let number = used.partition_point(|&other| other < vertex);
                base + number as u32
            }
        }
    }
}

/// Strings the primitives' triangles together and numbers their materials by slots. Gives the ranges of triangles whose
/// primitives have no normals.
fn merge_triangles(
    document: &Document,
    parts: Vec<Part>,
    mesh: &mut Mesh,
    place: &str,
) -> Read<Vec<Range<usize>>> {
    let mut bare: Vec<Range<usize>> = Vec::new();
    let mut slots = Slots::default();
    let default_material = document.root.materials.len();
    for Part {
        primitive,
        triangles,
    } in parts
    {
        let material = primitive.material.unwrap_or(default_material) as u32;
        let slot = slots.slot(material, place)?;
        let start = mesh.triangles.len();
        let length = start + triangles.len();
        if primitive.source.normal.is_none() {
            match bare.last_mut() {
                Some(range) if range.end == start => range.end = length,
                _ => bare.push(start..length),
            }
        }
        mesh.triangles.extend(triangles);
        mesh.triangle_materials.resize(length, slot);
    }
    mesh.material_slots = slots.materials;
    Ok(bare)
}

/// Materials of a mesh by slot.
#[derive(Default)]
pub(super) struct Slots {
    slot_of_material: HashMap<u32, usize>,
    pub(super) materials: Vec<u32>,
}

impl Slots {
    /// The slot of `material`, a new one at its first mention.
    pub(super) fn slot(&mut self, material: u32, place: &str) -> Read<u16> {
        let next = self.materials.len();
        let slot = *self.slot_of_material.entry(material).or_insert(next);
        if slot == next {
            self.materials.push(material);
        }
        u16::try_from(slot)
            .map_err(|_| malformed(place, "65536 materials at most in a mesh", "more"))
    }
}

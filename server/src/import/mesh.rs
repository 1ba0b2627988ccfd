//! Mesh: the primitives of one glTF mesh over one vertex array.

use std::collections::HashMap;
use std::ops::Range;

use super::Document;
use super::attributes;
use super::complete;
use super::error::{Read, malformed};
use super::nodes::Placed;
use super::primitive::{self, PrimitiveTriangles, VertexSource};
use super::scene::Mesh;
use super::warnings::Warnings;

/// A mesh, or why it came to nothing.
pub(super) struct BuiltMesh {
    /// `None` without a triangle. `material_slots` hold indices into the document's materials; their number stands for
    /// the default material.
    pub(super) mesh: Option<Mesh>,
    pub(super) source_triangles: u64,
    pub(super) warnings: Warnings,
}

/// Corners that accessors may give beyond their own bytes by being shared: each reference copies them.
const MOST_CORNERS_PER_BYTE: u64 = 64;
const CORNERS_ALWAYS: u64 = 1 << 24;

/// Refuses a small file that unfolds to a huge one by naming one accessor from very many primitives.
pub(super) fn check_sharing(document: &Document, placed: &Placed) -> Read<()> {
    let count_of = |index: usize| {
        let accessor = document.root.accessors.get(index);
        accessor.map_or(0, |it| {
            let sparse = it.sparse.as_ref().map_or(0, |sparse| sparse.count.0);
            it.count.0.saturating_add(sparse)
        })
    };
    let bytes = document.buffers.total_bytes();
    let most = (bytes.saturating_mul(MOST_CORNERS_PER_BYTE)).max(CORNERS_ALWAYS);
    let mut corners = 0u64;
    let meshes = document.root.meshes.iter().enumerate();
    for (at, mesh) in meshes.filter(|&(at, _)| placed.mesh_used[at]) {
        for primitive in &mesh.primitives {
            let vertices = primitive.attributes.values().next().copied();
            let order = primitive.indices.or(vertices);
            corners = corners.saturating_add(order.map_or(0, |index| count_of(index.value())));
        }
        if corners > most {
            let expected = format!("{most} corners at most from {bytes} bytes of buffers");
            return Err(malformed(format!("meshes[{at}]"), expected, corners));
        }
    }
    Ok(())
}

/// Builds `meshes[index]` of the document.
pub(super) fn build(document: &Document, index: usize) -> Read<BuiltMesh> {
    let source = &document.root.meshes[index];
    let place = format!("meshes[{index}]");
    let mut warnings = Warnings::default();
    let mut primitives = Vec::new();
    for (at, primitive) in source.primitives.iter().enumerate() {
        let place = format!("{place}.primitives[{at}]");
        let read = primitive::read(document, primitive, place, &mut warnings)?;
        primitives.extend(read);
    }
    let source_triangles = primitives.iter().map(|it| it.source_triangles).sum();
    primitives.retain(|primitive| !primitive.triangles.is_empty());
    if primitives.is_empty() {
        warnings.add("meshes without triangles left out", 1, &place);
        return Ok(BuiltMesh {
            mesh: None,
            source_triangles,
            warnings,
        });
    }
    // Corners are counted in 32 bits from here on.
    let triangles: usize = primitives.iter().map(|it| it.triangles.len()).sum();
    if triangles > u32::MAX as usize / 3 {
        let expected = format!("{} triangles at most in a mesh", u32::MAX / 3);
        return Err(malformed(place, expected, triangles));
    }
    let mut mesh = Mesh {
        name: source
            .name
            .clone()
            .unwrap_or_else(|| format!("mesh_{index}")),
        ..Mesh::default()
    };
    let given = merge_vertices(document, &mut primitives, &mut mesh, &place, &mut warnings)?;
    let bare = merge_triangles(document, primitives, &mut mesh, &place, &mut warnings)?;
    complete::complete(&mut mesh, given, &bare, &place, &mut warnings);
    Ok(BuiltMesh {
        mesh: Some(mesh),
        source_triangles,
        warnings,
    })
}

/// The used vertices of one source, and where they stand in the mesh.
struct Group {
    source: VertexSource,
    /// The first primitive with this source, for messages.
    place: String,
    /// Vertices of the source in use, ascending.
    used: Vec<u32>,
}

/// Fills the vertex arrays and points the primitives' triangles into them. Gives the file's normals, zero where there are
/// none, nothing where no primitive has them.
fn merge_vertices(
    document: &Document,
    primitives: &mut [PrimitiveTriangles],
    mesh: &mut Mesh,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Vec<[f32; 3]>> {
    let groups = group(primitives, place)?;
    let any = |has: fn(&VertexSource) -> bool| groups.iter().any(|group| has(&group.source));
    let (any_normals, any_uvs, any_colors) = (
        any(|source| source.normal.is_some()),
        any(|source| source.uv.is_some()),
        any(|source| source.color.is_some()),
    );
    let mut uvs = Vec::new();
    let mut colors = Vec::new();
    let mut given_normals = Vec::new();
    for Group {
        source,
        place,
        used,
    } in &groups
    {
        let positions = attributes::positions(document, source.position, used, place)?;
        mesh.positions.extend(positions);
        let length = mesh.positions.len();
        if let Some(accessor) = source.normal {
            given_normals.extend(attributes::normals(
                document, accessor, used, place, warnings,
            )?);
        }
        // Zero where there are none; they are made below.
        given_normals.resize(if any_normals { length } else { 0 }, [0.0; 3]);
        match source.uv {
            Some(accessor) => {
                uvs.extend(attributes::uvs(document, accessor, used, place, warnings)?);
            }
            None if any_uvs => {
                let what = "vertices without TEXCOORD_0 beside others with it set to (0, 0)";
                warnings.add(what, used.len() as u64, place);
                uvs.resize(length, [0.0; 2]);
            }
            None => {}
        }
        if let Some(accessor) = source.color {
            colors.extend(attributes::colors(
                document, accessor, used, place, warnings,
            )?);
        }
        colors.resize(if any_colors { length } else { 0 }, [u8::MAX; 4]);
    }
    mesh.uvs = any_uvs.then_some(uvs);
    mesh.colors = any_colors.then_some(colors);
    Ok(given_normals)
}

/// Gathers the primitives' vertices by source and numbers the triangles by the mesh's vertices to be.
fn group(primitives: &mut [PrimitiveTriangles], place: &str) -> Read<Vec<Group>> {
    let mut members: Vec<Vec<usize>> = Vec::new();
    let mut group_of_source = HashMap::new();
    for (at, primitive) in primitives.iter().enumerate() {
        let group = *group_of_source
            .entry(primitive.source)
            .or_insert(members.len());
        if group == members.len() {
            members.push(Vec::new());
        }
        members[group].push(at);
    }
    let mut groups = Vec::with_capacity(members.len());
    let mut base = 0usize;
    for members in members {
        let first = &primitives[members[0]];
        let (source, first_place) = (first.source, first.place.clone());
        let used = used_vertices(&members, primitives);
        // Every later index is below this one.
        if base + used.len() >= u32::MAX as usize {
            let found = format!("{} or more", base + used.len());
            return Err(malformed(place, "fewer than 2^32 - 1 vertices", found));
        }
        let numbers = Numbers::new(&used, first.vertex_count, base as u32);
        for &member in &members {
            for corner in primitives[member].triangles.iter_mut().flatten() {
                *corner = numbers.of(&used, *corner);
            }
        }
        base += used.len();
        groups.push(Group {
            source,
            place: first_place,
            used,
        });
    }
    Ok(groups)
}

fn used_vertices(members: &[usize], primitives: &[PrimitiveTriangles]) -> Vec<u32> {
    let corners = || {
        let triangles = members.iter().flat_map(|&at| &primitives[at].triangles);
        triangles.flatten().copied()
    };
    let vertex_count = primitives[members[0]].vertex_count;
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
    primitives: Vec<PrimitiveTriangles>,
    mesh: &mut Mesh,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Vec<Range<usize>>> {
    let materials = &document.root.materials;
    let mut bare: Vec<Range<usize>> = Vec::new();
    let mut slot_of_material = HashMap::new();
    for primitive in primitives {
        let textured = primitive.material.is_some_and(|it| {
            materials[it]
                .pbr_metallic_roughness
                .base_color_texture
                .is_some()
        });
        if textured && primitive.source.uv.is_none() {
            let what = "textured primitives without TEXCOORD_0";
            warnings.add(what, 1, &primitive.place);
        }
        let material = primitive.material.unwrap_or(materials.len()) as u32;
        let next = mesh.material_slots.len();
        let slot = *slot_of_material.entry(material).or_insert(next);
        if slot == next {
            mesh.material_slots.push(material);
        }
        let Ok(slot) = u16::try_from(slot) else {
            return Err(malformed(
                place,
                "65536 materials at most in a mesh",
                "more",
            ));
        };
        let start = mesh.triangles.len();
        let length = start + primitive.triangles.len();
        if primitive.source.normal.is_none() {
            match bare.last_mut() {
                Some(range) if range.end == start => range.end = length,
                _ => bare.push(start..length),
            }
        }
        mesh.triangles.extend(primitive.triangles);
        mesh.triangle_materials.resize(length, slot);
    }
    Ok(bare)
}

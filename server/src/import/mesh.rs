//! Mesh: the primitives of one glTF mesh over one vertex array.

use std::collections::HashMap;

use super::Document;
use super::attributes;
use super::error::{Read, malformed};
use super::nodes::Placed;
use super::normals;
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
    merge_vertices(document, &mut primitives, &mut mesh, &place, &mut warnings)?;
    merge_triangles(document, primitives, &mut mesh, &place, &mut warnings)?;
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

/// Fills the vertex arrays and points the primitives' triangles into them.
fn merge_vertices(
    document: &Document,
    primitives: &mut [PrimitiveTriangles],
    mesh: &mut Mesh,
    place: &str,
    warnings: &mut Warnings,
) -> Read<()> {
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
    merge_normals(primitives, mesh, given_normals, place, warnings);
    Ok(())
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

/// Mends the given normals, which are zero where they are unusable, and makes those of the primitives without.
fn merge_normals(
    primitives: &mut [PrimitiveTriangles],
    mesh: &mut Mesh,
    mut given: Vec<[f32; 3]>,
    place: &str,
    warnings: &mut Warnings,
) {
    let (bare, dressed): (Vec<_>, Vec<_>) = primitives
        .iter_mut()
        .partition(|primitive| primitive.source.normal.is_none());
    let mut with_normals: Vec<[u32; 3]> = Vec::new();
    for primitive in &dressed {
        with_normals.extend(&primitive.triangles);
    }
    if bare.is_empty() {
        let mended = normals::mend(&mesh.positions, &with_normals, &mut given);
        warnings.add("normals of no length made anew", mended, place);
        mesh.normals = Some(given);
        return;
    }
    let mut without: Vec<[u32; 3]> = Vec::new();
    for primitive in &bare {
        without.extend(&primitive.triangles);
    }
    let made = normals::make(&mesh.positions, &mut without);

    // The vertices with normals keep their order and come first; the made ones follow.
    let mut sources = Vec::new();
    let mut number = vec![0; mesh.positions.len()];
    let mut is_kept = vec![false; mesh.positions.len()];
    for &vertex in with_normals.iter().flatten() {
        is_kept[vertex as usize] = true;
    }
    for vertex in (0..mesh.positions.len()).filter(|&vertex| is_kept[vertex]) {
        number[vertex] = sources.len() as u32;
        sources.push(vertex as u32);
    }
    let kept = sources.len() as u32;
    sources.extend(&made.sources);
    let mut all_normals: Vec<[f32; 3]> = Vec::with_capacity(sources.len());
    all_normals.extend(
        sources[..kept as usize]
            .iter()
            .map(|&it| given[it as usize]),
    );
    gather(mesh, &sources);
    for primitive in dressed {
        for corner in primitive.triangles.iter_mut().flatten() {
            *corner = number[*corner as usize];
        }
    }
    let mut made_triangles = without.into_iter();
    for primitive in bare {
        for (triangle, made) in primitive.triangles.iter_mut().zip(&mut made_triangles) {
            *triangle = made.map(|corner| kept + corner);
        }
    }
    let kept_triangles: Vec<[u32; 3]> = with_normals
        .into_iter()
        .map(|triangle| triangle.map(|corner| number[corner as usize]))
        .collect();
    let mended = normals::mend(&mesh.positions, &kept_triangles, &mut all_normals);
    warnings.add("normals of no length made anew", mended, place);
    all_normals.extend(made.normals);
    mesh.normals = Some(all_normals);
}

/// Replaces the vertices by copies of `sources`.
fn gather(mesh: &mut Mesh, sources: &[u32]) {
    fn pick<T: Copy>(values: &[T], sources: &[u32]) -> Vec<T> {
        sources.iter().map(|&at| values[at as usize]).collect()
    }
    mesh.positions = pick(&mesh.positions, sources);
    mesh.uvs = mesh.uvs.take().map(|it| pick(&it, sources));
    mesh.colors = mesh.colors.take().map(|it| pick(&it, sources));
}

/// Strings the primitives' triangles together and numbers their materials by slots.
fn merge_triangles(
    document: &Document,
    primitives: Vec<PrimitiveTriangles>,
    mesh: &mut Mesh,
    place: &str,
    warnings: &mut Warnings,
) -> Read<()> {
    let materials = &document.root.materials;
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
        let length = mesh.triangles.len() + primitive.triangles.len();
        mesh.triangles.extend(primitive.triangles);
        mesh.triangle_materials.resize(length, slot);
    }
    Ok(())
}

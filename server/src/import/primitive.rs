//! Primitive: one glTF primitive to triangles over its vertex accessors.

use gltf::json::accessor::ComponentType;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::Document;
use super::accessor::{Accessor, Component};
use super::buffers::out_of_range;
use super::error::{Read, malformed};
use super::features;
use super::warnings::Warnings;

/// The accessors that make up a primitive's vertices. Primitives with equal sources share their vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct VertexSource {
    pub(super) position: usize,
    pub(super) normal: Option<usize>,
    pub(super) uv: Option<usize>,
    pub(super) color: Option<usize>,
}

/// A primitive's triangles.
pub(super) struct PrimitiveTriangles {
    /// `meshes[3].primitives[0]`
    pub(super) place: String,
    pub(super) source: VertexSource,
    /// Vertices that `source` holds; the triangles use some of them.
    pub(super) vertex_count: usize,
    /// Three different indices below `vertex_count` each.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Index into the document's materials.
    pub(super) material: Option<usize>,
    /// `triangles` and those of a list that repeat an index.
    pub(super) source_triangles: u64,
}

/// Reads the triangles of `primitive`, or notes why it has none.
pub(super) fn read(
    document: &Document,
    primitive: &Primitive,
    place: String,
    warnings: &mut Warnings,
) -> Read<Option<PrimitiveTriangles>> {
    if let Some(mode) = features::mode_without_triangles(primitive.mode) {
        warnings.add(format!("{mode} primitives left out"), 1, &place);
        return Ok(None);
    }
    let Checked::Valid(mode) = primitive.mode else {
        return Err(malformed(
            format!("{place}.mode"),
            "a number in 0..=6",
            "another",
        ));
    };
    let targets = primitive.targets.as_ref().map_or(0, Vec::len);
    warnings.add("morph targets left out", targets as u64, &place);
    let Some((source, vertex_count)) = read_source(document, primitive, &place, warnings)? else {
        warnings.add("primitives without POSITION left out", 1, &place);
        return Ok(None);
    };
    let material = primitive.material.map(|material| material.value());
    let materials = document.root.materials.len();
    if let Some(material) = material.filter(|&material| material >= materials) {
        let place = format!("{place}.material");
        return Err(out_of_range(&place, "materials", materials, material));
    }
    let corners = Corners::open(document, primitive, vertex_count, &place)?;
    if mode == Mode::Triangles {
        let rest = corners.count() % 3;
        warnings.add(
            "corners after the last whole triangle left out",
            rest as u64,
            &place,
        );
    }
    let mut triangles = read_triangles(&corners, mode)?;
    let listed = triangles.len();
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    let repeated = (listed - triangles.len()) as u64;
    // A strip or fan repeats an index to turn a corner; in a list it is a triangle that its author wrote.
    let repeated = if mode == Mode::Triangles { repeated } else { 0 };
    warnings.add("triangles with a repeated index left out", repeated, &place);
    Ok(Some(PrimitiveTriangles {
        source_triangles: triangles.len() as u64 + repeated,
        place,
        source,
        vertex_count,
        triangles,
        material,
    }))
}

/// Checks every attribute's accessor and count; `None` without POSITION.
fn read_source(
    document: &Document,
    primitive: &Primitive,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Option<(VertexSource, usize)>> {
    let find = |semantic| primitive.attributes.get(&Checked::Valid(semantic));
    let Some(position) = find(Semantic::Positions) else {
        return Ok(None);
    };
    let accessors = &document.root.accessors;
    let count_of = |index: usize, place: &str| match accessors.get(index) {
        Some(accessor) => Ok(accessor.count.0),
        None => Err(out_of_range(place, "accessors", accessors.len(), index)),
    };
    let count = count_of(position.value(), &format!("{place}.attributes.POSITION"))?;
    for (semantic, index) in &primitive.attributes {
        let name = semantic.to_string();
        let attribute = format!("{place}.attributes.{name}");
        let found = count_of(index.value(), &attribute)?;
        if found != count {
            let expected = format!("{count} elements, as many as POSITION");
            let attribute = format!("{attribute} (accessor {})", index.value());
            return Err(malformed(attribute, expected, found));
        }
        // JOINTS and WEIGHTS go with their skins, which have a line of their own.
        if !matches!(
            semantic,
            Checked::Valid(
                Semantic::Positions
                    | Semantic::Normals
                    | Semantic::TexCoords(0)
                    | Semantic::Colors(0)
                    | Semantic::Joints(_)
                    | Semantic::Weights(_)
            )
        ) {
            warnings.add(format!("attributes {name} left out"), 1, place);
        }
    }
    let vertex_count = match u32::try_from(count) {
        Ok(count) if count < u32::MAX => count as usize,
        _ => {
            let place = format!("{place}.attributes.POSITION");
            return Err(malformed(place, "fewer than 2^32 - 1 vertices", count));
        }
    };
    let index_of = |semantic| find(semantic).map(|index| index.value());
    let source = VertexSource {
        position: position.value(),
        normal: index_of(Semantic::Normals),
        uv: index_of(Semantic::TexCoords(0)),
        color: index_of(Semantic::Colors(0)),
    };
    Ok(Some((source, vertex_count)))
}

/// The order in which a primitive visits its vertices.
enum Corners<'a> {
    Indexed {
        indices: Accessor<'a>,
        vertex_count: usize,
        /// The largest value of the component type, which the specification keeps free.
        restart: u32,
    },
    InOrder(usize),
}

const INDEX_COMPONENTS: &[Component] = &[
    (ComponentType::U8, Some(false)),
    (ComponentType::U16, Some(false)),
    (ComponentType::U32, Some(false)),
];

impl<'a> Corners<'a> {
    fn open(
        document: &Document<'a>,
        primitive: &Primitive,
        vertex_count: usize,
        place: &str,
    ) -> Read<Self> {
        let Some(index) = primitive.indices else {
            return Ok(Self::InOrder(vertex_count));
        };
        let indices = Accessor::open(document, index.value(), &format!("{place}.indices"))?;
        indices.expect(&[1], INDEX_COMPONENTS)?;
        Ok(Self::Indexed {
            restart: u32::MAX >> (32 - 8 * indices.component.size()),
            indices,
            vertex_count,
        })
    }

    fn count(&self) -> usize {
        match self {
            Self::Indexed { indices, .. } => indices.count,
            Self::InOrder(count) => *count,
        }
    }

    /// The vertex at corner `at < count`.
    fn vertex(&self, at: usize) -> Read<u32> {
        match self {
            Self::InOrder(_) => Ok(at as u32),
            Self::Indexed {
                indices,
                vertex_count,
                restart,
            } => {
                let vertex = indices.unsigned(at);
                if vertex == *restart || vertex as usize >= *vertex_count {
                    let restarts = if vertex == *restart {
                        ", the restart value,"
                    } else {
                        ""
                    };
                    let expected = format!("indices below {vertex_count}");
                    let found = format!("{vertex}{restarts} at element {at}");
                    return Err(malformed(&indices.place, expected, found));
                }
                Ok(vertex)
            }
        }
    }
}

/// The triangles in the specification's order of corners (glTF 2.0, 3.7.2.1), those that repeat an index among them.
fn read_triangles(corners: &Corners, mode: Mode) -> Read<Vec<[u32; 3]>> {
    let count = corners.count();
    let triangle_count = match mode {
        Mode::Triangles => count / 3,
        _ => count.saturating_sub(2),
    };
    let mut triangles = Vec::with_capacity(triangle_count);
    for at in 0..triangle_count {
        let [a, b, c] = match mode {
            Mode::TriangleStrip => [at, at + 1 + at % 2, at + 2 - at % 2],
            Mode::TriangleFan => [at + 1, at + 2, 0],
            _ => [3 * at, 3 * at + 1, 3 * at + 2],
        };
        triangles.push([corners.vertex(a)?, corners.vertex(b)?, corners.vertex(c)?]);
    }
    Ok(triangles)
}

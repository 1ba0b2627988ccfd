//! Primitive: one glTF primitive, its triangles by ranges over its vertex accessors.

use std::ops::Range;

use gltf::json::accessor::ComponentType;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::Document;
use super::accessor::{Accessor, Component};
use super::buffers::out_of_range;
use super::error::{Read, malformed, short};
use super::features;
use super::materials;
use super::warnings::Warnings;

/// The accessors that make up a primitive's vertices. Primitives with equal sources share their vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct VertexSource {
    pub(super) position: usize,
    pub(super) normal: Option<usize>,
    /// The set `N` of `TEXCOORD_N`, the one that the material's base colour uses, and its accessor.
    pub(super) uv: Option<(u32, usize)>,
    pub(super) color: Option<usize>,
}

/// A primitive of triangles, checked; no element is read yet.
pub(super) struct TrianglePrimitive {
    /// `meshes[3].primitives[0]`
    pub(super) place: String,
    pub(super) source: VertexSource,
    /// Vertices that `source` holds; the triangles use some of them.
    pub(super) vertex_count: usize,
    /// Index into the document's materials.
    pub(super) material: Option<usize>,
    /// Triangles as the specification counts them, those that repeat an index among them.
    pub(super) triangle_count: u64,
    mode: Mode,
    corners: Corners,
}

/// Checks `primitive`, or notes why it has no triangles.
pub(super) fn check(
    document: &Document,
    primitive: &Primitive,
    place: String,
    warnings: &mut Warnings,
) -> Read<Option<TrianglePrimitive>> {
    if let Some(mode) = features::mode_without_triangles(primitive.mode) {
        warnings.add(format!("{mode} primitives left out"), 1, &place);
        return Ok(None);
    }
    let Checked::Valid(mode) = primitive.mode else {
        let place = format!("{place}.mode");
        return Err(malformed(place, "a number in 0..=6", "another"));
    };
    features::check_primitive(document.root, primitive, &place, warnings)?;
    let targets = primitive.targets.as_ref().map_or(0, Vec::len);
    warnings.add("morph targets left out", targets as u64, &place);
    let material = primitive.material.map(|material| material.value());
    let materials = document.root.materials.len();
    if let Some(material) = material.filter(|&material| material >= materials) {
        let place = format!("{place}.material");
        return Err(out_of_range(&place, "materials", materials, material));
    }
    let uv_set = material.map_or(0, |it| materials::uv_set(&document.root.materials[it]));
    let source = read_source(document, primitive, uv_set, &place, warnings)?;
    let Some((source, vertex_count)) = source else {
        warnings.add("primitives without POSITION left out", 1, &place);
        return Ok(None);
    };
    let corners = Corners::open(document, primitive, vertex_count, &place)?;
    let count = corners.count() as u64;
    let triangle_count = match mode {
        Mode::Triangles => {
            let what = "corners after the last whole triangle left out";
            warnings.add(what, count % 3, &place);
            count / 3
        }
        _ => count.saturating_sub(2),
    };
    Ok(Some(TrianglePrimitive {
        place,
        source,
        vertex_count,
        material,
        triangle_count,
        mode,
        corners,
    }))
}

fn repeats([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

impl TrianglePrimitive {
    /// The triangles `range` of the primitive without those that repeat an index: three different indices below
    /// `vertex_count` each.
    pub(super) fn triangles(
        &self,
        range: Range<u64>,
        warnings: &mut Warnings,
    ) -> Read<Vec<[u32; 3]>> {
        let mut triangles = Vec::with_capacity((range.end - range.start) as usize);
        let mut repeated = 0;
        self.visit(range, |triangle| match repeats(triangle) {
            true => repeated += 1,
            false => triangles.push(triangle),
        })?;
        // A strip or fan repeats an index to turn a corner; in a list it is a triangle that its author wrote.
        if self.mode == Mode::Triangles {
            let what = "triangles with a repeated index left out";
            warnings.add(what, repeated, &self.place);
        }
        Ok(triangles)
    }

    /// Triangles that an author meant: all of a list, those of a strip or fan that do not only stitch.
    pub(super) fn meant_triangles(&self) -> Read<u64> {
        if self.mode == Mode::Triangles {
            return Ok(self.triangle_count);
        }
        let mut meant = 0;
        self.visit(0..self.triangle_count, |triangle| {
            meant += u64::from(!repeats(triangle));
        })?;
        Ok(meant)
    }

    /// Whether [`TrianglePrimitive::meant_triangles`] is the count of triangles whatever they are.
    pub(super) fn is_list(&self) -> bool {
        self.mode == Mode::Triangles
    }

    /// Triangles in the specification's order of corners (glTF 2.0, 3.7.2.1).
    fn visit(&self, range: Range<u64>, mut emit: impl FnMut([u32; 3])) -> Read<()> {
        if range.is_empty() {
            return Ok(());
        }
        let Range { start, end } = range;
        // The two corners before.
        let (mut older, mut old) = (0, 0);
        match self.mode {
            Mode::TriangleStrip => self.corners.visit(start..end + 2, |at, corner| {
                if at >= start + 2 {
                    emit(match at % 2 {
                        0 => [older, old, corner],
                        _ => [older, corner, old],
                    });
                }
                (older, old) = (old, corner);
            }),
            Mode::TriangleFan => {
                let mut hub = 0;
                self.corners.visit(0..1, |_, corner| hub = corner)?;
                self.corners.visit(start + 1..end + 2, |at, corner| {
                    if at >= start + 2 {
                        emit([old, corner, hub]);
                    }
                    old = corner;
                })
            }
            _ => {
                // Counting is cheaper than a division a corner.
                let mut place = 0;
                self.corners.visit(3 * start..3 * end, |_, corner| {
                    if place == 2 {
                        emit([older, old, corner]);
                        place = 0;
                    } else {
                        place += 1;
                    }
                    (older, old) = (old, corner);
                })
            }
        }
    }
}

/// Checks every attribute's accessor and count; `None` without POSITION.
fn read_source(
    document: &Document,
    primitive: &Primitive,
    uv_set: u32,
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
        let name = short(&semantic.to_string());
        let attribute = format!("{place}.attributes.{name}");
        let found = count_of(index.value(), &attribute)?;
        if found != count {
            let expected = format!("{count} elements, as many as POSITION");
            let attribute = format!("{attribute} (accessor {})", index.value());
            return Err(malformed(attribute, expected, found));
        }
        let read = match semantic {
            Checked::Valid(Semantic::TexCoords(set)) => *set == uv_set,
            // JOINTS and WEIGHTS go with their skins, which have a line of their own.
            Checked::Valid(
                Semantic::Positions
                | Semantic::Normals
                | Semantic::Colors(0)
                | Semantic::Joints(_)
                | Semantic::Weights(_),
            ) => true,
            _ => false,
        };
        if !read {
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
        uv: index_of(Semantic::TexCoords(uv_set)).map(|index| (uv_set, index)),
        color: index_of(Semantic::Colors(0)),
    };
    Ok(Some((source, vertex_count)))
}

/// The order in which a primitive visits its vertices.
enum Corners {
    Indexed {
        indices: Accessor,
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

impl Corners {
    fn open(
        document: &Document,
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

    /// Gives the vertices at the corners `range`, which lies below the count, to `visit`.
    fn visit(&self, range: Range<u64>, mut visit: impl FnMut(u64, u32)) -> Read<()> {
        match self {
            Self::InOrder(_) => {
                range.for_each(|at| visit(at, at as u32));
                Ok(())
            }
            Self::Indexed {
                indices,
                vertex_count,
                restart,
            } => indices.visit_unsigned(range, |at, vertex| {
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
                visit(at, vertex);
                Ok(())
            }),
        }
    }
}

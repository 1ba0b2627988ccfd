//! Primitive: one glTF primitive, its triangles by ranges over its vertex accessors.

use std::ops::Range;
use std::sync::Arc;

use super::Document;
use super::accessor::{self, Accessor, Component, ComponentType};
use super::attributes::Shading;
use super::buffers::{demand, out_of_range};
use super::document::{self, Primitive, Tolerant, Whole};
use super::error::{Read, malformed, short};
use super::features;
use super::materials;
use super::pose::{Pose, PoseSource};
use super::warnings::Warnings;

/// The accessors that make up a primitive's vertices. Primitives with equal sources share their vertices.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct VertexSource {
    pub(super) position: usize,
    pub(super) normal: Option<usize>,
    /// The set `N` of `TEXCOORD_N`, the one that the material's base colour uses, and its accessor.
    pub(super) uv: Option<(usize, usize)>,
    pub(super) color: Option<usize>,
    /// `None`: the vertices stay where they are.
    pub(super) pose: Option<Arc<PoseSource>>,
}

/// The modes that make triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    Triangles,
    TriangleStrip,
    TriangleFan,
}

impl Mode {
    /// The mode of `primitive`, or the name of one without triangles.
    pub(super) fn of(primitive: &Primitive) -> Option<Result<Self, &'static str>> {
        use gltf::json::mesh as code;
        let Some(mode) = primitive.mode else {
            return Some(Ok(Self::Triangles));
        };
        Some(match u32::try_from(mode.0).ok()? {
            code::POINTS => Err("POINTS"),
            code::LINES => Err("LINES"),
            code::LINE_LOOP => Err("LINE_LOOP"),
            code::LINE_STRIP => Err("LINE_STRIP"),
            code::TRIANGLES => Ok(Self::Triangles),
            code::TRIANGLE_STRIP => Ok(Self::TriangleStrip),
            code::TRIANGLE_FAN => Ok(Self::TriangleFan),
            _ => return None,
        })
    }
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
    pose: Option<&Pose>,
    place: String,
    warnings: &mut Warnings,
) -> Read<Option<TrianglePrimitive>> {
    let mode = match Mode::of(primitive) {
        Some(Ok(mode)) => mode,
        Some(Err(name)) => {
            warnings.add(format!("{name} primitives left out"), 1, &place);
            return Ok(None);
        }
        None => {
            let found = primitive.mode.unwrap_or_default().0;
            let place = format!("{place}.mode");
            return Err(malformed(place, "a number in 0..=6", found));
        }
    };
    features::check_primitive(document.root, primitive, &place, warnings)?;
    let targets = primitive.targets.len() as u64;
    let what = "morph targets left out but for their default weights";
    warnings.add(what, targets, &place);
    let material = primitive.material.map(|material| material.value());
    let materials = document.root.materials.len();
    if let Some(material) = material.filter(|&material| material >= materials) {
        let place = format!("{place}.material");
        return Err(out_of_range(&place, "materials", materials, material));
    }
    let uv_set = material.map_or(0, |it| materials::uv_set(&document.root.materials[it]));
    let source = read_source(document, primitive, uv_set, pose, &place, warnings)?;
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

/// Checks the accessor and count of every attribute that is read; `None` without POSITION. An
/// attribute that only shades is left out, with a warning, where its accessor cannot be read.
fn read_source(
    document: &Document,
    primitive: &Primitive,
    uv_set: usize,
    pose: Option<&Pose>,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Option<(VertexSource, usize)>> {
    let attributes = &primitive.attributes;
    let Some(position) = attributes.find("POSITION") else {
        return Ok(None);
    };
    let user = format!("{place}.attributes.POSITION");
    let count = accessor::find(document, position, &user)?.count;
    let Whole(count) = demand(count, &format!("{user}.count"))?;
    let mut shading = Vec::new();
    for (name, index) in &attributes.0 {
        // JOINTS and WEIGHTS are checked where a skin reads them.
        let elsewhere = name.starts_with("JOINTS_") || name.starts_with("WEIGHTS_");
        if elsewhere || name == "POSITION" {
            continue;
        }
        let kind = Shading::of(name, uv_set);
        let name = short(name);
        let Some(kind) = kind else {
            warnings.add(format!("attributes {name} left out"), 1, place);
            continue;
        };
        let index = index.value();
        let attribute = format!("{place}.attributes.{name} (accessor {index})");
        let accessor = document.root.accessors.get(index);
        let accessor = accessor.and_then(Tolerant::read);
        let found = accessor.and_then(|it| it.count);
        if let Some(Whole(found)) = found.filter(|it| it.0 != count) {
            let expected = format!("{count} elements, as many as POSITION");
            return Err(malformed(attribute, expected, found));
        }
        if let Err(fault) = kind.open(document, index, place) {
            let what = format!("attribute {name} left out ({})", fault.reason());
            warnings.add(what, 1, &attribute);
            continue;
        }
        shading.push((kind, index));
        let is_integer = |it: &document::Accessor| it.component_type != Some(Whole(5126));
        let must = match kind {
            Shading::Normal => false,
            Shading::Uv(_) => !document.quantized,
            Shading::Color => true,
        };
        let forgotten = |it: &document::Accessor| must && is_integer(it) && !it.normalized;
        let what = format!("integer {name} read as normalized, which its accessor does not say");
        warnings.add(what, u64::from(accessor.is_some_and(forgotten)), &attribute);
    }
    let index_of = |kind| {
        let found = shading.iter().find(|(it, _)| *it == kind);
        found.map(|&(_, index)| index)
    };
    let vertex_count = match u32::try_from(count) {
        Ok(count) if count < u32::MAX => count as usize,
        _ => {
            let place = format!("{place}.attributes.POSITION");
            return Err(malformed(place, "fewer than 2^32 - 1 vertices", count));
        }
    };
    let source = VertexSource {
        position,
        normal: index_of(Shading::Normal),
        uv: index_of(Shading::Uv(uv_set)).map(|index| (uv_set, index)),
        color: index_of(Shading::Color),
        pose: pose.map(|pose| Arc::new(PoseSource::of(primitive, pose, place, warnings))),
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

//! The body: a walk over all elements in the file's order, every one checked to its end.

use std::collections::BTreeSet;

use super::Plan;
use super::faces::{FaceLayout, FaceRow};
use super::header::{Element, Encoding, Header, Kind};
use super::list::TriangleList;
use super::pieces::{self, PieceStart};
use super::values::Values;
use super::vertices::Table;
use super::{strips, surface};
use crate::import::allowance::Allowance;
use crate::import::attributes::Present;
use crate::import::error::{Fault, Read, malformed, short};
use crate::import::file::Extent;
use crate::import::opened::PIECE_TRIANGLES;
use crate::import::origin::Origin;
use crate::import::plain;
use crate::import::warnings::Warnings;

/// All that the elements hold.
pub(super) struct Body {
    pub(super) table: Table,
    pub(super) present: Present,
    pub(super) vertex_count: u64,
    pub(super) triangles: Triangles,
    pub(super) triangle_count: u64,
    /// Numbers of the textures that faces use, ascending: a slot each.
    pub(super) textures: Vec<u16>,
    /// Of the vertices that faces use.
    pub(super) origin: Origin,
    /// Vertices that faces use and that are not finite, where the plan has none.
    pub(super) left_out: Option<LeftOut>,
}

/// Vertices whose faces are left out.
pub(super) struct LeftOut {
    vertices: UsedVertices,
    /// The first of them.
    vertex: u32,
    position: [f64; 3],
}

impl LeftOut {
    /// Whether a face with this triangle is left out.
    pub(super) fn has(&self, triangle: [u32; 3]) -> bool {
        let vertices = triangle.iter();
        vertices.copied().any(|it| self.vertices.has(it.into()))
    }

    /// The fault of a file that has no other faces.
    pub(super) fn fault(&self) -> Fault {
        let place = format!("vertex {}", self.vertex);
        let found = format!("{:?}", self.position);
        malformed(place, "finite numbers within f32", found)
    }
}

/// Triangles in memory, or where they lie.
pub(super) enum Triangles {
    InMemory(TriangleList),
    InFile {
        layout: Option<FaceLayout>,
        starts: Vec<PieceStart>,
    },
}

/// State of the walk.
struct Walk<'a> {
    header: &'a Header,
    plan: &'a Plan,
    allowance: &'a Allowance<'a>,
    list: TriangleList,
    starts: Vec<PieceStart>,
    triangle_count: u64,
    used: UsedVertices,
    textures: BTreeSet<u16>,
    next_look: usize,
    with_uvs: bool,
    /// Faces, or triangles of strips, that are left out.
    left_out: u64,
}

/// Walks over the body; `None` where there are more triangles than `plan` loads.
pub(super) fn read(
    file: &Extent,
    header: &Header,
    plan: &Plan,
    allowance: &Allowance,
    warnings: &mut Warnings,
) -> Read<Option<Body>> {
    let mut values = Values::new(file, header.encoding, header.body_offset);
    let mut columns = Some(plan.columns.clone());
    let mut table = None;
    let mut layout = None;
    // No file has more vertices than bytes, whatever its header says.
    let used = UsedVertices::new(plan.vertex_count.min(file.len()));
    // Twice, should some of them be left out.
    allowance.fits(2 * used.held_bytes(), "element vertex")?;
    let mut walk = Walk {
        header,
        plan,
        allowance,
        list: TriangleList::default(),
        starts: Vec::new(),
        triangle_count: 0,
        used,
        textures: BTreeSet::new(),
        next_look: plain::BETWEEN_LOOKS,
        with_uvs: false,
        left_out: 0,
    };
    for element in &header.elements {
        match &*element.name {
            "vertex" => {
                let columns = columns.take();
                let columns = columns.unwrap_or_else(|| plan.columns.clone());
                table = Some(vertices(
                    file,
                    header,
                    element,
                    columns,
                    &mut values,
                    // A second walk takes the room of the first.
                    plan.left_out.is_none().then_some(allowance),
                )?);
            }
            "face" => {
                layout = FaceLayout::find(element, plan.vertex_count, header.encoding, warnings)?;
                match &layout {
                    None => skip(&mut values, element, header.encoding)?,
                    Some(faces) if !walk.faces(faces, &mut values, warnings)? => return Ok(None),
                    Some(_) => {}
                }
            }
            "tristrips" => walk.strips(element, &mut values)?,
            name => {
                let what = format!("elements {} left out", short(name));
                warnings.add(what, element.count, "header");
                skip(&mut values, element, header.encoding)?;
            }
        }
    }
    let left = match header.encoding {
        Encoding::Text => u64::from(!values.blank_left()?) * values.left(),
        _ => values.left(),
    };
    warnings.add("bytes after the last element left out", left, "file");
    let mut table = table.ok_or_else(|| malformed("header", "element vertex", "none"))?;
    let what = "faces with a position that is not finite left out";
    warnings.add(what, walk.left_out, "element face");
    let mut left_out = None;
    let lack = |vertex: u32, position| {
        let left_out = left_out.get_or_insert_with(|| LeftOut {
            vertices: UsedVertices::new(plan.vertex_count.min(file.len())),
            vertex,
            position,
        });
        left_out.vertices.add([vertex; 3]);
    };
    let origin = table.measure(|vertex| walk.used.has(vertex), lack, warnings)?;
    let mut present = plan.columns.present();
    present.uvs |= walk.with_uvs;
    Ok(Some(Body {
        table,
        present,
        vertex_count: plan.vertex_count,
        triangle_count: walk.triangle_count,
        triangles: match plan.streamed {
            false => Triangles::InMemory(walk.list),
            true => Triangles::InFile {
                layout,
                starts: walk.starts,
            },
        },
        textures: walk.textures.into_iter().collect(),
        origin,
        left_out,
    }))
}

fn vertices(
    file: &Extent,
    header: &Header,
    element: &Element,
    columns: super::vertices::Columns,
    values: &mut Values,
    allowance: Option<&Allowance>,
) -> Read<Table> {
    let encoding = header.encoding;
    match element.row_bytes() {
        Some(_) if encoding != Encoding::Text => {
            Table::in_file(file, values, columns, element.count, encoding)
        }
        _ => {
            let bytes = Table::most_bytes(values, element, &columns, encoding);
            if let Some(allowance) = allowance {
                allowance.take(bytes, "element vertex")?;
            }
            Table::in_memory(values, element, columns, encoding)
        }
    }
}

impl Walk<'_> {
    /// Reads all faces; false where there are more triangles than the plan loads.
    fn faces(
        &mut self,
        faces: &FaceLayout,
        values: &mut Values,
        warnings: &mut Warnings,
    ) -> Read<bool> {
        self.with_uvs = faces.has_uvs();
        let with_textures = faces.has_textures() && !self.header.textures.is_empty();
        // Strips before the faces have neither.
        let strips = std::mem::take(&mut self.list);
        self.list = TriangleList::new(faces.has_uvs(), with_textures);
        self.list.triangles = strips.triangles;
        self.list.end_strips();
        let mut row = FaceRow::default();
        let (mut without, mut without_uvs, mut too_long) = (0, 0, 0);
        for face in 0..faces.count {
            let start = PieceStart {
                offset: values.position(),
                face,
                skip: 0,
            };
            let first = self.list.len();
            let before = self.triangle_count;
            let mut is_left_out = false;
            faces.read(values, face, &mut row, &mut |_, triangle| {
                if self.plan.leaves_out(triangle) {
                    is_left_out = true;
                    return;
                }
                self.used.add(triangle);
                match self.plan.streamed {
                    false => self.list.triangles.push(triangle),
                    true if self.triangle_count.is_multiple_of(PIECE_TRIANGLES) => {
                        let skip = self.triangle_count - before;
                        self.starts.push(PieceStart { skip, ..start });
                    }
                    true => {}
                }
                self.triangle_count += 1;
            })?;
            if is_left_out {
                self.left_out += 1;
                self.triangle_count = before;
                self.list.triangles.truncate(first);
                while self.starts.last().is_some_and(|it| it.face == face) {
                    self.starts.pop();
                }
                continue;
            }
            without += u64::from(row.corners < 3);
            without_uvs += u64::from(faces.has_uvs() && row.uvs.is_empty());
            let texture = surface::number(row.texture, self.header);
            if row.corners >= 3 && !self.textures.contains(&texture) {
                self.textures.insert(texture);
            }
            if self.plan.streamed {
                too_long += u64::from(pieces::is_long(row.corners));
                continue;
            }
            self.list.end_face(first, &row, texture);
            if !self.look(values)? {
                return Ok(false);
            }
        }
        let place = "element face";
        warnings.add("faces of fewer than three corners left out", without, place);
        let what = "faces without texture coordinates for each corner set to (0, 0)";
        warnings.add(what, without_uvs, place);
        pieces::note_long(too_long, warnings);
        Ok(true)
    }

    fn strips(&mut self, element: &Element, values: &mut Values) -> Read<()> {
        let texture = surface::number(0.0, self.header);
        let vertex_count = self.plan.vertex_count;
        strips::read(values, element, vertex_count, |triangle, values| {
            if self.plan.leaves_out(triangle) {
                self.left_out += 1;
                return Ok(());
            }
            self.used.add(triangle);
            self.list.triangles.push(triangle);
            self.triangle_count += 1;
            self.textures.insert(texture);
            self.look(values).map(|_| ())
        })?;
        self.list.end_strips();
        Ok(())
    }

    /// Looks at the memory now and then; false where the mesh must be read in pieces.
    fn look(&mut self, values: &Values) -> Read<bool> {
        if self.list.len() < self.next_look {
            return Ok(true);
        }
        self.next_look = self.list.len() + plain::BETWEEN_LOOKS;
        let need = self.list.held_bytes(self.plan.vertex_count) + self.used.held_bytes();
        let too_many = self.list.len() as u64 > self.plan.most_triangles;
        if self.plan.in_place && (too_many || need > self.allowance.left_bytes()) {
            return Ok(false);
        }
        self.allowance.fits(need, values.place())?;
        Ok(true)
    }
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
                Kind::Scalar(scalar) => values.skip(scalar, 1)?,
                Kind::List { count, item } => {
                    let length = values.count(count)?;
                    values.skip(item, length)?;
                }
            }
        }
    }
    Ok(())
}

/// A bit for each vertex that a triangle has.
struct UsedVertices {
    words: Vec<u64>,
}

impl UsedVertices {
    fn new(count: u64) -> Self {
        Self {
            words: vec![0; count.div_ceil(64) as usize],
        }
    }

    fn held_bytes(&self) -> u64 {
        (self.words.len() * size_of::<u64>()) as u64
    }

    fn add(&mut self, triangle: [u32; 3]) {
        for vertex in triangle {
            if let Some(word) = self.words.get_mut(vertex as usize / 64) {
                *word |= 1 << (vertex % 64);
            }
        }
    }

    fn has(&self, vertex: u64) -> bool {
        let word = self.words.get(vertex as usize / 64);
        word.is_some_and(|word| word >> (vertex % 64) & 1 == 1)
    }
}

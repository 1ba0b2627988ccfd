//! OBJ (Wavefront, appendix B1): positions, texture coordinates, normals, polygons cut into
//! triangles, materials by name. All objects and groups of a file become one mesh.
//!
//! Texture coordinates run bottom-up in these files and top-down in the scene, so `v` becomes `1 - v`. Colours behind a
//! position (`v x y z r g b`) are sRGB by the programs' habit and become linear.
//!
//! The format has neither a magic nor an end, so any text could pass. A file is refused that has no
//! statement of OBJ, no position beside lines that are none, or more such lines than statements.

mod faces;
mod lines;
mod merged;
mod mtl;
mod surface;

use std::collections::HashMap;
use std::ops::Range;

use super::allowance::Allowance;
use super::error::{Fault, Read, malformed, quoted_bytes};
use super::file::Extent;
use super::opened::{OpenedMesh, OpenedScene};
use super::polygons::Polygon;
use super::warnings::Warnings;
use super::weld::Seeded;
use super::{attributes, origin, plain, text};
use mtl::Library;

/// Stands for an index that a corner does not give.
const NONE: u32 = u32::MAX;

/// Whether the first line that says anything is a statement that OBJ files start with.
pub(super) fn looks_like_text(head: &[u8]) -> bool {
    const STARTS: &[&str] = &["mtllib", "usemtl", "o", "g", "s", "v", "vn", "vt", "f"];
    let head = String::from_utf8_lossy(head);
    let mut lines = head.lines().map(str::trim);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with('#'));
    let keyword = first.and_then(|line| line.split_whitespace().next());
    keyword.is_some_and(|keyword| STARTS.contains(&keyword))
}

/// Reads the OBJ in `file`, with its material libraries and textures.
pub(super) fn read(file: &Extent, allowance: &Allowance, name: &str) -> Read<OpenedScene> {
    let mut warnings = Warnings::default();
    let mut parser = Parser::new();
    parser.run(file, allowance, &mut warnings)?;
    parser.check_statements()?;
    parser.check_indices(&mut warnings)?;
    let listed = parser.triangles.len() as u64;
    let library = std::mem::take(&mut parser.library);
    let names = std::mem::take(&mut parser.material_names);
    let (mut mesh, origin) = parser.into_mesh(&mut warnings);
    if mesh.triangles.is_empty() {
        return Ok(plain::scene(name, None, vec![], vec![], listed, warnings));
    }
    mesh.name = name.to_owned();
    let textured = mesh.uvs.is_some();
    let (materials, images) = library.materials(&names, allowance, textured, &mut warnings)?;
    mesh.material_slots = (0..materials.len() as u32).collect();
    let mesh = Some((OpenedMesh::Loaded(mesh), origin));
    Ok(plain::scene(
        name, mesh, materials, images, listed, warnings,
    ))
}

/// What the lines so far have given.
struct Parser {
    line: u64,
    /// As written; those that are not finite may be of no use to any face.
    positions: Vec<[f64; 3]>,
    /// Positions that are not finite, and their lines.
    not_finite: Vec<(u32, u64)>,
    /// sRGB as written; as long as `positions` once one has a colour.
    colors: Vec<[f32; 4]>,
    /// NaN where a line could not be read.
    uvs: Vec<[f32; 2]>,
    /// The same.
    normals: Vec<[f32; 3]>,
    /// Vertices: indices of position, texture coordinates and normal.
    vertices: Vec<[u32; 3]>,
    vertex_of_corner: HashMap<[u32; 3], u32, Seeded>,
    /// Fans of the faces.
    triangles: Vec<[u32; 3]>,
    triangle_materials: Vec<u16>,
    polygons: Vec<Polygon>,
    /// Triangles with a corner that has no normal.
    bare: Vec<Range<usize>>,
    /// The largest index of each kind, and its line: it may point at what comes later.
    largest: [(u32, u64); 3],
    library: Library,
    /// Slot to name; `None` before the first `usemtl`.
    material_names: Vec<Option<String>>,
    slot_of_material: HashMap<Option<String>, u16>,
    material: Option<String>,
    slot: Option<u16>,
    /// Corners of the polygon at hand.
    polygon: Vec<[u32; 3]>,
    uvs_replaced: u64,
    /// Of the materials' names, wherever they are held.
    name_bytes: u64,
    /// Lines that are statements of OBJ.
    statements: u64,
    /// Lines that are none, and the first of them.
    strays: u64,
    first_stray: Option<Fault>,
}

impl Parser {
    fn new() -> Self {
        Self {
            line: 0,
            positions: Vec::new(),
            not_finite: Vec::new(),
            colors: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            vertices: Vec::new(),
            vertex_of_corner: HashMap::with_hasher(Seeded::new()),
            triangles: Vec::new(),
            triangle_materials: Vec::new(),
            polygons: Vec::new(),
            bare: Vec::new(),
            largest: [(0, 0); 3],
            library: Library::default(),
            material_names: Vec::new(),
            slot_of_material: HashMap::new(),
            material: None,
            slot: None,
            polygon: Vec::new(),
            uvs_replaced: 0,
            name_bytes: 0,
            statements: 0,
            strays: 0,
            first_stray: None,
        }
    }

    fn place(&self) -> String {
        format!("line {}", self.line)
    }

    fn expected(&self, expected: &str, found: &[u8]) -> Fault {
        malformed(self.place(), expected, quoted_bytes(found))
    }

    fn statement(
        &mut self,
        line: &[u8],
        allowance: &Allowance,
        warnings: &mut Warnings,
    ) -> Read<()> {
        let length = line.iter().position(u8::is_ascii_whitespace);
        let (keyword, rest) = line.split_at(length.unwrap_or(line.len()));
        let rest = rest.trim_ascii();
        // Names may have a `#`, numbers none.
        let numbers = text::before_comment(rest).trim_ascii_end();
        if matches!(keyword.first(), None | Some(b'#')) {
            return Ok(());
        }
        if line.contains(&0) {
            return Err(self.expected("a statement of OBJ", line));
        }
        self.statements += 1;
        match keyword {
            b"v" => {
                self.look_before_growth(allowance)?;
                self.position(numbers)?;
            }
            b"vt" => self.uv(numbers, warnings),
            b"vn" => self.normal(numbers, warnings),
            b"f" | b"fo" => {
                self.look_ahead(numbers, allowance)?;
                self.face(numbers, warnings)?;
            }
            b"usemtl" => {
                self.material = Some(String::from_utf8_lossy(rest).into_owned());
                self.slot = None;
            }
            b"mtllib" => {
                let names = String::from_utf8_lossy(rest).into_owned();
                self.library
                    .load(&names, allowance, &self.place(), warnings)?;
            }
            b"l" => warnings.add("lines left out", 1, &self.place()),
            b"p" => warnings.add("points left out", 1, &self.place()),
            // Names, smoothing groups (normals follow the angle between faces) and marks of display.
            b"o" | b"g" | b"s" | b"mg" | b"usemap" | b"maplib" | b"lod" | b"bevel"
            | b"c_interp" | b"d_interp" | b"shadow_obj" | b"trace_obj" => {}
            b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf"
            | b"parm" | b"trim" | b"hole" | b"scrv" | b"sp" | b"end" | b"con" | b"ctech"
            | b"stech" => warnings.add(
                "statements of curves and surfaces left out",
                1,
                &self.place(),
            ),
            _ => self.stray(keyword, line, warnings)?,
        }
        Ok(())
    }

    /// Notes a line that is no statement; one that is no text is no OBJ.
    fn stray(&mut self, keyword: &[u8], line: &[u8], warnings: &mut Warnings) -> Read<()> {
        let expected = "a statement of OBJ";
        let is_text = |it: &str| !it.chars().any(|it| it.is_control() && it != '\t');
        if !keyword.is_ascii() || !std::str::from_utf8(line).is_ok_and(is_text) {
            return Err(self.expected(expected, &keyword[..keyword.len().min(16)]));
        }
        self.statements -= 1;
        self.strays += 1;
        if self.first_stray.is_none() {
            self.first_stray = Some(self.expected(expected, line));
        }
        warnings.add("unknown statements left out", 1, &self.place());
        Ok(())
    }

    /// Refuses a text that is another's. A stray line beside a model is only a warning.
    fn check_statements(&mut self) -> Read<()> {
        let is_foreign = self.positions.is_empty() || self.strays > self.statements;
        match self.first_stray.take() {
            Some(stray) if is_foreign => Err(stray),
            None if self.statements == 0 => {
                Err(malformed("file", "at least one statement of OBJ", "none"))
            }
            _ => Ok(()),
        }
    }

    /// Fills `numbers` from the front; gives how many there are.
    fn numbers(&self, line: &[u8], numbers: &mut [f64]) -> Read<usize> {
        let words = line
            .split(u8::is_ascii_whitespace)
            .filter(|it| !it.is_empty());
        let mut count = 0;
        for word in words {
            let Some(number) = text::number(word) else {
                return Err(self.expected("a number", word));
            };
            let Some(slot) = numbers.get_mut(count) else {
                return Err(self.expected(&format!("{} numbers at most", numbers.len()), line));
            };
            *slot = number;
            count += 1;
        }
        Ok(count)
    }

    fn uv(&mut self, line: &[u8], warnings: &mut Warnings) {
        let mut numbers = [0.0; 3];
        let uv = match self.numbers(line, &mut numbers) {
            Ok(1..) => {
                let uv = [numbers[0] as f32, 1.0 - numbers[1] as f32];
                attributes::finite_uv(uv, &mut self.uvs_replaced)
            }
            _ => {
                let what = "texture coordinates that are not one to three numbers left out";
                warnings.add(what, 1, &self.place());
                [f32::NAN; 2]
            }
        };
        self.uvs.push(uv);
    }

    fn normal(&mut self, line: &[u8], warnings: &mut Warnings) {
        let mut numbers = [0.0; 3];
        let normal = match self.numbers(line, &mut numbers) {
            // Length is not demanded of these files.
            Ok(3) => attributes::unit_normal(numbers, &mut 0),
            _ => {
                let what = "normals that are not three numbers left out";
                warnings.add(what, 1, &self.place());
                [f32::NAN; 3]
            }
        };
        self.normals.push(normal);
    }

    fn position(&mut self, line: &[u8]) -> Read<()> {
        let mut numbers = [1.0; 8];
        let count = self.numbers(line, &mut numbers)?;
        let [x, y, z, ..] = numbers;
        // A colour stands behind a weight where there is room for both.
        let color_at = if count == 8 { 4 } else { 3 };
        let color = std::array::from_fn(|channel| numbers[color_at + channel]);
        if count < 3 {
            return Err(self.expected("three numbers", line));
        }
        if self.positions.len() >= NONE as usize - 1 {
            return Err(self.expected("fewer than 2^32 - 2 positions", line));
        }
        if !origin::is_finite([x, y, z]) {
            let index = self.positions.len() as u32;
            self.not_finite.push((index, self.line));
        }
        self.positions.push([x, y, z]);
        // A fourth number is a weight, a fifth alone nothing known.
        if count >= 6 {
            self.colors.resize(self.positions.len() - 1, [1.0; 4]);
            self.colors.push(color.map(|it: f64| it as f32));
        }
        Ok(())
    }
}

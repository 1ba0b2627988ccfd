//! OBJ (Wavefront, appendix B1): positions, texture coordinates, normals, polygons cut into fans, materials by name. All
//! objects and groups of a file become one mesh.
//!
//! Texture coordinates run bottom-up in these files and top-down in the scene, so `v` becomes `1 - v`. Colours behind a
//! position (`v x y z r g b`) are sRGB by the programs' habit and become linear.

mod lines;
mod mtl;

use std::collections::HashMap;
use std::ops::Range;

use super::allowance::Allowance;
use super::color::linear_from_srgb;
use super::error::{Fault, Read, malformed, quoted_bytes};
use super::file::Extent;
use super::opened::{OpenedMesh, OpenedScene};
use super::scene::Mesh;
use super::warnings::Warnings;
use super::weld::Seeded;
use super::{attributes, complete, plain};
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
    parser.check_indices()?;
    let listed = parser.triangles.len() as u64;
    let library = std::mem::take(&mut parser.library);
    let names = std::mem::take(&mut parser.material_names);
    let mut mesh = parser.into_mesh(&mut warnings);
    if mesh.triangles.is_empty() {
        return Ok(plain::scene(name, None, vec![], vec![], listed, warnings));
    }
    mesh.name = name.to_owned();
    let textured = mesh.uvs.is_some();
    let (materials, images) = library.materials(&names, allowance, textured, &mut warnings)?;
    mesh.material_slots = (0..materials.len() as u32).collect();
    let mesh = Some(OpenedMesh::Loaded(mesh));
    Ok(plain::scene(
        name, mesh, materials, images, listed, warnings,
    ))
}

/// What the lines so far have given.
struct Parser {
    line: u64,
    positions: Vec<[f32; 3]>,
    /// sRGB as written; as long as `positions` once one has a colour.
    colors: Vec<[f32; 4]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    /// Vertices: indices of position, texture coordinates and normal.
    vertices: Vec<[u32; 3]>,
    vertex_of_corner: HashMap<[u32; 3], u32, Seeded>,
    triangles: Vec<[u32; 3]>,
    triangle_materials: Vec<u16>,
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
}

impl Parser {
    fn new() -> Self {
        Self {
            line: 0,
            positions: Vec::new(),
            colors: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            vertices: Vec::new(),
            vertex_of_corner: HashMap::with_hasher(Seeded::new()),
            triangles: Vec::new(),
            triangle_materials: Vec::new(),
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
        match keyword {
            b"v" => self.position(rest)?,
            b"vt" => {
                let mut numbers = [0.0; 3];
                let count = self.numbers(rest, &mut numbers)?;
                if count == 0 {
                    return Err(self.expected("one to three numbers", rest));
                }
                let uv = [numbers[0], 1.0 - numbers[1]];
                self.uvs
                    .push(attributes::finite_uv(uv, &mut self.uvs_replaced));
            }
            b"vn" => {
                let mut numbers = [0.0; 3];
                if self.numbers(rest, &mut numbers)? != 3 {
                    return Err(self.expected("three numbers", rest));
                }
                // Length is not demanded of these files.
                let normal = attributes::unit_normal(numbers.map(f64::from), &mut 0);
                self.normals.push(normal);
            }
            b"f" | b"fo" => {
                self.look_ahead(rest, allowance)?;
                self.face(rest, warnings)?;
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
            b"" | b"o" | b"g" | b"s" | b"mg" | b"usemap" | b"maplib" | b"lod" | b"bevel"
            | b"c_interp" | b"d_interp" | b"shadow_obj" | b"trace_obj" => {}
            _ if keyword[0] == b'#' => {}
            b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf"
            | b"parm" | b"trim" | b"hole" | b"scrv" | b"sp" | b"end" | b"con" | b"ctech"
            | b"stech" => warnings.add(
                "statements of curves and surfaces left out",
                1,
                &self.place(),
            ),
            _ if keyword.is_ascii() && !keyword.iter().any(u8::is_ascii_control) => {
                warnings.add("unknown statements left out", 1, &self.place());
            }
            _ => return Err(self.expected("a statement of OBJ", &keyword[..keyword.len().min(16)])),
        }
        Ok(())
    }

    /// Fills `numbers` from the front; gives how many there are.
    fn numbers(&self, text: &[u8], numbers: &mut [f32]) -> Read<usize> {
        let words = text
            .split(u8::is_ascii_whitespace)
            .filter(|it| !it.is_empty());
        let mut count = 0;
        for word in words.take_while(|word| word[0] != b'#') {
            let number = std::str::from_utf8(word)
                .ok()
                .and_then(|it| it.parse().ok());
            let Some(number) = number else {
                return Err(self.expected("a number", word));
            };
            let Some(slot) = numbers.get_mut(count) else {
                return Err(self.expected(&format!("{} numbers at most", numbers.len()), text));
            };
            *slot = number;
            count += 1;
        }
        Ok(count)
    }

    fn position(&mut self, text: &[u8]) -> Read<()> {
        let mut numbers = [1.0; 7];
        let count = self.numbers(text, &mut numbers)?;
        let [x, y, z, color @ ..] = numbers;
        if count < 3 || !(x.is_finite() && y.is_finite() && z.is_finite()) {
            return Err(self.expected("three finite numbers", text));
        }
        if self.positions.len() >= NONE as usize - 1 {
            return Err(self.expected("fewer than 2^32 - 2 positions", text));
        }
        self.positions.push([x, y, z]);
        // A fourth number is a weight, a fifth alone nothing known.
        if count >= 6 {
            self.colors.resize(self.positions.len() - 1, [1.0; 4]);
            self.colors.push(color);
        }
        Ok(())
    }

    fn face(&mut self, text: &[u8], warnings: &mut Warnings) -> Read<()> {
        let mut polygon = std::mem::take(&mut self.polygon);
        polygon.clear();
        let words = text
            .split(u8::is_ascii_whitespace)
            .filter(|it| !it.is_empty());
        for word in words.take_while(|word| word[0] != b'#') {
            polygon.push(self.corner(word)?);
        }
        if polygon.len() < 3 {
            warnings.add(
                "faces of fewer than three corners left out",
                1,
                &self.place(),
            );
            self.polygon = polygon;
            return Ok(());
        }
        let slot = self.slot()?;
        let first_triangle = self.triangles.len();
        plain::check_triangle_count((first_triangle + polygon.len()) as u64, &self.place())?;
        let is_bare = polygon.iter().any(|corner| corner[2] == NONE);
        if is_bare {
            // No vertex is shared with triangles that have theirs.
            polygon.iter_mut().for_each(|corner| corner[2] = NONE);
        }
        let (mut first, mut last) = (0, 0);
        for (at, corner) in polygon.iter().enumerate() {
            let next = self.vertices.len() as u32;
            let vertex = *self.vertex_of_corner.entry(*corner).or_insert(next);
            if vertex == next {
                self.vertices.push(*corner);
            }
            match at {
                0 => first = vertex,
                1 => {}
                _ => {
                    self.triangles.push([first, last, vertex]);
                    self.triangle_materials.push(slot);
                }
            }
            last = vertex;
        }
        if is_bare {
            let end = self.triangles.len();
            match self.bare.last_mut() {
                Some(range) if range.end == first_triangle => range.end = end,
                _ => self.bare.push(first_triangle..end),
            }
        }
        self.polygon = polygon;
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`, each from 1, or from -1 backwards.
    fn corner(&mut self, word: &[u8]) -> Read<[u32; 3]> {
        let lengths = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut corner = [NONE; 3];
        for (kind, part) in word.split(|&byte| byte == b'/').enumerate() {
            if kind > 2 || (part.is_empty() && kind == 0) {
                return Err(self.expected("v, v/vt, v//vn or v/vt/vn", word));
            }
            if part.is_empty() {
                continue;
            }
            let index = std::str::from_utf8(part)
                .ok()
                .and_then(|it| it.parse::<i64>().ok());
            let index = index.and_then(|index| match index {
                0 => None,
                1.. => u32::try_from(index - 1).ok().filter(|&it| it < NONE),
                _ => u32::try_from(lengths[kind] as i64 + index).ok(),
            });
            let Some(index) = index else {
                let list = ["positions", "texture coordinates", "normals"][kind];
                let expected = format!("an index into {} {list}, from 1 or from -1", lengths[kind]);
                return Err(self.expected(&expected, word));
            };
            if index >= self.largest[kind].0 {
                self.largest[kind] = (index, self.line);
            }
            corner[kind] = index;
        }
        Ok(corner)
    }

    fn slot(&mut self) -> Read<u16> {
        if let Some(slot) = self.slot {
            return Ok(slot);
        }
        let next = self.material_names.len();
        let Ok(next) = u16::try_from(next) else {
            return Err(malformed(self.place(), "65536 materials at most", "more"));
        };
        let slot = *self
            .slot_of_material
            .entry(self.material.clone())
            .or_insert(next);
        if slot == next {
            self.material_names.push(self.material.clone());
            let length = self.material.as_ref().map_or(0, String::len) as u64;
            self.name_bytes += 3 * length;
        }
        self.slot = Some(slot);
        Ok(slot)
    }

    /// Every index points at something, now that all is there.
    fn check_indices(&self) -> Read<()> {
        let lengths = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let lists = ["positions", "texture coordinates", "normals"];
        for kind in 0..3 {
            let (largest, line) = self.largest[kind];
            if line > 0 && largest as usize >= lengths[kind] {
                let expected = format!("an index into {} {}", lengths[kind], lists[kind]);
                let found = u64::from(largest) + 1;
                return Err(malformed(format!("line {line}"), expected, found));
            }
        }
        Ok(())
    }

    fn into_mesh(mut self, warnings: &mut Warnings) -> Mesh {
        self.vertex_of_corner = HashMap::with_hasher(Seeded::new());
        self.drop_repeated(warnings);
        let all = |kind: usize| self.vertices.iter().all(|it| it[kind] == NONE);
        let (no_uvs, no_normals) = (all(1), all(2));
        let gather = |kind: usize| self.vertices.iter().map(move |it| it[kind] as usize);
        let mut mesh = Mesh {
            positions: gather(0).map(|at| self.positions[at]).collect(),
            ..Mesh::default()
        };
        if !no_uvs {
            let without = gather(1).filter(|&at| at == NONE as usize).count();
            let what = "vertices without texture coordinates beside others with them set to (0, 0)";
            warnings.add(what, without as u64, "file");
            let uv = |at: usize| self.uvs.get(at).copied().unwrap_or_default();
            mesh.uvs = Some(gather(1).map(uv).collect());
        }
        if !self.colors.is_empty() {
            let colors = linear_colors(&self.colors, warnings);
            let color = |at: usize| colors.get(at).copied().unwrap_or([u8::MAX; 4]);
            mesh.colors = Some(gather(0).map(color).collect());
        }
        let normal = |at: usize| self.normals.get(at).copied().unwrap_or_default();
        let given = match no_normals {
            true => Vec::new(),
            false => gather(2).map(normal).collect(),
        };
        mesh.triangles = self.triangles;
        mesh.triangle_materials = self.triangle_materials;
        if !mesh.triangles.is_empty() {
            complete::complete(&mut mesh, given, &self.bare, "file", warnings);
            plain::drop_unused(&mut mesh);
        }
        mesh
    }

    /// Drops triangles that repeat a position, and moves the ranges of the bare ones.
    fn drop_repeated(&mut self, warnings: &mut Warnings) {
        let vertices = &self.vertices;
        let keep = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|it| vertices[it as usize][0]);
            a != b && b != c && c != a
        };
        let kept: Vec<bool> = self.triangles.iter().map(keep).collect();
        let dropped = kept.iter().filter(|it| !**it).count() as u64;
        if dropped == 0 {
            return;
        }
        warnings.add("triangles with a repeated index left out", dropped, "file");
        let mut length = 0;
        let mut kept_before = Vec::with_capacity(kept.len() + 1);
        for &keep in &kept {
            kept_before.push(length);
            length += usize::from(keep);
        }
        kept_before.push(length);
        for range in &mut self.bare {
            *range = kept_before[range.start]..kept_before[range.end];
        }
        self.bare.retain(|range| !range.is_empty());
        let mut keep = kept.iter();
        self.triangles.retain(|_| keep.next() == Some(&true));
        let mut keep = kept.iter();
        self.triangle_materials
            .retain(|_| keep.next() == Some(&true));
    }
}

/// Colours as written to linear bytes. Some programs write 0..=255.
fn linear_colors(written: &[[f32; 4]], warnings: &mut Warnings) -> Vec<[u8; 4]> {
    let (mut replaced, mut one) = (0, 1.0);
    if written
        .iter()
        .flatten()
        .any(|&it| it > 1.0 && it.is_finite())
    {
        one = 255.0;
        let count = written.len() as u64;
        warnings.add("vertex colours above 1 read as 0..255", count, "file");
    }
    let byte = |color: &[f32; 4]| {
        if !color.iter().all(|it| it.is_finite()) {
            replaced += 1;
            return [u8::MAX; 4];
        }
        let [r, g, b, a] = color.map(|it| f64::from(it.clamp(0.0, one) / one));
        let alpha = if one == 255.0 && color[3] == 1.0 {
            1.0
        } else {
            a
        };
        let [r, g, b] = [r, g, b].map(linear_from_srgb);
        [r, g, b, alpha].map(|it| (it * 255.0).round() as u8)
    };
    let colors = written.iter().map(byte).collect();
    let what = "vertex colours that are not finite set to white";
    warnings.add(what, replaced, "file");
    colors
}

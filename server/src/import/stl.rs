//! STL: facets, binary or as text. Their normals are not read: each is the facet's own, which its corners say too, and
//! a smooth surface needs others. Corners at the same place become one vertex.
//!
//! The binary layout is the one of the format's sheet (3D Systems, 1989): 80 bytes of anything, a count, and 50 bytes a facet.

use std::io::BufRead as _;

use super::allowance::Allowance;
use super::attributes::Present;
use super::error::{Read, cannot_read, malformed};
use super::file::{Extent, Reader};
use super::opened::{
    OpenOptions, OpenedMesh, OpenedScene, PIECE_TRIANGLES, Piece, Pieces, StreamedMesh, array_bytes,
};
use super::plain;
use super::rows::Rows;
use super::scene::Mesh;
use super::warnings::Warnings;
use super::weld::Weld;

const HEADER_BYTES: u64 = 84;
const FACET_BYTES: usize = 50;
/// The longest word of a text file that is looked at.
const WORD_BYTES: u64 = 1 << 12;

/// Whether the file starts as an STL of text does.
pub(super) fn looks_like_text(head: &[u8]) -> bool {
    let start = head.trim_ascii_start();
    let keyword = start
        .get(..5)
        .is_some_and(|it| it.eq_ignore_ascii_case(b"solid"));
    // Binary files of some programs start with the word, too, and go on with zeros.
    keyword && !head.contains(&0)
}

/// Whether the length is exactly the one that the count of a binary file asks for.
pub(super) fn is_binary(file: &Extent) -> Read<bool> {
    Ok(facet_count(file)?.is_some_and(|count| binary_bytes(count) == file.len()))
}

fn facet_count(file: &Extent) -> Read<Option<u32>> {
    if file.len() < HEADER_BYTES {
        return Ok(None);
    }
    let mut count = [0; 4];
    file.read_at(HEADER_BYTES - 4, &mut count)?;
    Ok(Some(u32::from_le_bytes(count)))
}

fn binary_bytes(count: u32) -> u64 {
    HEADER_BYTES + u64::from(count) * FACET_BYTES as u64
}

/// Reads the STL in `file`.
pub(super) fn read(
    file: &Extent,
    allowance: &Allowance,
    name: &str,
    options: &OpenOptions,
) -> Read<OpenedScene> {
    let mut warnings = Warnings::default();
    if !is_binary(file)? && looks_like_text(&file.head(WORD_BYTES)?) {
        let (mesh, listed) = read_text(file, allowance, &mut warnings)?;
        return Ok(loaded(name, mesh, listed, warnings));
    }
    let Some(count) = facet_count(file)? else {
        let expected = format!("\"solid\" or a header of {HEADER_BYTES} bytes");
        return Err(malformed("file", expected, format!("{} bytes", file.len())));
    };
    let Some(facets) = file.slice(HEADER_BYTES, u64::from(count) * FACET_BYTES as u64) else {
        let expected = format!("{} bytes for {count} facets", binary_bytes(count));
        return Err(malformed(
            "facets",
            expected,
            format!("{} bytes", file.len()),
        ));
    };
    let rest = file.len() - binary_bytes(count);
    warnings.add("bytes after the last facet left out", rest, "file");
    let facets = Facets {
        rows: Rows {
            extent: facets,
            stride: FACET_BYTES,
            row_bytes: FACET_BYTES,
        },
        count: u64::from(count),
    };
    // Sharp edges may part all corners again.
    let bytes = array_bytes(3 * facets.count, facets.count, Present::default());
    if bytes > options.max_mesh_bytes && count > 0 {
        let what = "normals not made for meshes that are read in pieces";
        warnings.add(what, 1, "file");
        let mesh = StreamedMesh::new(name.to_owned(), vec![0], facets.count, Box::new(facets));
        let mesh = Some(OpenedMesh::Streamed(mesh));
        let triangles = u64::from(count);
        let materials = vec![plain::material()];
        return Ok(plain::scene(
            name,
            mesh,
            materials,
            vec![],
            triangles,
            warnings,
        ));
    }
    plain::check_triangle_count(facets.count, "facets")?;
    let mesh = facets.mesh(0..facets.count, &mut warnings)?;
    Ok(loaded(name, mesh, facets.count, warnings))
}

fn loaded(name: &str, mut mesh: Mesh, listed: u64, mut warnings: Warnings) -> OpenedScene {
    let mesh = (!mesh.triangles.is_empty()).then(|| {
        plain::complete_normals(&mut mesh, &mut warnings);
        mesh.name = name.to_owned();
        mesh.material_slots = vec![0];
        OpenedMesh::Loaded(mesh)
    });
    plain::scene(
        name,
        mesh,
        vec![plain::material()],
        vec![],
        listed,
        warnings,
    )
}

/// The facets of a binary file.
struct Facets {
    rows: Rows,
    count: u64,
}

impl Facets {
    fn mesh(&self, range: std::ops::Range<u64>, warnings: &mut Warnings) -> Read<Mesh> {
        // In range: every facet has its bytes in the file.
        let mut corners = Corners::new((range.end - range.start) as usize);
        let mut with_attribute = 0;
        let place = format!("facets from {}", range.start);
        self.rows.visit_range(range, |facet, bytes| {
            let float = |at: usize| {
                let word = bytes[12 + 4 * at..].first_chunk().copied();
                f32::from_le_bytes(word.unwrap_or_default())
            };
            let positions: [[f32; 3]; 3] =
                std::array::from_fn(|corner| std::array::from_fn(|axis| float(3 * corner + axis)));
            with_attribute += u64::from(bytes[48..50] != [0, 0]);
            corners.push(positions, || format!("facet {facet}"))
        })?;
        warnings.add(
            "facets whose attribute bytes are left out",
            with_attribute,
            &place,
        );
        Ok(corners.into_mesh(&place, warnings))
    }
}

impl Pieces for Facets {
    fn count(&self) -> usize {
        self.count.div_ceil(PIECE_TRIANGLES) as usize
    }

    fn read(&self, index: usize, warnings: &mut Warnings) -> Read<Piece> {
        let first = (index as u64 * PIECE_TRIANGLES).min(self.count);
        let range = first..(first + PIECE_TRIANGLES).min(self.count);
        Ok(Piece {
            mesh: self.mesh(range, warnings)?,
            array: 0,
            used: None,
        })
    }
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

    fn push(&mut self, positions: [[f32; 3]; 3], place: impl Fn() -> String) -> Read<()> {
        if !positions.iter().flatten().all(|it| it.is_finite()) {
            return Err(malformed(
                place(),
                "finite numbers",
                format!("{positions:?}"),
            ));
        }
        self.triangles
            .push(positions.map(|position| self.weld.vertex(position)));
        Ok(())
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

/// Words of a text, with the line that each stands in.
struct Words {
    reader: Reader,
    line: u64,
}

impl Words {
    /// The next word in small letters; empty at the end.
    fn next(&mut self) -> Read<String> {
        let mut word = String::new();
        loop {
            let Some(byte) = self.peek()? else {
                return Ok(word);
            };
            if byte.is_ascii_whitespace() {
                if !word.is_empty() {
                    return Ok(word);
                }
                self.line += u64::from(byte == b'\n');
            } else {
                word.push(char::from(byte).to_ascii_lowercase());
                if word.len() as u64 > WORD_BYTES {
                    return Err(self.unexpected("a word of STL", "one without an end"));
                }
            }
            self.reader.consume(1);
        }
    }

    fn peek(&mut self) -> Read<Option<u8>> {
        match self.reader.fill_buf() {
            Ok(bytes) => Ok(bytes.first().copied()),
            Err(cause) => {
                let place = format!("line {}", self.line);
                Err(cannot_read(place, std::path::Path::new("file"), &cause))
            }
        }
    }

    /// Leaves out the rest of the line: the name of a solid.
    fn skip_line(&mut self) -> Read<()> {
        while let Some(byte) = self.peek()? {
            if byte == b'\n' {
                return Ok(());
            }
            self.reader.consume(1);
        }
        Ok(())
    }

    fn expect(&mut self, keyword: &str) -> Read<()> {
        let word = self.next()?;
        match word == keyword {
            true => Ok(()),
            false => Err(self.unexpected(keyword, &word)),
        }
    }

    fn float(&mut self) -> Read<f32> {
        let word = self.next()?;
        let number = word.parse::<f32>();
        number.map_err(|_| self.unexpected("a number", &word))
    }

    fn vector(&mut self) -> Read<[f32; 3]> {
        Ok([self.float()?, self.float()?, self.float()?])
    }

    fn unexpected(&self, expected: &str, found: &str) -> super::error::Fault {
        let found = match found.is_empty() {
            true => "the end of the file".to_owned(),
            false => format!("\"{found}\""),
        };
        malformed(format!("line {}", self.line), expected, found)
    }
}

/// `solid NAME`, facets of three corners, `endsolid NAME`; several solids become one mesh.
fn read_text(file: &Extent, allowance: &Allowance, warnings: &mut Warnings) -> Read<(Mesh, u64)> {
    let mut words = Words {
        reader: file.reader(0),
        line: 1,
    };
    let mut corners = Corners::new(0);
    loop {
        match words.next()?.as_str() {
            "" => break,
            "solid" => words.skip_line()?,
            other => return Err(words.unexpected("solid", other)),
        }
        loop {
            match words.next()?.as_str() {
                "facet" => {}
                "endsolid" => break words.skip_line()?,
                other => return Err(words.unexpected("facet or endsolid", other)),
            }
            words.expect("normal")?;
            // Some writers give NaN for a facet without an area; the normal is not read anyway.
            for _ in 0..3 {
                words.next()?;
            }
            words.expect("outer")?;
            words.expect("loop")?;
            let mut positions = [[0.0; 3]; 3];
            for position in &mut positions {
                words.expect("vertex")?;
                *position = words.vector()?;
            }
            words.expect("endloop")?;
            words.expect("endfacet")?;
            let line = words.line;
            corners.push(positions, || format!("facet that ends at line {line}"))?;
            plain::check_triangle_count(corners.triangles.len() as u64, "facets")?;
            if corners.triangles.len().is_multiple_of(plain::BETWEEN_LOOKS) {
                allowance.fits(corners.held_bytes(), format!("line {line}"))?;
            }
        }
    }
    allowance.fits(corners.held_bytes(), "file")?;
    let listed = corners.triangles.len() as u64;
    Ok((corners.into_mesh("file", warnings), listed))
}

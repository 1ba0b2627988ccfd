//! Binary facets: how many there are, where they lie, and their pieces.

use std::ops::Range;

use super::{Corners, NOT_FINITE, loaded};
use crate::import::attributes::Present;
use crate::import::error::{Read, malformed};
use crate::import::file::Extent;
use crate::import::opened::{
    OpenOptions, OpenedMesh, OpenedScene, PIECE_TRIANGLES, Piece, Pieces, StreamedMesh, array_bytes,
};
use crate::import::origin::{Bounds, Origin};
use crate::import::plain;
use crate::import::rows::Rows;
use crate::import::scene::Mesh;
use crate::import::warnings::Warnings;

const HEADER_BYTES: u64 = 84;
const FACET_BYTES: usize = 50;
/// Facets that are looked at where header and length disagree.
const LOOKED_AT: u64 = 1 << 12;

/// Whether the length is exactly the one that the count of a binary file asks for.
pub(in crate::import) fn is_binary(file: &Extent) -> Read<bool> {
    Ok(header_count(file)?.is_some_and(|count| binary_bytes(count) == file.len()))
}

/// The count that the header gives; `None` where there is no header.
fn header_count(file: &Extent) -> Read<Option<u64>> {
    if file.len() < HEADER_BYTES {
        return Ok(None);
    }
    let mut count = [0; 4];
    file.read_at(HEADER_BYTES - 4, &mut count)?;
    Ok(Some(u32::from_le_bytes(count).into()))
}

fn binary_bytes(count: u64) -> u64 {
    HEADER_BYTES + count * FACET_BYTES as u64
}

/// Reads the facets in `file`.
pub(super) fn read(
    file: &Extent,
    name: &str,
    options: &OpenOptions,
    mut warnings: Warnings,
) -> Read<OpenedScene> {
    let facets = Facets::open(file, &mut warnings)?;
    let (count, origin) = (facets.count, facets.origin);
    let listed = count - facets.not_finite;
    // Sharp edges may part all corners again.
    let bytes = array_bytes(3 * count, count, Present::default());
    if bytes > options.max_mesh_bytes && listed > 0 {
        let what = "normals not made for meshes that are read in pieces";
        warnings.add(what, 1, "file");
        let mesh = StreamedMesh::new(name.to_owned(), vec![0], listed, Box::new(facets));
        let mesh = Some((OpenedMesh::Streamed(mesh), origin));
        let materials = vec![plain::material()];
        return Ok(plain::scene(
            name,
            mesh,
            materials,
            vec![],
            listed,
            warnings,
        ));
    }
    plain::check_triangle_count(count, "facets")?;
    let mesh = facets.mesh(0..count, &mut warnings)?;
    Ok(loaded(name, mesh, origin, listed, warnings))
}

/// The facets of a file.
struct Facets {
    rows: Rows,
    count: u64,
    not_finite: u64,
    origin: Origin,
}

impl Facets {
    fn open(file: &Extent, warnings: &mut Warnings) -> Read<Self> {
        let Some(written) = header_count(file)? else {
            let expected = format!("\"solid\" or a header of {HEADER_BYTES} bytes");
            return Err(malformed("file", expected, format!("{} bytes", file.len())));
        };
        let body = file.len() - HEADER_BYTES;
        let room = body / FACET_BYTES as u64;
        let rest = body % FACET_BYTES as u64;
        let extent = file.slice(HEADER_BYTES, body);
        let mut facets = Self {
            rows: Rows {
                extent: extent.unwrap_or_else(|| file.clone()),
                stride: FACET_BYTES,
                row_bytes: FACET_BYTES,
            },
            count: written,
            not_finite: 0,
            origin: Origin::default(),
        };
        // None yet, or -1.
        let is_unknown = written < room || written == u64::from(u32::MAX);
        match () {
            // Nothing of another file adds up like that.
            () if written == room && (rest == 0 || room > 0) => {}
            // Some writers never put the count in.
            () if is_unknown && rest == 0 && facets.are_plausible(room)? => {
                let what = "facet counts of headers left out for what the length holds";
                warnings.add(what, 1, &format!("count {written} before {room} facets"));
                facets.count = room;
            }
            () if 0 < written && written < room && facets.are_plausible(written)? => {}
            () => {
                let expected = format!("{} bytes for {written} facets", binary_bytes(written));
                let found = format!("{} bytes", file.len());
                return Err(malformed("facets", expected, found));
            }
        }
        let rest = file.len() - binary_bytes(facets.count);
        warnings.add("bytes after the last facet left out", rest, "file");
        facets.measure(warnings)?;
        Ok(facets)
    }

    /// Whether nine tenths of the first of `count` facets are triangles with coordinates as models
    /// have them: in bytes of another file one facet in two hundred is.
    fn are_plausible(&self, count: u64) -> Read<bool> {
        let looked_at = count.min(LOOKED_AT);
        let mut plausible = 0u64;
        self.rows.visit_range(0..looked_at, |_, bytes| {
            // Small integers are below, as floats; sines of whole turns are not.
            let is_size = |it: &f32| *it == 0.0 || (1e-30..1e12).contains(&it.abs());
            let [a, b, c] = corners(bytes);
            let is_triangle = a != b && b != c && c != a;
            let all = [a, b, c];
            plausible += u64::from(is_triangle && all.iter().flatten().all(is_size));
            Ok(())
        })?;
        Ok(plausible * 10 >= looked_at * 9)
    }

    /// Finds the origin, and facets that are left out.
    fn measure(&mut self, warnings: &mut Warnings) -> Read<()> {
        let (mut bounds, mut first) = (Bounds::EMPTY, 0);
        let (mut not_finite, mut with_attribute) = (0, 0);
        self.rows.visit_range(0..self.count, |facet, bytes| {
            with_attribute += u64::from(bytes[48..50] != [0, 0]);
            let corners = corners(bytes);
            if is_finite(&corners) {
                let corners = corners.iter();
                corners.for_each(|it| bounds.add(it.map(f64::from)));
            } else {
                first = if not_finite == 0 { facet } else { first };
                not_finite += 1;
            }
            Ok(())
        })?;
        warnings.add(NOT_FINITE, not_finite, &format!("facet {first}"));
        let what = "facets whose attribute bytes are left out";
        warnings.add(what, with_attribute, "facets");
        self.not_finite = not_finite;
        self.origin = Origin::of(bounds);
        Ok(())
    }

    fn mesh(&self, range: Range<u64>, warnings: &mut Warnings) -> Read<Mesh> {
        // In range: every facet has its bytes in the file.
        let mut mesh = Corners::new((range.end - range.start) as usize);
        let place = format!("facets from {}", range.start);
        self.rows.visit_range(range, |_, bytes| {
            let corners = corners(bytes);
            if is_finite(&corners) {
                let local = |it: [f32; 3]| self.origin.local(it.map(f64::from));
                mesh.push(corners.map(local));
            }
            Ok(())
        })?;
        Ok(mesh.into_mesh(&place, warnings))
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

/// The corners of a facet, behind its normal.
fn corners(facet: &[u8]) -> [[f32; 3]; 3] {
    let float = |at: usize| {
        let word = facet[12 + 4 * at..].first_chunk().copied();
        f32::from_le_bytes(word.unwrap_or_default())
    };
    std::array::from_fn(|corner| std::array::from_fn(|axis| float(3 * corner + axis)))
}

fn is_finite(corners: &[[f32; 3]; 3]) -> bool {
    corners.iter().flatten().all(|it| it.is_finite())
}

//! The disk form of a page: what is stored and sent, made to be small after a byte-wise LZ, and the staged form that it is read
//! into, from which the GPU makes the memory form.
//!
//! ```text
//! stored: header (16 words) | columns (13) | parents | steps | extra bytes | kinds | repeated | inherited | vertex planes | tables
//! staged: header (16 words) | columns (12, a word a cluster) | strips | sources (a word a vertex) | vertex planes | tables
//! ```
//!
//! Triangles are steps around open edges (see `topology`). A vertex that an earlier cluster of the page or a parent has is named,
//! not stored (see `sources`); of the others the planes hold, byte by byte and field by field, how far they are from what is expected of
//! them (see `predict`). [`memory_form`] undoes all this on the CPU, bit for bit as the GPU does.

mod check;
mod digits;
mod encode;
mod form;
mod order;
mod parse;
mod predict;
mod restore;
mod ring;
mod sources;
mod stored;
mod topology;

pub use encode::encode;
pub use form::DiskForm;
pub use order::canonical;
pub use parse::ClusterSpan;
pub use predict::SURFACE_BITS;
pub use restore::memory_form;
pub use sources::{Parent, word as source_word};

use crate::cluster::Attributes;
use crate::memory_form::{CLUSTER_HEADER_WORDS, ClusterHeader, cluster_word};
pub use stored::{Part, sections};

use stored::Counts;

/// "LSD5".
pub const MAGIC: u32 = u32::from_le_bytes(*b"LSD5");
/// Words before the first column.
pub const HEADER_WORDS: usize = 16;
/// Staged columns: every word of a cluster header but its payload offset and its extents, which follow from the others.
pub const COLUMNS: usize = CLUSTER_HEADER_WORDS - 4;
/// First bit of a cluster's round in its counts; the memory form has zeros there.
pub const ROUND_SHIFT: u32 = 28;

/// Word numbers inside the header.
pub mod header_word {
    /// [`super::MAGIC`].
    pub const MAGIC: usize = 0;
    /// Which vertex attributes the page has.
    pub const ATTRIBUTES: usize = 1;
    /// Clusters in the page.
    pub const CLUSTER_COUNT: usize = 2;
    /// The page's number in its asset.
    pub const PAGE: usize = 3;
    /// Vertices of all clusters.
    pub const VERTEX_COUNT: usize = 4;
    /// Triangles of all clusters.
    pub const TRIANGLE_COUNT: usize = 5;
    /// Words of the material tables.
    pub const TABLE_WORDS: usize = 6;
    /// Words of the memory form that this page becomes.
    pub const MEMORY_WORDS: usize = 7;
    /// Bytes of x, y, z, u, v: four bits each from bit 0.
    pub const PLANE_WIDTHS: usize = 8;
    /// Extra bytes of the triangles.
    pub const EXTRA_BYTES: usize = 9;
    /// Bytes of the steps.
    pub const STEP_BYTES: usize = 10;
    /// Vertices of earlier clusters of the page.
    pub const REPEATED: usize = 11;
    /// Vertices of parents.
    pub const INHERITED: usize = 12;
    /// Parents of all groups.
    pub const PARENTS: usize = 13;
    /// Rounds in which clusters are unpacked.
    pub const ROUNDS: usize = 14;
    /// Words of all clusters' strips in the memory form.
    pub const STRIP_WORDS: usize = 15;
}

/// Fields of a vertex in plane order: x, y, z, normal u, v, texture u, v, r, g, b, a.
pub const FIELDS: usize = 11;

/// First fields of the attributes.
pub mod field {
    /// Normals.
    pub const NORMAL: usize = 3;
    /// Texture coordinates.
    pub const UV: usize = 5;
    /// Colours.
    pub const COLOR: usize = 7;
}

/// Where the sections of the staged form lie, in words; a pure function of the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Clusters, also the words of one column.
    pub cluster_count: usize,
    /// First word of the strips, those of all clusters as the memory form has them.
    pub strips: usize,
    /// First of the words that say where vertices come from.
    pub sources: usize,
    /// First word of the vertex planes.
    pub vertex_planes: usize,
    /// Words of one vertex plane.
    pub vertex_plane_words: usize,
    /// Bytes of each field: x, y, z, normal u, v, texture u, v, r, g, b, a.
    pub field_bytes: [usize; FIELDS],
    /// First word of the material tables, which end the form.
    pub tables: usize,
    /// Words of the whole form.
    pub words: usize,
}

impl Layout {
    fn new(attributes: Attributes, counts: &Counts, plane_widths: u32) -> Self {
        let width = |field: usize| (plane_widths >> (4 * field) & 0xf) as usize;
        let when = |flag, bytes| if attributes.has(flag) { bytes } else { 0 };
        let normal = when(Attributes::NORMAL, 2);
        let color = when(Attributes::COLOR, 1);
        let field_bytes = [
            width(0),
            width(1),
            width(2),
            normal,
            normal,
            width(3),
            width(4),
            color,
            color,
            color,
            color,
        ];
        let strips = HEADER_WORDS + COLUMNS * counts.clusters;
        let sources = strips + counts.strip_words;
        let vertex_planes = sources + counts.vertices;
        let vertex_plane_words = counts.own().div_ceil(4);
        let tables = vertex_planes + field_bytes.iter().sum::<usize>() * vertex_plane_words;
        Self {
            cluster_count: counts.clusters,
            strips,
            sources,
            vertex_planes,
            vertex_plane_words,
            field_bytes,
            tables,
            words: tables + counts.table_words,
        }
    }

    /// First word of the column of word `word` of the cluster headers (`word` is not the payload's and below the extents').
    pub fn column(&self, word: usize) -> usize {
        let column = if word > cluster_word::PAYLOAD {
            word - 1
        } else {
            word
        };
        HEADER_WORDS + column * self.cluster_count
    }
}

/// The round in which a cluster is unpacked.
fn round(header: &ClusterHeader) -> u32 {
    header.0[cluster_word::COUNTS] >> ROUND_SHIFT
}

/// Rounds of a page.
fn rounds<'a>(headers: impl Iterator<Item = &'a ClusterHeader>) -> u32 {
    headers.map(|header| round(header) + 1).max().unwrap_or(0)
}

/// Bytes of the widest x, y, z, u, v of a page, as its header has them.
fn plane_widths<'a>(headers: impl Iterator<Item = &'a ClusterHeader> + Clone) -> u32 {
    (0..5).fold(0, |word, field| {
        let widths = headers.clone().map(|header| header.widths()[field]);
        word | widths.max().unwrap_or(0).div_ceil(8) << (4 * field)
    })
}

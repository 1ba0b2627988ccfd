//! The disk form of a page: what is stored and sent, made to be small after a byte-wise LZ, and the staged form that it is read
//! into, from which `transcode` gathers the memory form.
//!
//! ```text
//! stored: header (16 words) | columns (13) | control bytes | extra bytes | reference planes (2) | vertex planes | material tables
//! staged: header (16 words) | columns (15, a word a cluster) | index planes (3) | vertex planes | material tables
//! ```
//!
//! A plane holds one byte of one field of every cluster, triangle or vertex of the page, padded to a word. Vertex planes, in
//! order: the bytes of x, y, z from low to high, then normal u, v, then texture u, v, then r, g, b, a. Staged values are what the
//! memory form packs: offsets from the cluster's smallest value. Stored ones are how far those are from what is expected of them
//! (see `predict`), and triangles are bytes that name edges (see `topology`). A vertex that an earlier cluster of the page has is stored
//! as a reference to it (see `shared`).

mod check;
mod encode;
mod form;
mod parse;
mod predict;
mod shared;
mod stored;
mod topology;

pub use encode::encode;
pub use form::DiskForm;
pub use parse::ClusterSpan;
pub use topology::canonical;

use crate::cluster::Attributes;
use crate::memory_form::CLUSTER_HEADER_WORDS;

/// "LSD3".
pub const MAGIC: u32 = u32::from_le_bytes(*b"LSD3");
/// Words before the first column.
pub const HEADER_WORDS: usize = 16;
/// Staged columns: every word of a cluster header but its payload offset, which follows from the others.
pub const COLUMNS: usize = CLUSTER_HEADER_WORDS - 1;

/// Word numbers inside the header; the rest is zero.
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
    /// Extra bytes of all clusters; they are not staged.
    pub const EXTRA_BYTES: usize = 9;
    /// Vertices that are references; they are staged like all others.
    pub const SHARED_VERTICES: usize = 10;
}

/// Fields of a vertex in plane order.
pub const FIELDS: usize = 11;

/// Where the sections of the staged form lie, in words; a pure function of the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Clusters, also the words of one column.
    pub cluster_count: usize,
    /// First word of the three index planes.
    pub index_planes: usize,
    /// Words of one index plane.
    pub index_plane_words: usize,
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
    fn new(
        attributes: Attributes,
        cluster_count: usize,
        vertex_count: usize,
        triangle_count: usize,
        table_words: usize,
        plane_widths: u32,
    ) -> Self {
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
        let index_planes = HEADER_WORDS + COLUMNS * cluster_count;
        let index_plane_words = triangle_count.div_ceil(4);
        let vertex_planes = index_planes + 3 * index_plane_words;
        let vertex_plane_words = vertex_count.div_ceil(4);
        let tables = vertex_planes + field_bytes.iter().sum::<usize>() * vertex_plane_words;
        Self {
            cluster_count,
            index_planes,
            index_plane_words,
            vertex_planes,
            vertex_plane_words,
            field_bytes,
            tables,
            words: tables + table_words,
        }
    }

    /// First word of the lowest byte's plane of a vertex field.
    pub fn field_plane(&self, field: usize) -> usize {
        self.vertex_planes
            + self.field_bytes[..field].iter().sum::<usize>() * self.vertex_plane_words
    }

    /// First word of the column of word `word` of the cluster headers (`word` is not the payload's).
    pub fn column(&self, word: usize) -> usize {
        let column = if word > crate::memory_form::cluster_word::PAYLOAD {
            word - 1
        } else {
            word
        };
        HEADER_WORDS + column * self.cluster_count
    }
}

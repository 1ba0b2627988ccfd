//! Where the sections of the stored bytes lie, and the columns of the cluster headers in them.

use super::{FIELDS, HEADER_WORDS};
use crate::memory_form::{CLUSTER_HEADER_WORDS, ClusterHeader, cluster_word};

/// Words of a cluster header that are stored: what the others are follows from these and from the vertices.
const STORED_WORDS: [usize; 12] = [
    cluster_word::COUNTS,
    cluster_word::ORIGIN,
    cluster_word::ORIGIN + 1,
    cluster_word::ORIGIN + 2,
    cluster_word::WIDTHS,
    cluster_word::COLOR_WIDTHS,
    cluster_word::UV_MIN,
    cluster_word::UV_MIN + 1,
    cluster_word::COLOR_MIN,
    cluster_word::MATERIALS,
    cluster_word::CHILD_GROUP,
    cluster_word::GROUP,
];
/// Columns: the stored words of every cluster's header, and its number of extra bytes.
const COLUMNS: usize = STORED_WORDS.len() + 1;

/// First byte of every section, and the bytes of the whole; a pure function of the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stored {
    clusters: usize,
    columns: usize,
    pub control: usize,
    pub extra: usize,
    pub extra_bytes: usize,
    pub references: usize,
    /// Vertices that are references, and those that are not.
    pub shared: usize,
    pub own: usize,
    pub vertex_planes: usize,
    pub vertex_plane_bytes: usize,
    pub tables: usize,
    pub bytes: usize,
}

/// Planes end at a word.
fn padded(bytes: usize) -> usize {
    bytes.next_multiple_of(4)
}

impl Stored {
    pub fn new(
        clusters: usize,
        [shared, own]: [usize; 2],
        triangles: usize,
        extra_bytes: usize,
        field_bytes: &[usize; FIELDS],
        table_words: usize,
    ) -> Self {
        let columns = 4 * HEADER_WORDS;
        let control = columns + 4 * COLUMNS * padded(clusters);
        let extra = control + padded(triangles);
        let references = extra + padded(extra_bytes);
        let vertex_planes = references + 2 * padded(shared);
        let vertex_plane_bytes = padded(own);
        let tables = vertex_planes + field_bytes.iter().sum::<usize>() * vertex_plane_bytes;
        Self {
            clusters,
            columns,
            control,
            extra,
            extra_bytes,
            references,
            shared,
            own,
            vertex_planes,
            vertex_plane_bytes,
            tables,
            bytes: tables + 4 * table_words,
        }
    }

    /// Headers, without what is not stored, and numbers of extra bytes.
    pub fn read_columns(&self, bytes: &[u8]) -> Vec<(ClusterHeader, u32)> {
        let mut all = vec![(ClusterHeader([0; CLUSTER_HEADER_WORDS]), 0); self.clusters];
        for column in 0..COLUMNS {
            let mut last = 0u32;
            for (cluster, (header, extras)) in all.iter_mut().enumerate() {
                let byte = |byte: usize| bytes[self.column_plane(column, byte) + cluster];
                let stored = u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]);
                let signed = (stored >> 1) ^ (stored & 1).wrapping_neg();
                last = last.wrapping_add(signed);
                match STORED_WORDS.get(column) {
                    Some(&word) => header.0[word] = last,
                    None => *extras = last,
                }
            }
        }
        all
    }

    /// Writes them.
    pub fn write_columns(&self, headers: &[(ClusterHeader, u32)], bytes: &mut [u8]) {
        for column in 0..COLUMNS {
            let mut last = 0u32;
            for (cluster, (header, extras)) in headers.iter().enumerate() {
                let value = match STORED_WORDS.get(column) {
                    Some(&word) => header.0[word],
                    None => *extras,
                };
                let signed = value.wrapping_sub(last) as i32;
                last = value;
                let stored = ((signed << 1) ^ (signed >> 31)) as u32;
                for (byte, value) in stored.to_le_bytes().into_iter().enumerate() {
                    bytes[self.column_plane(column, byte) + cluster] = value;
                }
            }
        }
    }

    /// The stored number of a reference.
    pub fn reference(&self, bytes: &[u8], number: usize) -> u16 {
        let plane = |byte: usize| bytes[self.references + byte * padded(self.shared) + number];
        u16::from_le_bytes([plane(0), plane(1)])
    }

    /// Writes them.
    pub fn write_references(&self, references: &[u16], bytes: &mut [u8]) {
        for (number, reference) in references.iter().enumerate() {
            for (byte, value) in reference.to_le_bytes().into_iter().enumerate() {
                bytes[self.references + byte * padded(self.shared) + number] = value;
            }
        }
    }

    fn column_plane(&self, column: usize, byte: usize) -> usize {
        self.columns + (4 * column + byte) * padded(self.clusters)
    }
}

//! Where the sections of the stored bytes lie, and the columns and planes in them.

use super::{FIELDS, HEADER_WORDS, Layout, field, header_word};
use crate::cluster::Attributes;
use crate::error::{FormatError, ensure};
use crate::limits::{MAX_DISK_FORM_BYTES, PAGE_WORDS};
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
/// Columns of clusters: the stored words of their headers, and the number of their group's parents.
const COLUMNS: usize = STORED_WORDS.len() + 1;
/// Bytes of a parent: page (4) and cluster (2).
const PARENT_PLANES: usize = 6;

/// How much of everything a page has, as its header says.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub clusters: usize,
    pub vertices: usize,
    pub triangles: usize,
    pub table_words: usize,
    pub extra_bytes: usize,
    pub step_bytes: usize,
    pub repeated: usize,
    pub inherited: usize,
    pub parents: usize,
    pub strip_words: usize,
}

impl Counts {
    /// Vertices that are neither repeated nor inherited.
    pub fn own(&self) -> usize {
        self.vertices - self.repeated - self.inherited
    }

    /// Reads and checks them.
    pub fn read(header: &[u32]) -> Result<Self, FormatError> {
        let size = |word: usize, at: &str, range: std::ops::RangeInclusive<usize>| {
            let value = header[word] as usize;
            ensure(range.contains(&value), at, format_args!("{range:?}"), value).map(|()| value)
        };
        let most = MAX_DISK_FORM_BYTES;
        let clusters = 1..=crate::limits::MAX_PAGE_CLUSTERS;
        let clusters = size(header_word::CLUSTER_COUNT, "disk form clusters", clusters)?;
        let vertices = size(header_word::VERTEX_COUNT, "disk form vertices", 1..=most)?;
        let triangles = size(header_word::TRIANGLE_COUNT, "disk form triangles", 1..=most)?;
        let repeated = 0..=vertices;
        let repeated = size(
            header_word::REPEATED,
            "disk form repeated vertices",
            repeated,
        )?;
        let inherited = 0..=vertices - repeated;
        Ok(Self {
            clusters,
            vertices,
            triangles,
            table_words: size(
                header_word::TABLE_WORDS,
                "disk form table words",
                0..=PAGE_WORDS,
            )?,
            extra_bytes: size(
                header_word::EXTRA_BYTES,
                "disk form extra bytes",
                0..=4 * triangles,
            )?,
            step_bytes: size(
                header_word::STEP_BYTES,
                "disk form step bytes",
                0..=2 * triangles,
            )?,
            repeated,
            inherited: size(
                header_word::INHERITED,
                "disk form inherited vertices",
                inherited,
            )?,
            parents: size(header_word::PARENTS, "disk form parents", 0..=most)?,
            strip_words: size(
                header_word::STRIP_WORDS,
                "disk form strip words",
                1..=PAGE_WORDS,
            )?,
        })
    }
}

/// First byte of every section, and the bytes of the whole; a pure function of the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stored {
    counts: Counts,
    parents: usize,
    steps: usize,
    extra: usize,
    kinds: usize,
    repeated: usize,
    inherited: usize,
    vertex_planes: usize,
    tables: usize,
    pub bytes: usize,
}

/// Sections and planes end at a word.
fn padded(bytes: usize) -> usize {
    bytes.next_multiple_of(4)
}

/// Bytes of the digits that say where vertices come from.
fn kind_bytes(vertices: usize) -> usize {
    vertices.div_ceil(5)
}

/// Small numbers of either sign first: 0, -1, 1, -2, …
fn folded(signed: i32) -> u32 {
    ((signed << 1) ^ (signed >> 31)) as u32
}

/// What was folded.
pub(super) fn unfolded(stored: u32) -> u32 {
    (stored >> 1) ^ (stored & 1).wrapping_neg()
}

impl Stored {
    pub fn new(counts: Counts, field_bytes: &[usize; FIELDS]) -> Self {
        let parents = 4 * HEADER_WORDS + 4 * COLUMNS * padded(counts.clusters);
        let steps = parents + PARENT_PLANES * padded(counts.parents);
        let extra = steps + padded(counts.step_bytes);
        let kinds = extra + padded(counts.extra_bytes);
        let repeated = kinds + padded(kind_bytes(counts.vertices));
        let inherited = repeated + 3 * padded(counts.repeated);
        let vertex_planes = inherited + 2 * padded(counts.inherited);
        let planes: usize = field_bytes.iter().sum();
        let tables = vertex_planes + planes * padded(counts.own());
        Self {
            counts,
            parents,
            steps,
            extra,
            kinds,
            repeated,
            inherited,
            vertex_planes,
            tables,
            bytes: tables + 4 * counts.table_words,
        }
    }

    pub fn steps<'a>(&self, bytes: &'a [u8]) -> &'a [u8] {
        &bytes[self.steps..][..self.counts.step_bytes]
    }

    pub fn extra<'a>(&self, bytes: &'a [u8]) -> &'a [u8] {
        &bytes[self.extra..][..self.counts.extra_bytes]
    }

    pub fn kinds<'a>(&self, bytes: &'a [u8]) -> &'a [u8] {
        &bytes[self.kinds..][..kind_bytes(self.counts.vertices)]
    }

    /// Planes of repeated vertices: cluster low, cluster high, vertex.
    pub fn repeated<'a>(&self, bytes: &'a [u8]) -> [&'a [u8]; 3] {
        let planes = planes(bytes, self.repeated, self.counts.repeated);
        [0, 1, 2].map(planes)
    }

    /// Planes of inherited vertices: parent, vertex.
    pub fn inherited<'a>(&self, bytes: &'a [u8]) -> [&'a [u8]; 2] {
        let planes = planes(bytes, self.inherited, self.counts.inherited);
        [0, 1].map(planes)
    }

    /// Copies the vertex planes and the tables to where the staged form has them.
    pub fn stage_planes(&self, bytes: &[u8], layout: &Layout, staged: &mut [u8]) {
        // The same planes as wide, one after the other: one piece.
        let rest = &bytes[self.vertex_planes..];
        staged[4 * layout.vertex_planes..].copy_from_slice(rest);
    }

    /// Headers without what is not stored, and numbers of parents.
    pub fn read_columns(&self, bytes: &[u8]) -> Vec<(ClusterHeader, u32)> {
        let clusters = self.counts.clusters;
        let mut all = vec![(ClusterHeader([0; CLUSTER_HEADER_WORDS]), 0); clusters];
        let planes = planes(bytes, 4 * HEADER_WORDS, clusters);
        for column in 0..COLUMNS {
            let planes: [&[u8]; 4] = std::array::from_fn(|byte| planes(4 * column + byte));
            let mut last = 0u32;
            for (cluster, (header, parents)) in all.iter_mut().enumerate() {
                let stored = u32::from_le_bytes(planes.map(|plane| plane[cluster]));
                last = last.wrapping_add(unfolded(stored));
                match STORED_WORDS.get(column) {
                    Some(&word) => header.0[word] = last,
                    None => *parents = last,
                }
            }
        }
        all
    }

    /// Writes them.
    pub fn write_columns(&self, headers: &[(ClusterHeader, u32)], bytes: &mut [u8]) {
        for column in 0..COLUMNS {
            let values = headers
                .iter()
                .map(|(header, parents)| match STORED_WORDS.get(column) {
                    Some(&word) => header.0[word],
                    None => *parents,
                });
            let first = 4 * HEADER_WORDS + 4 * column * padded(headers.len());
            write_differences::<4>(values, bytes, first, headers.len());
        }
    }

    /// Pages and clusters of the parents.
    pub fn read_parents(&self, bytes: &[u8]) -> Vec<[u32; 2]> {
        let planes = planes(bytes, self.parents, self.counts.parents);
        let planes: [&[u8]; PARENT_PLANES] = std::array::from_fn(planes);
        let (mut page, mut cluster) = (0u32, 0u32);
        let read = |parent: usize| {
            let [a, b, c, d, e, f] = planes.map(|plane| plane[parent]);
            page = page.wrapping_add(unfolded(u32::from_le_bytes([a, b, c, d])));
            cluster = cluster.wrapping_add(unfolded(u32::from_le_bytes([e, f, 0, 0])));
            [page, cluster & 0xffff]
        };
        (0..self.counts.parents).map(read).collect()
    }

    /// Writes them.
    pub fn write_parents(&self, parents: &[[u32; 2]], bytes: &mut [u8]) {
        let count = parents.len();
        let pages = parents.iter().map(|parent| parent[0]);
        write_differences::<4>(pages, bytes, self.parents, count);
        let clusters = parents.iter().map(|parent| parent[1]);
        let first = self.parents + 4 * padded(count);
        write_differences::<2>(clusters, bytes, first, count);
    }

    /// Writes the other sections.
    pub fn write(&self, bytes: &mut [u8], sections: Sections<'_>) {
        let mut put = |first: usize, section: &[u8]| {
            bytes[first..first + section.len()].copy_from_slice(section);
        };
        put(self.steps, sections.steps);
        put(self.extra, sections.extra);
        put(self.kinds, sections.kinds);
        for (plane, section) in sections.repeated.iter().enumerate() {
            put(
                self.repeated + plane * padded(self.counts.repeated),
                section,
            );
        }
        for (plane, section) in sections.inherited.iter().enumerate() {
            put(
                self.inherited + plane * padded(self.counts.inherited),
                section,
            );
        }
        let mut plane = self.vertex_planes;
        for (differences, &field_bytes) in sections.differences.iter().zip(sections.field_bytes) {
            for byte in 0..field_bytes {
                for (slot, value) in bytes[plane..].iter_mut().zip(differences) {
                    *slot = (value >> (8 * byte)) as u8;
                }
                plane += padded(self.counts.own());
            }
        }
        for (word, table) in sections.tables.iter().enumerate() {
            bytes[self.tables + 4 * word..][..4].copy_from_slice(&table.to_le_bytes());
        }
    }
}

/// What the bytes of a section are about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Header, cluster headers, material tables.
    Metadata,
    /// Which triangles there are.
    Topology,
    /// Where repeated and inherited vertices come from.
    References,
    /// Positions of own vertices.
    Positions,
    /// Their normals.
    Normals,
    /// Their texture coordinates.
    Uvs,
    /// Their colours.
    Colors,
}

/// The sections of a disk form, planes apart: what they are about and how many bytes each has, in order.
///
/// # Errors
/// A header that does not give the length of the words.
pub fn sections(words: &[u32]) -> Result<Vec<(Part, usize)>, FormatError> {
    let header = words.get(..HEADER_WORDS).ok_or_else(|| {
        FormatError::new(
            "disk form words",
            format!("at least {HEADER_WORDS}"),
            words.len(),
        )
    })?;
    let counts = Counts::read(header)?;
    let attributes = Attributes(header[header_word::ATTRIBUTES]);
    let layout = Layout::new(attributes, &counts, header[header_word::PLANE_WIDTHS]);
    let stored = Stored::new(counts, &layout.field_bytes);
    ensure(
        stored.bytes == 4 * words.len(),
        "disk form bytes",
        stored.bytes,
        4 * words.len(),
    )?;
    let mut sections = vec![
        (Part::Metadata, 4 * HEADER_WORDS),
        (Part::Metadata, stored.parents - 4 * HEADER_WORDS),
        (Part::References, stored.steps - stored.parents),
        (Part::Topology, stored.extra - stored.steps),
        (Part::Topology, stored.kinds - stored.extra),
        (Part::References, stored.repeated - stored.kinds),
    ];
    sections.extend([(Part::References, padded(counts.repeated)); 3]);
    sections.extend([(Part::References, padded(counts.inherited)); 2]);
    for (number, &field_bytes) in layout.field_bytes.iter().enumerate() {
        let part = match number {
            field::COLOR.. => Part::Colors,
            field::UV.. => Part::Uvs,
            field::NORMAL.. => Part::Normals,
            _ => Part::Positions,
        };
        let plane = (part, padded(counts.own()));
        sections.extend(std::iter::repeat_n(plane, field_bytes));
    }
    sections.push((Part::Metadata, stored.bytes - stored.tables));
    Ok(sections)
}

/// What [`Stored::write`] puts in place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sections<'a> {
    pub steps: &'a [u8],
    pub extra: &'a [u8],
    pub kinds: &'a [u8],
    pub repeated: &'a [Vec<u8>; 3],
    pub inherited: &'a [Vec<u8>; 2],
    pub differences: &'a [Vec<u32>; FIELDS],
    pub field_bytes: &'a [usize; FIELDS],
    pub tables: &'a [u32],
}

/// Planes of `count` bytes from byte `first` on.
fn planes<'a>(bytes: &'a [u8], first: usize, count: usize) -> impl Fn(usize) -> &'a [u8] {
    move |plane| &bytes[first + plane * padded(count)..][..count]
}

/// Writes how far each value is from the one before, in planes of bytes.
fn write_differences<const BYTES: usize>(
    values: impl Iterator<Item = u32>,
    bytes: &mut [u8],
    first: usize,
    count: usize,
) {
    let mut last = 0u32;
    for (index, value) in values.enumerate() {
        // Differences modulo the planes' bits.
        let spare = 32 - 8 * BYTES as u32;
        let signed = (value.wrapping_sub(last) << spare) as i32 >> spare;
        last = value;
        for (byte, value) in folded(signed).to_le_bytes()[..BYTES].iter().enumerate() {
            bytes[first + byte * padded(count) + index] = *value;
        }
    }
}

//! The memory form of a page: what culling, rasterizing and shading read. Words of 32 bits, little-endian.
//!
//! ```text
//! header (8 words) | cluster headers (16 words each) | payloads | material tables
//! payload = strips (see `strips`) | vertex records (bit-packed) | word boundary
//! ```
//!
//! Any triangle and any vertex is reached by arithmetic from its cluster's header: widths are constant in a cluster.

use crate::bits::{BitWriter, bits_for};
use crate::cluster::{Attributes, Cluster, MaterialRange};
use crate::error::{FormatError, ensure};
use crate::limits::{MAX_COORDINATE_BITS, MAX_PAGE_CLUSTERS, PAGE_WORDS};
use crate::octahedral::NORMAL_BITS;
use crate::strips;

/// "LSM2".
pub const MAGIC: u32 = u32::from_le_bytes(*b"LSM2");
/// Words before the first cluster header.
pub const PAGE_HEADER_WORDS: usize = 8;
/// Words of a cluster header.
pub const CLUSTER_HEADER_WORDS: usize = 16;
/// First bit of the words of the strips in a cluster's widths.
pub const STRIP_WORDS_SHIFT: u32 = 25;
/// Set in word 0 of a cluster header whose word 10 is the page word of a material table.
pub const MATERIAL_TABLE_FLAG: u32 = 1 << 23;

/// Word numbers inside the page header.
pub mod page_word {
    /// [`super::MAGIC`].
    pub const MAGIC: usize = 0;
    /// Clusters in the page.
    pub const CLUSTER_COUNT: usize = 1;
    /// Words of the whole memory form.
    pub const WORDS: usize = 2;
    /// [`super::Attributes`].
    pub const ATTRIBUTES: usize = 3;
    /// The page's number in its asset.
    pub const PAGE: usize = 4;
    /// First word of the material tables.
    pub const TABLES: usize = 5;
}

/// Word numbers inside a cluster header.
pub mod cluster_word {
    /// Triangles (8 bits), vertices (9 at 8), level (6 at 17), [`super::MATERIAL_TABLE_FLAG`], index bits (4 at 24).
    pub const COUNTS: usize = 0;
    /// Smallest grid index of each axis, three words.
    pub const ORIGIN: usize = 1;
    /// Bits of x, y, z, u, v: five bits each from bit 0; words of the strips (7 bits at 25).
    pub const WIDTHS: usize = 4;
    /// Bits of r, g, b, a: four bits each from bit 0.
    pub const COLOR_WIDTHS: usize = 5;
    /// First payload word, from the start of the page.
    pub const PAYLOAD: usize = 6;
    /// Smallest u and v on the texture grid, two words.
    pub const UV_MIN: usize = 7;
    /// Smallest r, g, b, a, a byte each.
    pub const COLOR_MIN: usize = 9;
    /// Three slots of six bits and two run lengths of seven, or the page word of a material table.
    pub const MATERIALS: usize = 10;
    /// The finer group that made this cluster, or `NO_GROUP`.
    pub const CHILD_GROUP: usize = 11;
    /// The group that this cluster is a member of.
    pub const GROUP: usize = 12;
    /// Largest grid index less the smallest, three words.
    pub const EXTENT: usize = 13;
}

/// The sixteen words that describe one cluster, in either form (payload and table offsets are zero-based in the disk form).
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct ClusterHeader(pub [u32; CLUSTER_HEADER_WORDS]);

impl ClusterHeader {
    /// Derives widths and bases from a cluster that passed [`Cluster::check`]. Payload and table offsets stay zero; the
    /// table, where three inline ranges of slots below 64 do not suffice, comes back beside it.
    pub fn of(cluster: &Cluster) -> (Self, Vec<u32>) {
        let (min, max) = cluster.extent_q();
        let extent: [u32; 3] = std::array::from_fn(|axis| (max[axis] - min[axis]) as u32);
        let (mut uv_min, mut uv_max) = ([i32::MAX; 2], [i32::MIN; 2]);
        for uv in &cluster.uvs {
            for axis in 0..2 {
                uv_min[axis] = uv_min[axis].min(uv[axis]);
                uv_max[axis] = uv_max[axis].max(uv[axis]);
            }
        }
        if cluster.uvs.is_empty() {
            (uv_min, uv_max) = ([0; 2], [0; 2]);
        }
        let channel = |pick: fn(u8, u8) -> u8, start: u8| -> [u8; 4] {
            std::array::from_fn(|c| {
                cluster
                    .colors
                    .iter()
                    .fold(start, |value, color| pick(value, color[c]))
            })
        };
        let (color_min, color_max) = if cluster.colors.is_empty() {
            ([0; 4], [0; 4])
        } else {
            (channel(u8::min, 255), channel(u8::max, 0))
        };
        let mut words = [0; CLUSTER_HEADER_WORDS];
        let index_bits = bits_for(cluster.positions.len() as u32 - 1);
        words[cluster_word::COUNTS] = cluster.triangles.len() as u32
            | (cluster.positions.len() as u32) << 8
            | (cluster.level as u32) << 17
            | index_bits << 24;
        for axis in 0..3 {
            words[cluster_word::ORIGIN + axis] = min[axis] as u32;
            words[cluster_word::EXTENT + axis] = extent[axis];
            words[cluster_word::WIDTHS] |= bits_for(extent[axis]) << (5 * axis);
        }
        for axis in 0..2 {
            words[cluster_word::UV_MIN + axis] = uv_min[axis] as u32;
            words[cluster_word::WIDTHS] |=
                bits_for(uv_max[axis].wrapping_sub(uv_min[axis]) as u32) << (15 + 5 * axis);
        }
        for c in 0..4 {
            words[cluster_word::COLOR_WIDTHS] |=
                bits_for((color_max[c] - color_min[c]) as u32) << (4 * c);
        }
        words[cluster_word::COLOR_MIN] = u32::from_le_bytes(color_min);
        let mut strips = Vec::new();
        strips::encode(cluster.triangles.iter().copied(), index_bits, &mut strips);
        words[cluster_word::WIDTHS] |= (strips.len() as u32) << STRIP_WORDS_SHIFT;
        words[cluster_word::CHILD_GROUP] = cluster.child_group;
        words[cluster_word::GROUP] = cluster.group;
        let mut table = Vec::new();
        match inline_materials(&cluster.materials) {
            Some(word) => words[cluster_word::MATERIALS] = word,
            None => {
                words[cluster_word::COUNTS] |= MATERIAL_TABLE_FLAG;
                table.push(cluster.materials.len() as u32);
                table.extend(
                    cluster
                        .materials
                        .iter()
                        .map(|range| range.slot as u32 | (range.triangle_count as u32) << 16),
                );
            }
        }
        (Self(words), table)
    }

    /// Triangles, 1..=128.
    pub fn triangle_count(&self) -> u32 {
        self.0[cluster_word::COUNTS] & 0xff
    }

    /// Vertices, 1..=256.
    pub fn vertex_count(&self) -> u32 {
        self.0[cluster_word::COUNTS] >> 8 & 0x1ff
    }

    /// Level in the DAG; 0 holds source triangles.
    pub fn level(&self) -> u32 {
        self.0[cluster_word::COUNTS] >> 17 & 0x3f
    }

    /// Bits of one vertex index.
    pub fn index_bits(&self) -> u32 {
        self.0[cluster_word::COUNTS] >> 24 & 0xf
    }

    /// Whether word 10 points at a material table.
    pub fn has_material_table(&self) -> bool {
        self.0[cluster_word::COUNTS] & MATERIAL_TABLE_FLAG != 0
    }

    /// Smallest grid index of each axis, relative to the asset's centre.
    pub fn origin(&self) -> [i32; 3] {
        std::array::from_fn(|axis| self.0[cluster_word::ORIGIN + axis] as i32)
    }

    /// Largest grid index less the smallest.
    pub fn extent(&self) -> [u32; 3] {
        std::array::from_fn(|axis| self.0[cluster_word::EXTENT + axis])
    }

    /// Bits of x, y, z, u and v.
    pub fn widths(&self) -> [u32; 5] {
        std::array::from_fn(|field| self.0[cluster_word::WIDTHS] >> (5 * field) & 0x1f)
    }

    /// That no coordinate has more bits than a reader takes.
    pub(crate) fn check_coordinate_bits(&self) -> Result<(), FormatError> {
        let widest = self.widths().into_iter().max().unwrap_or(0);
        ensure(
            widest <= MAX_COORDINATE_BITS,
            "bits of a coordinate",
            "at most 24",
            widest,
        )
    }

    /// Bits of r, g, b and a.
    pub fn color_widths(&self) -> [u32; 4] {
        std::array::from_fn(|c| self.0[cluster_word::COLOR_WIDTHS] >> (4 * c) & 0xf)
    }

    /// Smallest u and v.
    pub fn uv_min(&self) -> [i32; 2] {
        std::array::from_fn(|axis| self.0[cluster_word::UV_MIN + axis] as i32)
    }

    /// Smallest r, g, b and a.
    pub fn color_min(&self) -> [u8; 4] {
        self.0[cluster_word::COLOR_MIN].to_le_bytes()
    }

    /// Group that the cluster is a member of.
    pub fn group(&self) -> u32 {
        self.0[cluster_word::GROUP]
    }

    /// Group that made the cluster, or `NO_GROUP`.
    pub fn child_group(&self) -> u32 {
        self.0[cluster_word::CHILD_GROUP]
    }

    /// Words of the triangles.
    pub fn strip_words(&self) -> usize {
        (self.0[cluster_word::WIDTHS] >> STRIP_WORDS_SHIFT) as usize
    }

    /// Bits of each field of a vertex: x, y, z, normal u, v, texture u, v, r, g, b, a.
    pub fn field_bits(&self, attributes: Attributes) -> [u32; 11] {
        let when = |flag, bits| if attributes.has(flag) { bits } else { 0 };
        let [x, y, z, u, v] = self.widths();
        let normal = when(Attributes::NORMAL, NORMAL_BITS);
        let [u, v] = [u, v].map(|bits| when(Attributes::UV, bits));
        let [r, g, b, a] = self
            .color_widths()
            .map(|bits| when(Attributes::COLOR, bits));
        [x, y, z, normal, normal, u, v, r, g, b, a]
    }

    /// Bits of one vertex record.
    pub fn vertex_bits(&self, attributes: Attributes) -> u32 {
        self.field_bits(attributes).iter().sum()
    }

    /// Words of the whole payload.
    pub fn payload_words(&self, attributes: Attributes) -> usize {
        self.strip_words()
            + (self.vertex_count() * self.vertex_bits(attributes)).div_ceil(32) as usize
    }
}

/// Three runs at most, slots below 64: `slot0 | slot1 << 6 | slot2 << 12 | run0 - 1 << 18 | run1 << 25`.
fn inline_materials(ranges: &[MaterialRange]) -> Option<u32> {
    if ranges.len() > 3 || ranges.iter().any(|range| range.slot >= 64) {
        return None;
    }
    let slot = |index: usize| ranges.get(index).map_or(0, |range| range.slot as u32);
    let run = |index: usize| {
        ranges
            .get(index)
            .map_or(0, |range| range.triangle_count as u32)
    };
    Some(slot(0) | slot(1) << 6 | slot(2) << 12 | (run(0) - 1) << 18 | run(1) << 25)
}

/// Words that `cluster` adds to a page, header and material table included.
pub fn cluster_words(cluster: &Cluster, attributes: Attributes) -> usize {
    let (header, table) = ClusterHeader::of(cluster);
    CLUSTER_HEADER_WORDS + header.payload_words(attributes) + table.len()
}

/// Words of a page of clusters with these headers, which keep to the limits.
pub(crate) fn page_words<'a>(
    headers: impl ExactSizeIterator<Item = &'a ClusterHeader>,
    attributes: Attributes,
    table_words: usize,
) -> Result<usize, FormatError> {
    let count = headers.len();
    ensure(
        (1..=MAX_PAGE_CLUSTERS).contains(&count),
        "clusters of a page",
        "1..=2048",
        count,
    )?;
    let mut words = PAGE_HEADER_WORDS + table_words;
    for header in headers {
        header.check_coordinate_bits()?;
        words += CLUSTER_HEADER_WORDS + header.payload_words(attributes);
    }
    ensure(
        words <= PAGE_WORDS,
        "words of a page",
        "at most 32768",
        words,
    )?;
    Ok(words)
}

/// Writes the memory form of page `page` of an asset.
pub fn encode(
    clusters: &[Cluster],
    attributes: Attributes,
    page: u32,
) -> Result<Vec<u32>, FormatError> {
    let mut headers = Vec::with_capacity(clusters.len());
    let mut tables = Vec::new();
    for cluster in clusters {
        cluster.check(attributes)?;
        let (header, table) = ClusterHeader::of(cluster);
        headers.push((header, tables.len()));
        tables.extend(table);
    }
    let all = headers.iter().map(|(header, _)| header);
    let total = page_words(all, attributes, tables.len())?;
    let first_payload = PAGE_HEADER_WORDS + clusters.len() * CLUSTER_HEADER_WORDS;
    let mut payloads = Vec::with_capacity(total - first_payload - tables.len());
    for (cluster, (header, _)) in clusters.iter().zip(&mut headers) {
        header.0[cluster_word::PAYLOAD] = (first_payload + payloads.len()) as u32;
        payloads.extend(payload(cluster, header, attributes));
    }
    let first_table = first_payload + payloads.len();
    let mut words = vec![0; PAGE_HEADER_WORDS];
    words[page_word::MAGIC] = MAGIC;
    words[page_word::CLUSTER_COUNT] = clusters.len() as u32;
    words[page_word::WORDS] = total as u32;
    words[page_word::ATTRIBUTES] = attributes.0;
    words[page_word::PAGE] = page;
    words[page_word::TABLES] = first_table as u32;
    for (mut header, table) in headers {
        if header.has_material_table() {
            header.0[cluster_word::MATERIALS] = (first_table + table) as u32;
        }
        words.extend(header.0);
    }
    words.extend(payloads);
    words.extend(tables);
    Ok(words)
}

fn payload(cluster: &Cluster, header: &ClusterHeader, attributes: Attributes) -> Vec<u32> {
    let mut words = Vec::with_capacity(header.payload_words(attributes));
    let triangles = cluster.triangles.iter().copied();
    strips::encode(triangles, header.index_bits(), &mut words);
    let mut writer = BitWriter::default();
    let (widths, origin, uv_min) = (header.widths(), header.origin(), header.uv_min());
    let (color_widths, color_min) = (header.color_widths(), header.color_min());
    for vertex in 0..cluster.positions.len() {
        for axis in 0..3 {
            writer.push(
                (cluster.positions[vertex][axis] - origin[axis]) as u32,
                widths[axis],
            );
        }
        if attributes.has(Attributes::NORMAL) {
            cluster.normals[vertex]
                .iter()
                .for_each(|&value| writer.push(value as u32, NORMAL_BITS));
        }
        if attributes.has(Attributes::UV) {
            for axis in 0..2 {
                writer.push(
                    cluster.uvs[vertex][axis].wrapping_sub(uv_min[axis]) as u32,
                    widths[3 + axis],
                );
            }
        }
        if attributes.has(Attributes::COLOR) {
            for c in 0..4 {
                writer.push(
                    (cluster.colors[vertex][c] - color_min[c]) as u32,
                    color_widths[c],
                );
            }
        }
    }
    words.extend(writer.into_words());
    words
}

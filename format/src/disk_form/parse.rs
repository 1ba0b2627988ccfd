//! Disk form to checked view: the one place where bytes from outside become trusted. Whatever passes here can be
//! transcoded and drawn without another check.

use super::{FIELDS, HEADER_WORDS, Layout, MAGIC, header_word};
use crate::bits::bits_for;
use crate::cluster::{Attributes, Cluster, MaterialRange};
use crate::error::{FormatError, ensure};
use crate::limits::{
    MAX_COORDINATE_BITS, MAX_DISK_FORM_BYTES, MAX_EXTENT_STEPS, MAX_PAGE_CLUSTERS, PAGE_WORDS,
};
use crate::memory_form::{
    CLUSTER_HEADER_WORDS, ClusterHeader, MATERIAL_TABLE_FLAG, PAGE_HEADER_WORDS, cluster_word,
};
use crate::octahedral::NORMAL_BITS;

/// Where one cluster's data begins in either form; follows from the headers before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ClusterSpan {
    /// First vertex in the vertex planes.
    pub first_vertex: u32,
    /// First triangle in the index planes.
    pub first_triangle: u32,
    /// First payload word in the memory form, from the start of the page.
    pub payload_word: u32,
}

/// A page in disk form that passed every check.
#[derive(Debug, Clone)]
pub struct DiskForm {
    words: Vec<u32>,
    layout: Layout,
    headers: Vec<ClusterHeader>,
    spans: Vec<ClusterSpan>,
    tables_word: u32,
}

impl DiskForm {
    /// Checks all of `words`. No input makes it panic or allocate more than a small multiple of its size.
    pub fn parse(words: Vec<u32>) -> Result<Self, FormatError> {
        let most = MAX_DISK_FORM_BYTES / 4;
        ensure(
            (HEADER_WORDS..=most).contains(&words.len()),
            "disk form words",
            "16..=131072",
            words.len(),
        )?;
        let header = &words[..HEADER_WORDS];
        ensure(
            header[header_word::MAGIC] == MAGIC,
            "disk form magic",
            "LSD1",
            hex(header[header_word::MAGIC]),
        )?;
        let attributes = Attributes(header[header_word::ATTRIBUTES]);
        ensure(
            attributes.0 & !Attributes::ALL == 0,
            "disk form attributes",
            "at most 7",
            attributes.0,
        )?;
        let spare = header[header_word::PLANE_WIDTHS + 1..]
            .iter()
            .find(|&&word| word != 0);
        ensure(
            spare.is_none(),
            "disk form spare header words",
            0,
            spare.copied().unwrap_or(0),
        )?;
        let size = |word: usize, at: &str, range: std::ops::RangeInclusive<usize>| {
            let value = header[word] as usize;
            ensure(range.contains(&value), at, format!("{range:?}"), value).map(|()| value)
        };
        let cluster_count = size(
            header_word::CLUSTER_COUNT,
            "disk form clusters",
            1..=MAX_PAGE_CLUSTERS,
        )?;
        let vertex_count = size(
            header_word::VERTEX_COUNT,
            "disk form vertices",
            1..=MAX_DISK_FORM_BYTES,
        )?;
        let triangle_count = size(
            header_word::TRIANGLE_COUNT,
            "disk form triangles",
            1..=MAX_DISK_FORM_BYTES,
        )?;
        let table_words = size(
            header_word::TABLE_WORDS,
            "disk form table words",
            0..=PAGE_WORDS,
        )?;
        let memory_words = size(
            header_word::MEMORY_WORDS,
            "disk form memory words",
            1..=PAGE_WORDS,
        )?;
        let plane_widths = header[header_word::PLANE_WIDTHS];
        let layout = Layout::new(
            attributes,
            cluster_count,
            vertex_count,
            triangle_count,
            table_words,
            plane_widths,
        );
        ensure(
            layout.words == words.len(),
            "disk form words",
            layout.words,
            words.len(),
        )?;

        let mut form = Self {
            words,
            layout,
            headers: Vec::with_capacity(cluster_count),
            spans: Vec::new(),
            tables_word: 0,
        };
        form.read_headers(attributes)?;
        let expected = (0..5).fold(0, |word, field| {
            let widest = form
                .headers
                .iter()
                .map(|header| header.widths()[field])
                .max()
                .unwrap_or(0);
            word | widest.div_ceil(8) << (4 * field)
        });
        ensure(
            plane_widths == expected,
            "disk form plane widths",
            hex(expected),
            hex(plane_widths),
        )?;
        form.place(attributes, vertex_count, triangle_count, memory_words)?;
        for cluster in 0..cluster_count {
            form.check_cluster(cluster, attributes)?;
        }
        Ok(form)
    }

    fn read_headers(&mut self, attributes: Attributes) -> Result<(), FormatError> {
        for cluster in 0..self.layout.cluster_count {
            let mut words = [0; CLUSTER_HEADER_WORDS];
            for (word, value) in words
                .iter_mut()
                .enumerate()
                .filter(|(word, _)| *word != cluster_word::PAYLOAD)
            {
                *value = self.words[self.layout.column(word) + cluster];
            }
            let header = ClusterHeader(words);
            check_header(&header, attributes).map_err(|error| within(error, cluster))?;
            self.headers.push(header);
        }
        Ok(())
    }

    fn place(
        &mut self,
        attributes: Attributes,
        vertices: usize,
        triangles: usize,
        words: usize,
    ) -> Result<(), FormatError> {
        let (mut vertex, mut triangle) = (0, 0);
        let mut payload = PAGE_HEADER_WORDS + CLUSTER_HEADER_WORDS * self.layout.cluster_count;
        for header in &self.headers {
            self.spans.push(ClusterSpan {
                first_vertex: vertex as u32,
                first_triangle: triangle as u32,
                payload_word: payload as u32,
            });
            vertex += header.vertex_count() as usize;
            triangle += header.triangle_count() as usize;
            payload += header.payload_words(attributes);
        }
        ensure(
            vertex == vertices,
            "vertices of all clusters",
            vertices,
            vertex,
        )?;
        ensure(
            triangle == triangles,
            "triangles of all clusters",
            triangles,
            triangle,
        )?;
        self.tables_word = payload as u32;
        let total = payload + self.layout.words - self.layout.tables;
        ensure(total == words, "memory form words", total, words)
    }

    fn check_cluster(&self, cluster: usize, attributes: Attributes) -> Result<(), FormatError> {
        let header = &self.headers[cluster];
        let within = |error| within(error, cluster);
        for triangle in 0..header.triangle_count() {
            let largest = self
                .triangle(cluster, triangle)
                .into_iter()
                .max()
                .unwrap_or(0) as u32;
            ensure(
                largest < header.vertex_count(),
                "triangle index",
                format!("below {}", header.vertex_count()),
                largest,
            )
            .map_err(within)?;
        }
        let widths = header.widths();
        let colors = header.color_widths();
        let color_min = header.color_min();
        for field in (0..FIELDS).filter(|&field| self.layout.field_bytes[field] > 0) {
            let largest = (0..header.vertex_count())
                .map(|vertex| self.offset(cluster, field, vertex))
                .max()
                .unwrap_or(0);
            let (most, exact) = match field {
                0..=2 => (header.extent()[field], true),
                3 | 4 => ((1 << NORMAL_BITS) - 1, false),
                5 | 6 => ((1 << widths[field - 2]) - 1, false),
                _ => (
                    ((1 << colors[field - 7]) - 1).min(255 - color_min[field - 7] as u32),
                    false,
                ),
            };
            let ok = if exact {
                largest == most
            } else {
                largest <= most
            };
            ensure(
                ok,
                "vertex field",
                format!(
                    "{} {most} in field {field}",
                    if exact { "largest" } else { "at most" }
                ),
                largest,
            )
            .map_err(within)?;
        }
        if attributes.has(Attributes::UV) {
            for min in header.uv_min() {
                let most = i32::MAX - (1 << MAX_COORDINATE_BITS);
                ensure(
                    (-most..=most).contains(&min),
                    "texture coordinate",
                    format!("-{most}..={most}"),
                    min,
                )
                .map_err(within)?;
            }
        }
        self.check_materials(cluster).map_err(within)
    }

    fn check_materials(&self, cluster: usize) -> Result<(), FormatError> {
        let header = &self.headers[cluster];
        let ranges = self.materials(cluster)?;
        let sum: u32 = ranges.iter().map(|range| range.triangle_count as u32).sum();
        ensure(
            sum == header.triangle_count(),
            "triangles in material ranges",
            header.triangle_count(),
            sum,
        )?;
        let empty = ranges
            .iter()
            .filter(|range| range.triangle_count == 0)
            .count();
        ensure(empty == 0, "empty material ranges", 0, empty)
    }

    fn materials(&self, cluster: usize) -> Result<Vec<MaterialRange>, FormatError> {
        let header = &self.headers[cluster];
        let word = header.0[cluster_word::MATERIALS];
        if header.has_material_table() {
            let tables = &self.words[self.layout.tables..];
            let count = *tables.get(word as usize).ok_or_else(|| {
                FormatError::new(
                    "material table",
                    format!("an offset below {}", tables.len()),
                    word,
                )
            })?;
            let first = word as usize + 1;
            let ranges = tables
                .get(first..first.saturating_add(count as usize))
                .filter(|_| count <= 128)
                .ok_or_else(|| {
                    FormatError::new(
                        "material table ranges",
                        "at most 128, inside the tables",
                        count,
                    )
                })?;
            return Ok(ranges
                .iter()
                .map(|&range| MaterialRange {
                    slot: range as u16,
                    triangle_count: (range >> 16) as u16,
                })
                .collect());
        }
        let total = header.triangle_count() as u16;
        let first = ((word >> 18 & 0x7f) + 1) as u16;
        let second = (word >> 25) as u16;
        ensure(
            first + second <= total,
            "inline material runs",
            format!("at most {total}"),
            first + second,
        )?;
        let third = total - first - second;
        let slot = |index: u32| (word >> (6 * index) & 0x3f) as u16;
        Ok([(0, first), (1, second), (2, third)]
            .into_iter()
            .filter(|&(_, run)| run > 0)
            .map(|(index, run)| MaterialRange {
                slot: slot(index),
                triangle_count: run,
            })
            .collect())
    }

    fn byte(&self, plane: usize, index: usize) -> u32 {
        self.words[plane + index / 4] >> (8 * (index % 4)) & 0xff
    }

    /// Vertex indices of a triangle of a cluster.
    pub fn triangle(&self, cluster: usize, triangle: u32) -> [u8; 3] {
        let index = (self.spans[cluster].first_triangle + triangle) as usize;
        std::array::from_fn(|corner| {
            self.byte(
                self.layout.index_planes + corner * self.layout.index_plane_words,
                index,
            ) as u8
        })
    }

    /// A vertex field ([`Layout::field_bytes`] order) less the cluster's smallest value.
    pub fn offset(&self, cluster: usize, field: usize, vertex: u32) -> u32 {
        let index = (self.spans[cluster].first_vertex + vertex) as usize;
        let plane = self.layout.field_plane(field);
        (0..self.layout.field_bytes[field]).fold(0, |value, byte| {
            value | self.byte(plane + byte * self.layout.vertex_plane_words, index) << (8 * byte)
        })
    }

    /// The words as they came.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Where the sections lie.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Cluster headers; payload offsets are zero, table offsets count from the first table.
    pub fn headers(&self) -> &[ClusterHeader] {
        &self.headers
    }

    /// Where each cluster's data begins.
    pub fn spans(&self) -> &[ClusterSpan] {
        &self.spans
    }

    /// Which vertex attributes the page has.
    pub fn attributes(&self) -> Attributes {
        Attributes(self.words[header_word::ATTRIBUTES])
    }

    /// The page's number in its asset.
    pub fn page(&self) -> u32 {
        self.words[header_word::PAGE]
    }

    /// Words of the memory form.
    pub fn memory_words(&self) -> usize {
        self.words[header_word::MEMORY_WORDS] as usize
    }

    /// First word of the material tables in the memory form.
    pub fn memory_tables_word(&self) -> u32 {
        self.tables_word
    }

    /// Unpacks every cluster.
    pub fn clusters(&self) -> Vec<Cluster> {
        (0..self.headers.len())
            .map(|cluster| self.cluster(cluster))
            .collect()
    }

    fn cluster(&self, cluster: usize) -> Cluster {
        let header = &self.headers[cluster];
        let vertices = 0..header.vertex_count();
        let (origin, uv_min, color_min) = (header.origin(), header.uv_min(), header.color_min());
        let when = |flag| {
            if self.attributes().has(flag) {
                vertices.clone()
            } else {
                0..0
            }
        };
        Cluster {
            positions: vertices
                .clone()
                .map(|vertex| {
                    std::array::from_fn(|axis| {
                        origin[axis] + self.offset(cluster, axis, vertex) as i32
                    })
                })
                .collect(),
            normals: when(Attributes::NORMAL)
                .map(|vertex| {
                    std::array::from_fn(|axis| self.offset(cluster, 3 + axis, vertex) as u16)
                })
                .collect(),
            uvs: when(Attributes::UV)
                .map(|vertex| {
                    std::array::from_fn(|axis| {
                        uv_min[axis] + self.offset(cluster, 5 + axis, vertex) as i32
                    })
                })
                .collect(),
            colors: when(Attributes::COLOR)
                .map(|vertex| {
                    std::array::from_fn(|c| {
                        color_min[c] + self.offset(cluster, 7 + c, vertex) as u8
                    })
                })
                .collect(),
            triangles: (0..header.triangle_count())
                .map(|triangle| self.triangle(cluster, triangle))
                .collect(),
            materials: self.materials(cluster).unwrap_or_default(),
            level: header.level() as u8,
            group: header.group(),
            child_group: header.child_group(),
        }
    }
}

fn check_header(header: &ClusterHeader, attributes: Attributes) -> Result<(), FormatError> {
    let triangles = header.triangle_count();
    ensure(
        (1..=128).contains(&triangles),
        "triangles",
        "1..=128",
        triangles,
    )?;
    let vertices = header.vertex_count();
    ensure(
        (1..=256).contains(&vertices),
        "vertices",
        "1..=256",
        vertices,
    )?;
    let counts = triangles | vertices << 8 | header.level() << 17 | header.index_bits() << 24;
    let spare = header.0[cluster_word::COUNTS] & !MATERIAL_TABLE_FLAG;
    ensure(
        spare == counts,
        "spare bits of the counts",
        hex(counts),
        hex(spare),
    )?;
    let index_bits = bits_for(vertices - 1);
    ensure(
        header.index_bits() == index_bits,
        "index bits",
        index_bits,
        header.index_bits(),
    )?;
    for axis in 0..3 {
        let extent = header.extent()[axis];
        ensure(
            extent >> MAX_COORDINATE_BITS == 0,
            "extent",
            "below 2^24 steps",
            extent,
        )?;
        let bits = bits_for(extent);
        ensure(
            header.widths()[axis] == bits,
            "bits of a coordinate",
            bits,
            header.widths()[axis],
        )?;
        let (low, high) = (
            header.origin()[axis] as i64,
            header.origin()[axis] as i64 + extent as i64,
        );
        let inside = low >= -MAX_EXTENT_STEPS && high <= MAX_EXTENT_STEPS;
        ensure(
            inside,
            "position",
            "within 2^23 steps of the centre",
            format!("{low}..={high}"),
        )?;
    }
    for axis in 3..5 {
        let bits = header.widths()[axis];
        let most = if attributes.has(Attributes::UV) {
            MAX_COORDINATE_BITS
        } else {
            0
        };
        ensure(
            bits <= most,
            "bits of a texture coordinate",
            format!("at most {most}"),
            bits,
        )?;
    }
    let most = if attributes.has(Attributes::COLOR) {
        8
    } else {
        0
    };
    let widest = header.color_widths().into_iter().max().unwrap_or(0);
    ensure(
        widest <= most,
        "bits of a colour",
        format!("at most {most}"),
        widest,
    )?;
    for (word, used) in [(cluster_word::WIDTHS, 25), (cluster_word::COLOR_WIDTHS, 16)] {
        ensure(
            header.0[word] >> used == 0,
            "spare bits of the widths",
            0,
            header.0[word] >> used,
        )?;
    }
    Ok(())
}

fn within(error: FormatError, cluster: usize) -> FormatError {
    FormatError {
        at: format!("cluster {cluster}: {}", error.at),
        ..error
    }
}

fn hex(word: u32) -> String {
    format!("{word:#010x}")
}

//! Disk form to checked view: the one place where bytes from outside become trusted. Whatever passes here can be
//! transcoded and drawn without another check.

use super::check::{check_header, hex, within};
use super::encode::words;
use super::predict::{NORMAL, Values, is_normal, value};
use super::shared::referred;
use super::stored::Stored;
use super::topology::{self, Edge, Event};
use super::{DiskForm, FIELDS, HEADER_WORDS, Layout, MAGIC, header_word};
use crate::cluster::Attributes;
use crate::error::{FormatError, ensure};
use crate::limits::{MAX_DISK_FORM_BYTES, MAX_PAGE_CLUSTERS, PAGE_WORDS};
use crate::memory_form::{CLUSTER_HEADER_WORDS, ClusterHeader, PAGE_HEADER_WORDS, cluster_word};

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
            "LSD3",
            hex(header[header_word::MAGIC]),
        )?;
        let attributes = Attributes(header[header_word::ATTRIBUTES]);
        ensure(
            attributes.0 & !Attributes::ALL == 0,
            "disk form attributes",
            "at most 7",
            attributes.0,
        )?;
        let spare = header[header_word::SHARED_VERTICES + 1..]
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
            ensure(range.contains(&value), at, format_args!("{range:?}"), value).map(|()| value)
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
        let extra_bytes = size(
            header_word::EXTRA_BYTES,
            "disk form extra bytes",
            0..=3 * triangle_count,
        )?;
        let shared = size(
            header_word::SHARED_VERTICES,
            "disk form shared vertices",
            0..=vertex_count,
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
            layout.words <= most,
            "staged words",
            format_args!("at most {most}"),
            layout.words,
        )?;
        let stored = Stored::new(
            cluster_count,
            [shared, vertex_count - shared],
            triangle_count,
            extra_bytes,
            &layout.field_bytes,
            table_words,
        );
        ensure(
            stored.bytes == 4 * words.len(),
            "disk form bytes",
            stored.bytes,
            4 * words.len(),
        )?;

        let mut form = Self {
            words: words[..HEADER_WORDS].to_vec(),
            layout,
            headers: Vec::with_capacity(cluster_count),
            spans: Vec::new(),
            tables_word: 0,
        };
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let mut extras = Vec::with_capacity(cluster_count);
        for (cluster, (header, extra)) in stored.read_columns(&bytes).into_iter().enumerate() {
            check_header(&header, attributes).map_err(|error| within(error, cluster))?;
            form.headers.push(header);
            extras.push(extra);
        }
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
        form.stage(attributes, &bytes, &stored, &extras)?;
        for cluster in 0..cluster_count {
            form.check_cluster(cluster, attributes)?;
        }
        Ok(form)
    }

    /// Reads triangles and vertices, and writes the staged form of everything.
    fn stage(
        &mut self,
        attributes: Attributes,
        bytes: &[u8],
        stored: &Stored,
        extras: &[u32],
    ) -> Result<(), FormatError> {
        let layout = self.layout;
        let mut staged = vec![0u8; 4 * layout.words];
        let mut extra = &bytes[stored.extra..][..stored.extra_bytes];
        let mut vertices = Vertices::default();
        for (cluster, &extras) in extras.iter().enumerate() {
            let wrong = |expected: &str, found: &str| {
                within(FormatError::new("triangles", expected, found), cluster)
            };
            let (header, span) = (self.headers[cluster], &self.spans[cluster]);
            let Some((own_extra, rest)) = extra.split_at_checked(extras as usize) else {
                return Err(wrong("as many extra bytes as there are", "more"));
            };
            extra = rest;
            let first_control = stored.control + span.first_triangle as usize;
            let control = &bytes[first_control..][..header.triangle_count() as usize];
            let mut reader = Reader {
                bytes,
                stored,
                layout: &layout,
                headers: &self.headers,
                spans: &self.spans,
                cluster,
                bits: header.field_bits(attributes),
                least: least(&header),
                first_vertex: span.first_vertex as usize,
                vertices: header.vertex_count() as usize,
                read: vertices,
                own: Vec::with_capacity(header.vertex_count() as usize),
                triangles: Vec::with_capacity(control.len()),
                values: Values::new(),
                spare: 0,
            };
            let mut triangle = span.first_triangle as usize;
            let read = topology::decode(control, own_extra, |event| match event {
                Event::Vertex(beyond) => reader.vertex(beyond),
                Event::Shared => reader.shared(&staged),
                Event::Triangle(corners) => {
                    reader.triangles.push(corners);
                    for (corner, index) in corners.into_iter().enumerate() {
                        let plane = layout.index_planes + corner * layout.index_plane_words;
                        staged[4 * plane + triangle] = index;
                    }
                    triangle += 1;
                }
            });
            let (count, used) = read.map_err(|found| wrong("a control byte's meaning", found))?;
            if count != reader.vertices || used != own_extra.len() {
                let found = format!("{count} vertices, {used} extra bytes");
                let expected = format!("{} and {}", reader.vertices, own_extra.len());
                return Err(wrong(&expected, &found));
            }
            if reader.spare != 0 {
                let error = FormatError::new(
                    "vertex differences and references",
                    "within the field's bits, before the cluster",
                    "more",
                );
                return Err(within(error, cluster));
            }
            reader.normals(attributes);
            let extent = reader.stage(&mut staged);
            vertices = reader.read;
            self.headers[cluster].0[cluster_word::EXTENT..][..3].copy_from_slice(&extent);
        }
        ensure(
            vertices.shared == stored.shared && vertices.own == stored.own,
            "shared vertices of all clusters",
            stored.shared,
            vertices.shared,
        )?;
        if !extra.is_empty() {
            let found = format!("{} more", extra.len());
            return Err(FormatError::new(
                "extra bytes",
                "those of the clusters",
                found,
            ));
        }
        let tables = &bytes[stored.tables..];
        staged[4 * layout.tables..].copy_from_slice(tables);
        let header = std::mem::take(&mut self.words);
        self.words = words(&staged);
        self.words[..HEADER_WORDS].copy_from_slice(&header);
        for word in (0..CLUSTER_HEADER_WORDS).filter(|&word| word != cluster_word::PAYLOAD) {
            for (cluster, header) in self.headers.iter().enumerate() {
                self.words[layout.column(word) + cluster] = header.0[word];
            }
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
}

/// Smallest value of each field of a cluster's vertices, which offsets count from.
fn least(header: &ClusterHeader) -> [u32; FIELDS] {
    let [x, y, z] = header.origin().map(|value| value as u32);
    let [u, v] = header.uv_min().map(|value| value as u32);
    let [r, g, b, a] = header.color_min().map(u32::from);
    [x, y, z, 0, 0, u, v, r, g, b, a]
}

/// How many vertices have been read, of either kind, and the last that was referred to.
#[derive(Debug, Clone, Copy, Default)]
struct Vertices {
    own: usize,
    shared: usize,
    last: u16,
}

/// Reads the vertices of a cluster as they come.
struct Reader<'a> {
    bytes: &'a [u8],
    stored: &'a Stored,
    layout: &'a Layout,
    headers: &'a [ClusterHeader],
    spans: &'a [ClusterSpan],
    cluster: usize,
    /// Bits of each field, and its smallest value.
    bits: [u32; FIELDS],
    least: [u32; FIELDS],
    /// First vertex in the staged planes, and how many there are.
    first_vertex: usize,
    vertices: usize,
    read: Vertices,
    /// Vertices whose normals are differences until the triangles are known.
    own: Vec<u8>,
    triangles: Vec<[u8; 3]>,
    values: Values,
    /// Bits of differences that lie above their fields'; references to what is not before the cluster set all.
    spare: u32,
}

impl Reader<'_> {
    fn vertex(&mut self, beyond: Option<Edge>) {
        let vertex = self.values.count;
        // One too many is found when they are counted.
        if vertex < self.vertices && self.read.own < self.stored.own {
            self.own(vertex, beyond);
        }
        self.read.own += 1;
        self.values.count += 1;
    }

    fn own(&mut self, vertex: usize, beyond: Option<Edge>) {
        self.own.push(vertex as u8);
        let mut plane = self.stored.vertex_planes + self.read.own;
        for (field, &field_bytes) in self.layout.field_bytes.iter().enumerate() {
            let mut difference = 0;
            for byte in 0..field_bytes {
                difference |= (self.bytes[plane] as u32) << (8 * byte);
                plane += self.stored.vertex_plane_bytes;
            }
            let bits = self.bits[field];
            self.spare |= difference >> bits;
            if is_normal(field) {
                self.values.fields[field][vertex] = difference;
            } else if bits > 0 {
                let predicted = self.values.predict(field, beyond);
                self.values.fields[field][vertex] = value(difference, predicted, bits);
            }
        }
    }

    /// Turns the normals' differences into normals.
    fn normals(&mut self, attributes: Attributes) {
        if !attributes.has(Attributes::NORMAL) {
            return;
        }
        let expected = self.values.expected_normals(&self.triangles);
        for &vertex in &self.own {
            for axis in 0..2 {
                let own = &mut self.values.fields[NORMAL + axis][vertex as usize];
                let bits = self.bits[NORMAL + axis];
                *own = value(*own, expected[vertex as usize][axis], bits);
            }
        }
    }

    fn shared(&mut self, staged: &[u8]) {
        let vertex = self.values.count;
        if vertex < self.vertices && self.read.shared < self.stored.shared {
            let stored = self.stored.reference(self.bytes, self.read.shared);
            self.read.last = referred(self.read.last, stored);
            match (self.read.last as usize) < self.first_vertex {
                true => self.copy(vertex, staged),
                false => self.spare = u32::MAX,
            }
        }
        self.read.shared += 1;
        self.values.count += 1;
    }

    /// Copies the vertex last referred to, whose offsets count from its own cluster's smallest values.
    fn copy(&mut self, vertex: usize, staged: &[u8]) {
        let number = self.read.last as usize;
        let before = &self.spans[..self.cluster];
        let source = before.partition_point(|span| span.first_vertex as usize <= number) - 1;
        let least = least(&self.headers[source]);
        let mut plane = 4 * self.layout.vertex_planes + number;
        for (field, &field_bytes) in self.layout.field_bytes.iter().enumerate() {
            let mut offset = 0;
            for byte in 0..field_bytes {
                offset |= (staged[plane] as u32) << (8 * byte);
                plane += 4 * self.layout.vertex_plane_words;
            }
            let moved = least[field].wrapping_sub(self.least[field]);
            let offset = offset.wrapping_add(moved);
            self.spare |= offset >> self.bits[field];
            self.values.fields[field][vertex] = offset & ((1 << self.bits[field]) - 1);
        }
    }

    /// Writes the planes; gives the largest offsets of x, y and z.
    fn stage(&self, staged: &mut [u8]) -> [u32; 3] {
        for (field, &field_bytes) in self.layout.field_bytes.iter().enumerate() {
            let own = &self.values.fields[field][..self.vertices];
            for byte in 0..field_bytes {
                let plane = self.layout.field_plane(field) + byte * self.layout.vertex_plane_words;
                let slots = &mut staged[4 * plane + self.first_vertex..][..self.vertices];
                for (slot, value) in slots.iter_mut().zip(own) {
                    *slot = (value >> (8 * byte)) as u8;
                }
            }
        }
        [0, 1, 2].map(|axis| {
            let own = &self.values.fields[axis][..self.vertices];
            own.iter().copied().max().unwrap_or(0)
        })
    }
}

//! Disk form to checked view: the one place where bytes from outside become trusted. Whatever passes here can be
//! transcoded and drawn without another check.

use super::check::{check_header, hex, within};
use super::{DiskForm, HEADER_WORDS, Layout, MAGIC, header_word};
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
}

//! Clusters to disk form.

use super::predict::{NORMAL, Values, difference, is_normal};
use super::shared::{Known, reference};
use super::stored::Stored;
use super::topology::{self, Event, canonical};
use super::{FIELDS, Layout, MAGIC, header_word};
use crate::cluster::{Attributes, Cluster};
use crate::error::FormatError;
use crate::memory_form::{self, ClusterHeader, cluster_word};

/// Writes the disk form of page `page` of an asset; it holds the clusters as [`canonical`] orders them. Fails where
/// [`memory_form::encode`] would.
pub fn encode(
    clusters: &[Cluster],
    attributes: Attributes,
    page: u32,
) -> Result<Vec<u32>, FormatError> {
    clusters
        .iter()
        .try_for_each(|cluster| cluster.check(attributes))?;
    let clusters: Vec<Cluster> = clusters.iter().map(canonical).collect();
    let mut tables = Vec::new();
    let (mut control, mut extra) = (Vec::new(), Vec::new());
    let mut known = Known::default();
    let mut vertices = Vertices::default();
    let headers: Vec<(ClusterHeader, u32)> = clusters
        .iter()
        .map(|cluster| {
            let (mut header, table) = ClusterHeader::of(cluster);
            if header.has_material_table() {
                header.0[cluster_word::MATERIALS] = tables.len() as u32;
                tables.extend(table);
            }
            let known = known.take(cluster);
            let shared: Vec<bool> = known.iter().map(|numbers| !numbers.is_empty()).collect();
            let before = (control.len(), extra.len());
            topology::encode(&cluster.triangles, &shared, &mut control, &mut extra);
            let (control, extra) = (&control[before.0..], &extra[before.1..]);
            vertices.take(cluster, &header, attributes, &known, control, extra);
            (header, extra.len() as u32)
        })
        .collect();
    let all = headers.iter().map(|(header, _)| header);
    let memory_words = memory_form::page_words(all, attributes, tables.len())?;
    let widest = |field: usize| {
        let widths = headers.iter().map(|(header, _)| header.widths()[field]);
        widths.max().unwrap_or(0)
    };
    let plane_widths = (0..5).fold(0, |word, field| {
        word | widest(field).div_ceil(8) << (4 * field)
    });
    let vertex_count = clusters.iter().map(|cluster| cluster.positions.len()).sum();
    let triangle_count = control.len();
    let layout = Layout::new(
        attributes,
        clusters.len(),
        vertex_count,
        triangle_count,
        tables.len(),
        plane_widths,
    );
    let stored = Stored::new(
        clusters.len(),
        [vertices.references.len(), vertices.own],
        triangle_count,
        extra.len(),
        &layout.field_bytes,
        tables.len(),
    );

    let mut bytes = vec![0; stored.bytes];
    let mut put = |word: usize, value: u32| {
        bytes[4 * word..4 * word + 4].copy_from_slice(&value.to_le_bytes());
    };
    put(header_word::MAGIC, MAGIC);
    put(header_word::ATTRIBUTES, attributes.0);
    put(header_word::CLUSTER_COUNT, clusters.len() as u32);
    put(header_word::PAGE, page);
    put(header_word::VERTEX_COUNT, vertex_count as u32);
    put(header_word::TRIANGLE_COUNT, triangle_count as u32);
    put(header_word::TABLE_WORDS, tables.len() as u32);
    put(header_word::MEMORY_WORDS, memory_words as u32);
    put(header_word::PLANE_WIDTHS, plane_widths);
    put(header_word::EXTRA_BYTES, extra.len() as u32);
    put(header_word::SHARED_VERTICES, stored.shared as u32);
    for (word, &value) in tables.iter().enumerate() {
        put(stored.tables / 4 + word, value);
    }
    stored.write_columns(&headers, &mut bytes);
    bytes[stored.control..][..control.len()].copy_from_slice(&control);
    bytes[stored.extra..][..extra.len()].copy_from_slice(&extra);

    stored.write_references(&vertices.references, &mut bytes);
    let mut plane = stored.vertex_planes;
    for (field, &field_bytes) in layout.field_bytes.iter().enumerate() {
        for byte in 0..field_bytes {
            let own = &vertices.differences[field];
            for (slot, value) in bytes[plane..].iter_mut().zip(own) {
                *slot = (value >> (8 * byte)) as u8;
            }
            plane += stored.vertex_plane_bytes;
        }
    }
    Ok(words(&bytes))
}

/// Little-endian words.
pub(super) fn words(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(|&word| u32::from_le_bytes(word)).collect()
}

/// The vertices of a page as they are stored.
#[derive(Debug, Default)]
struct Vertices {
    references: Vec<u16>,
    /// Number of the vertex last referred to.
    last: u16,
    /// Vertices that are not references.
    own: usize,
    /// How far every field of the others is from what is expected of it.
    differences: [Vec<u32>; FIELDS],
}

impl Vertices {
    /// Takes up the vertices of a cluster in the order of its control bytes; `known` has their numbers in clusters before.
    fn take(
        &mut self,
        cluster: &Cluster,
        header: &ClusterHeader,
        attributes: Attributes,
        known: &[Vec<u16>],
        control: &[u8],
        extra: &[u8],
    ) {
        let bits = header.field_bits(attributes);
        let mut values = Values::new();
        let mut own: Vec<usize> = Vec::with_capacity(cluster.positions.len());
        let decoded = topology::decode(control, extra, |event| {
            let vertex = values.count;
            let beyond = match event {
                Event::Triangle(_) => return,
                Event::Vertex(beyond) => {
                    own.push(vertex);
                    Some(beyond)
                }
                Event::Shared => {
                    if let Some((stored, number)) = reference(self.last, &known[vertex]) {
                        self.references.push(stored);
                        self.last = number;
                    }
                    None
                }
            };
            for field in (0..FIELDS).filter(|&field| bits[field] > 0) {
                let value = offset(cluster, header, field, vertex);
                if let (Some(beyond), false) = (beyond, is_normal(field)) {
                    let predicted = values.predict(field, beyond);
                    self.differences[field].push(difference(value, predicted, bits[field]));
                }
                values.fields[field][vertex] = value;
            }
            values.count += 1;
        });
        self.own += own.len();
        if attributes.has(Attributes::NORMAL) {
            let expected = values.expected_normals(&cluster.triangles);
            for axis in 0..2 {
                let field = NORMAL + axis;
                self.differences[field].extend(own.iter().map(|&vertex| {
                    let value = values.fields[field][vertex];
                    difference(value, expected[vertex][axis], bits[field])
                }));
            }
        }
        // What has no bits here may have some in other clusters.
        let all = self.own;
        self.differences
            .iter_mut()
            .for_each(|field| field.resize(all, 0));
        debug_assert!(decoded.is_ok(), "what was just encoded: {decoded:?}");
    }
}

/// Value of a vertex field less the cluster's smallest, in plane order of the fields.
fn offset(cluster: &Cluster, header: &ClusterHeader, field: usize, vertex: usize) -> u32 {
    match field {
        0..=2 => (cluster.positions[vertex][field] - header.origin()[field]) as u32,
        3 | 4 => cluster.normals[vertex][field - 3] as u32,
        5 | 6 => cluster.uvs[vertex][field - 5].wrapping_sub(header.uv_min()[field - 5]) as u32,
        _ => (cluster.colors[vertex][field - 7] - header.color_min()[field - 7]) as u32,
    }
}

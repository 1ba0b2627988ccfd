//! Clusters to disk form.

use super::{COLUMNS, HEADER_WORDS, Layout, MAGIC, header_word};
use crate::cluster::{Attributes, Cluster};
use crate::error::FormatError;
use crate::memory_form::{self, ClusterHeader, cluster_word};

/// Writes the disk form of page `page` of an asset. Fails where [`memory_form::encode`] would.
pub fn encode(
    clusters: &[Cluster],
    attributes: Attributes,
    page: u32,
) -> Result<Vec<u32>, FormatError> {
    let memory_words = memory_form::encode(clusters, attributes, page)?.len();
    let mut tables = Vec::new();
    let headers: Vec<ClusterHeader> = clusters
        .iter()
        .map(|cluster| {
            let (mut header, table) = ClusterHeader::of(cluster);
            if header.has_material_table() {
                header.0[cluster_word::MATERIALS] = tables.len() as u32;
                tables.extend(table);
            }
            header
        })
        .collect();
    let widest = |field: usize| {
        headers
            .iter()
            .map(|header| header.widths()[field])
            .max()
            .unwrap_or(0)
    };
    let plane_widths = (0..5).fold(0, |word, field| {
        word | widest(field).div_ceil(8) << (4 * field)
    });
    let vertex_count = clusters.iter().map(|cluster| cluster.positions.len()).sum();
    let triangle_count = clusters.iter().map(|cluster| cluster.triangles.len()).sum();
    let layout = Layout::new(
        attributes,
        clusters.len(),
        vertex_count,
        triangle_count,
        tables.len(),
        plane_widths,
    );

    let mut words = vec![0; HEADER_WORDS];
    words[header_word::MAGIC] = MAGIC;
    words[header_word::ATTRIBUTES] = attributes.0;
    words[header_word::CLUSTER_COUNT] = clusters.len() as u32;
    words[header_word::PAGE] = page;
    words[header_word::VERTEX_COUNT] = vertex_count as u32;
    words[header_word::TRIANGLE_COUNT] = triangle_count as u32;
    words[header_word::TABLE_WORDS] = tables.len() as u32;
    words[header_word::MEMORY_WORDS] = memory_words as u32;
    words[header_word::PLANE_WIDTHS] = plane_widths;
    words.reserve(layout.words - HEADER_WORDS);
    for word in (0..=COLUMNS).filter(|&word| word != cluster_word::PAYLOAD) {
        words.extend(headers.iter().map(|header| header.0[word]));
    }
    for corner in 0..3 {
        let indices = clusters
            .iter()
            .flat_map(|cluster| &cluster.triangles)
            .map(|triangle| triangle[corner]);
        push_plane(&mut words, indices);
    }
    for (field, &bytes) in layout.field_bytes.iter().enumerate() {
        for byte in 0..bytes {
            let values = clusters.iter().zip(&headers).flat_map(|(cluster, header)| {
                (0..cluster.positions.len())
                    .map(move |vertex| (offset(cluster, header, field, vertex) >> (8 * byte)) as u8)
            });
            push_plane(&mut words, values);
        }
    }
    words.extend(tables);
    debug_assert_eq!(words.len(), layout.words);
    Ok(words)
}

fn push_plane(words: &mut Vec<u32>, bytes: impl Iterator<Item = u8>) {
    let mut lane = 0;
    for byte in bytes {
        if lane == 0 {
            words.push(0);
        }
        if let Some(last) = words.last_mut() {
            *last |= (byte as u32) << (8 * lane);
        }
        lane = (lane + 1) % 4;
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

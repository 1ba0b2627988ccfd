//! Clusters to disk form.

use super::digits::DigitWriter;
use super::order::canonical;
use super::predict::{
    beyond_edge, difference, is_normal, on_octahedron, surface_shift, triangle_normal,
};
use super::ring::Edge;
use super::sources::{MOST_ROUNDS, Parent, Source, Sources, kind};
use super::stored::{Counts, Sections, Stored};
use super::topology::{self, StepWriter};
use super::{FIELDS, Layout, MAGIC, ROUND_SHIFT, header_word};
use crate::cluster::{Attributes, Cluster};
use crate::error::FormatError;
use crate::limits::MAX_CLUSTER_VERTICES;
use crate::memory_form::{self, ClusterHeader, STRIP_WORDS_SHIFT, cluster_word};

/// Writes the disk form of page `page` of an asset; it holds the clusters as [`canonical`] orders them. Those of a group lie
/// beside each other. What `parents` have is not stored again: clusters of earlier pages that the page depends on, whose
/// child group a cluster here is a member of. Fails where [`memory_form::encode`] would.
pub fn encode(
    clusters: &[Cluster],
    attributes: Attributes,
    page: u32,
    parents: &[Parent<'_>],
) -> Result<Vec<u32>, FormatError> {
    clusters
        .iter()
        .try_for_each(|cluster| cluster.check(attributes))?;
    let clusters: Vec<Cluster> = clusters.iter().map(canonical).collect();
    let sources = Sources::new(&clusters, parents);
    let mut writer = Writer::default();
    let mut tables = Vec::new();
    let mut headers: Vec<(ClusterHeader, u32)> = Vec::with_capacity(clusters.len());
    for (number, cluster) in clusters.iter().enumerate() {
        let (mut header, table) = ClusterHeader::of(cluster);
        if header.has_material_table() {
            header.0[cluster_word::MATERIALS] = tables.len() as u32;
            tables.extend(table);
        }
        writer.cluster(
            number,
            cluster,
            &header,
            attributes,
            &sources.vertices[number],
        );
        headers.push((header, 0));
    }
    let all = headers.iter().map(|(header, _)| header);
    let memory_words = memory_form::page_words(all, attributes, tables.len())?;
    let strip_words = headers.iter().map(|(header, _)| header.strip_words()).sum();
    for ((header, _), round) in headers.iter_mut().zip(&sources.rounds) {
        header.0[cluster_word::COUNTS] |= round << ROUND_SHIFT;
        // They follow from the triangles.
        header.0[cluster_word::WIDTHS] &= (1 << STRIP_WORDS_SHIFT) - 1;
    }
    let parents = writer.name_parents(&clusters, &mut headers, parents);

    let plane_widths = super::plane_widths(headers.iter().map(|(header, _)| header));
    let counts = Counts {
        clusters: clusters.len(),
        vertices: clusters.iter().map(|cluster| cluster.positions.len()).sum(),
        triangles: clusters.iter().map(|cluster| cluster.triangles.len()).sum(),
        table_words: tables.len(),
        extra_bytes: writer.extra.len(),
        step_bytes: writer.steps.bytes.len(),
        repeated: writer.repeated[0].len(),
        inherited: writer.inherited[0].len(),
        parents: parents.len(),
        strip_words,
    };
    let layout = Layout::new(attributes, &counts, plane_widths);
    let stored = Stored::new(counts, &layout.field_bytes);
    let mut bytes = vec![0; stored.bytes];
    for (word, value) in [
        (header_word::MAGIC, MAGIC),
        (header_word::ATTRIBUTES, attributes.0),
        (header_word::CLUSTER_COUNT, counts.clusters as u32),
        (header_word::PAGE, page),
        (header_word::VERTEX_COUNT, counts.vertices as u32),
        (header_word::TRIANGLE_COUNT, counts.triangles as u32),
        (header_word::TABLE_WORDS, counts.table_words as u32),
        (header_word::MEMORY_WORDS, memory_words as u32),
        (header_word::PLANE_WIDTHS, plane_widths),
        (header_word::EXTRA_BYTES, counts.extra_bytes as u32),
        (header_word::STEP_BYTES, counts.step_bytes as u32),
        (header_word::REPEATED, counts.repeated as u32),
        (header_word::INHERITED, counts.inherited as u32),
        (header_word::PARENTS, counts.parents as u32),
        (header_word::STRIP_WORDS, counts.strip_words as u32),
        (
            header_word::ROUNDS,
            super::rounds(headers.iter().map(|(header, _)| header)),
        ),
    ] {
        bytes[4 * word..][..4].copy_from_slice(&value.to_le_bytes());
    }
    stored.write_columns(&headers, &mut bytes);
    stored.write_parents(&parents, &mut bytes);
    stored.write(
        &mut bytes,
        Sections {
            steps: &writer.steps.bytes,
            extra: &writer.extra,
            kinds: &writer.kinds.bytes,
            repeated: &writer.repeated,
            inherited: &writer.inherited,
            differences: &writer.differences,
            field_bytes: &layout.field_bytes,
            tables: &tables,
        },
    );
    debug_assert!(sources.rounds.iter().all(|&round| round < MOST_ROUNDS));
    let (words, _) = bytes.as_chunks::<4>();
    Ok(words.iter().map(|&word| u32::from_le_bytes(word)).collect())
}

/// The sections of a page as they grow.
#[derive(Debug, Default)]
struct Writer {
    steps: StepWriter,
    extra: Vec<u8>,
    kinds: DigitWriter<3>,
    /// Cluster low, cluster high, vertex.
    repeated: [Vec<u8>; 3],
    /// Parent, vertex.
    inherited: [Vec<u8>; 2],
    /// How far every field of the own vertices is from what is expected of it.
    differences: [Vec<u32>; FIELDS],
}

impl Writer {
    fn cluster(
        &mut self,
        number: usize,
        cluster: &Cluster,
        header: &ClusterHeader,
        attributes: Attributes,
        sources: &[Source],
    ) {
        let beyond = topology::encode(&cluster.triangles, &mut self.steps, &mut self.extra);
        self.references(number, sources);
        let bits = header.field_bits(attributes);
        let expected = match attributes.has(Attributes::NORMAL) {
            true => expected_normals(cluster, header),
            false => Vec::new(),
        };
        let own = |vertex: &usize| sources[*vertex] == Source::Own;
        for (vertex, beyond) in beyond.into_iter().enumerate() {
            if !own(&vertex) {
                continue;
            }
            for (field, differences) in self.differences.iter_mut().enumerate() {
                let value = |vertex| offset(cluster, header, field, vertex);
                differences.push(match bits[field] {
                    // What has no bits here may have some in other clusters.
                    0 => 0,
                    bits => {
                        let predicted = match is_normal(field) {
                            true => expected[vertex][field - super::field::NORMAL],
                            false => expect(field, beyond, vertex, &value),
                        };
                        difference(value(vertex), predicted, bits)
                    }
                });
            }
        }
    }

    fn references(&mut self, number: usize, sources: &[Source]) {
        let mut last_repeated = (number as u32, 0u8);
        let mut last_inherited = (0u32, 0u8);
        for &source in sources {
            match source {
                Source::Own => self.kinds.push(kind::OWN),
                Source::Repeated { cluster, vertex } => {
                    self.kinds.push(kind::REPEATED);
                    let apart = cluster.wrapping_sub(last_repeated.0) as i16;
                    let [low, high] = (((apart << 1) ^ (apart >> 15)) as u16).to_le_bytes();
                    self.repeated[0].push(low);
                    self.repeated[1].push(high);
                    let same = cluster == last_repeated.0;
                    self.repeated[2].push(step_to(vertex, same.then_some(last_repeated.1)));
                    last_repeated = (cluster, vertex);
                }
                Source::Inherited { parent, vertex } => {
                    self.kinds.push(kind::INHERITED);
                    let apart = parent.wrapping_sub(last_inherited.0) as i8;
                    self.inherited[0].push(((apart << 1) ^ (apart >> 7)) as u8);
                    let same = parent == last_inherited.0;
                    self.inherited[1].push(step_to(vertex, same.then_some(last_inherited.1)));
                    last_inherited = (parent, vertex);
                }
            }
        }
    }

    /// Fills in the number of parents of each cluster's group; gives their pages and clusters, group after group.
    fn name_parents(
        &self,
        clusters: &[Cluster],
        headers: &mut [(ClusterHeader, u32)],
        parents: &[Parent<'_>],
    ) -> Vec<[u32; 2]> {
        let mut named = Vec::new();
        if self.inherited[0].is_empty() {
            return named;
        }
        let mut first = 0;
        for same in clusters.chunk_by(|a, b| a.group == b.group) {
            let own = parents.iter();
            let own = own.filter(|parent| parent.cluster.child_group == same[0].group);
            let before = named.len();
            named.extend(
                own.map(|parent| [parent.page, parent.index])
                    .take(super::sources::MOST_PARENTS),
            );
            let count = (named.len() - before) as u32;
            headers[first..first + same.len()]
                .iter_mut()
                .for_each(|(_, parents)| *parents = count);
            first += same.len();
        }
        named
    }
}

/// A vertex number: how far from the last of the same cluster, or as it is.
fn step_to(vertex: u8, last: Option<u8>) -> u8 {
    match last {
        Some(last) => {
            let apart = vertex.wrapping_sub(last) as i8;
            ((apart << 1) ^ (apart >> 7)) as u8
        }
        None => vertex,
    }
}

fn expect(field: usize, beyond: Option<Edge>, vertex: usize, value: &impl Fn(usize) -> u32) -> u32 {
    match beyond {
        Some(edge) => beyond_edge(field, edge.map(|vertex| value(vertex as usize))),
        None => vertex.checked_sub(1).map_or(0, value),
    }
}

/// What the normal of every vertex is expected to be.
fn expected_normals(cluster: &Cluster, header: &ClusterHeader) -> Vec<[u32; 2]> {
    let [x, y, z, ..] = header.widths();
    let shift = surface_shift([x, y, z]);
    let place = |vertex: u8| {
        let at = |axis| (offset(cluster, header, axis, vertex as usize) >> shift) as i32;
        [at(0), at(1), at(2), 0]
    };
    let mut sums = [[0i32; 3]; MAX_CLUSTER_VERTICES];
    for &triangle in &cluster.triangles {
        let [a, b, c] = triangle.map(place);
        let normal = triangle_normal(&a, &b, &c);
        for vertex in triangle {
            let sum = &mut sums[vertex as usize];
            (0..3).for_each(|axis| sum[axis] = sum[axis].wrapping_add(normal[axis]));
        }
    }
    let own = &sums[..cluster.positions.len()];
    own.iter().map(|&sum| on_octahedron(sum)).collect()
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

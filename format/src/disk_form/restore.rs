//! Restore: a page's memory form from its disk form and its parents' memory forms. The GPU does the same, see the shaders' `restore` and
//! `transcode`; this is their twin, and what programs without a GPU use.
//!
//! Rounds go one after the other, the clusters of a round in order. Vertices are worked on as lanes of a word a field, all fields
//! at once.

use super::check::within;
use super::predict::{beyond_edge, on_octahedron, signed, surface_shift, triangle_normal};
use super::sources::word;
use super::{DiskForm, FIELDS, ROUND_SHIFT, field, round};
use crate::bits::{bits_for, read_bits};
use crate::cluster::Attributes;
use crate::error::{FormatError, ensure};
use crate::limits::{MAX_CLUSTER_VERTICES, MAX_EXTENT_STEPS};
use crate::memory_form::{
    CLUSTER_HEADER_WORDS, ClusterHeader, MAGIC, PAGE_HEADER_WORDS, cluster_word, page_word,
};
use crate::octahedral::NORMAL_BITS;
use crate::strips::Strips;

/// The memory form of a page; `parent` gives those of pages before it, of the same asset. A page that the form names and
/// that is not there, or a cluster or vertex that is not in it, is an error, and so are values that their bits do not suit.
pub fn memory_form<'a>(
    form: &DiskForm,
    parent: impl Fn(u32) -> Option<&'a [u32]>,
) -> Result<Vec<u32>, FormatError> {
    let parents: Vec<ParentView<'a>> = form
        .parents()
        .iter()
        .map(|&[page, cluster]| {
            let at = || {
                FormatError::new(
                    "parent",
                    format!("cluster {cluster} of page {page}"),
                    "none",
                )
            };
            let words = parent(page).ok_or_else(at)?;
            ParentView::new(words, cluster, form.attributes()).ok_or_else(at)
        })
        .collect::<Result<_, _>>()?;
    for &source in form.sources() {
        if source >> word::KIND_SHIFT == word::INHERITED {
            let (parent, vertex) = word::parts(source);
            let vertices = parents[parent].vertices;
            ensure(
                vertex < vertices,
                "inherited vertex",
                format_args!("below {vertices} in parent {parent}"),
                vertex,
            )?;
        }
    }
    // Colours are rare: without them a vertex is two vectors of four words.
    match form.attributes().has(Attributes::COLOR) {
        true => Page::<12>::new(form, &parents).memory_form(),
        false => Page::<8>::new(form, &parents).memory_form(),
    }
}

/// The fields of a vertex, in plane order; zeros after them.
type Lanes<const N: usize> = [u32; N];

/// A cluster of a resident page.
#[derive(Debug, Clone, Copy)]
struct ParentView<'a> {
    records: &'a [u32],
    record_bits: usize,
    /// For each field its bits, and those before it in a record.
    bits: [u32; FIELDS],
    before: [u32; FIELDS],
    least: [u32; FIELDS],
    vertices: usize,
}

impl<'a> ParentView<'a> {
    fn new(page: &'a [u32], cluster: u32, attributes: Attributes) -> Option<Self> {
        if cluster >= *page.get(page_word::CLUSTER_COUNT)? {
            return None;
        }
        let first = PAGE_HEADER_WORDS + cluster as usize * CLUSTER_HEADER_WORDS;
        let words = page.get(first..first + CLUSTER_HEADER_WORDS)?;
        let header = ClusterHeader(words.try_into().ok()?);
        let records = header.0[cluster_word::PAYLOAD] as usize + header.strip_words();
        let bits = header.field_bits(attributes);
        let mut before = [0; FIELDS];
        for field in 1..FIELDS {
            before[field] = before[field - 1] + bits[field - 1];
        }
        Some(Self {
            records: page.get(records..)?,
            record_bits: header.vertex_bits(attributes) as usize,
            bits,
            before,
            least: least(&header),
            vertices: header.vertex_count() as usize,
        })
    }

    /// All fields of a vertex, not less the cluster's smallest.
    #[inline(always)]
    fn vertex<const N: usize>(&self, vertex: usize) -> Lanes<N> {
        let first = vertex * self.record_bits;
        let bytes: &[u8] = bytemuck::cast_slice(self.records);
        // Eight bytes hold a field wherever it begins in the first; a record has 22 at most.
        let window = bytes.get(first / 8..first / 8 + 32);
        std::array::from_fn(|lane| {
            let (Some(&bits), Some(&before)) = (self.bits.get(lane), self.before.get(lane)) else {
                return 0;
            };
            let value = match window {
                Some(window) => {
                    let bit = first % 8 + before as usize;
                    let (eight, _) = window[bit / 8..]
                        .split_first_chunk()
                        .unwrap_or((&[0; 8], &[]));
                    (u64::from_le_bytes(*eight) >> (bit % 8)) as u32 & ((1 << bits) - 1)
                }
                None => read_bits(self.records, first + before as usize, bits),
            };
            value.wrapping_add(self.least[lane])
        })
    }
}

/// Smallest value of each field of a cluster's vertices, which offsets count from.
fn least(header: &ClusterHeader) -> [u32; FIELDS] {
    let [x, y, z] = header.origin().map(|value| value as u32);
    let [u, v] = header.uv_min().map(|value| value as u32);
    let [r, g, b, a] = header.color_min().map(u32::from);
    [x, y, z, 0, 0, u, v, r, g, b, a]
}

fn lanes<const N: usize>(fields: [u32; FIELDS]) -> Lanes<N> {
    std::array::from_fn(|lane| fields.get(lane).copied().unwrap_or(0))
}

/// A page being unpacked.
struct Page<'a, const N: usize> {
    form: &'a DiskForm,
    parents: &'a [ParentView<'a>],
    sources: &'a [u32],
    /// Smallest values of each cluster.
    least: Vec<Lanes<N>>,
    /// Offsets of all vertices, as far as they are known.
    values: Vec<Lanes<N>>,
    /// Signed differences of a cluster's own vertices.
    differences: Vec<Lanes<N>>,
    surface: Surface,
    records: Vec<u8>,
}

impl<'a, const N: usize> Page<'a, N> {
    fn new(form: &'a DiskForm, parents: &'a [ParentView<'a>]) -> Self {
        let layout = form.layout();
        Self {
            form,
            parents,
            sources: form.sources(),
            least: form.headers.iter().map(|it| lanes(least(it))).collect(),
            values: vec![[0; N]; layout.vertex_planes - layout.sources],
            differences: vec![[0; N]; MAX_CLUSTER_VERTICES],
            surface: Surface::default(),
            records: vec![0; MOST_RECORD_BYTES],
        }
    }

    fn memory_form(mut self) -> Result<Vec<u32>, FormatError> {
        let form = self.form;
        let mut order: Vec<u32> = (0..form.headers.len() as u32).collect();
        order.sort_by_key(|&cluster| round(&form.headers[cluster as usize]));
        let mut words = vec![0; form.memory_words()];
        for cluster in order {
            self.restore(cluster as usize);
            self.write(cluster as usize, &mut words)
                .map_err(|error| within(error, cluster as usize))?;
        }
        words[page_word::MAGIC] = MAGIC;
        words[page_word::CLUSTER_COUNT] = form.headers.len() as u32;
        words[page_word::WORDS] = form.memory_words() as u32;
        words[page_word::ATTRIBUTES] = form.attributes().0;
        words[page_word::PAGE] = form.page();
        words[page_word::TABLES] = form.tables_word;
        let tables = &form.words[form.layout.tables..];
        words[form.tables_word as usize..].copy_from_slice(tables);
        Ok(words)
    }

    fn strips(&self, cluster: usize) -> &'a [u32] {
        let first = self.form.layout.strips + self.form.spans[cluster].first_strip as usize;
        &self.form.words[first..][..self.form.headers[cluster].strip_words()]
    }

    /// Works out the vertices of a cluster.
    fn restore(&mut self, cluster: usize) {
        let form = self.form;
        let (header, span) = (&form.headers[cluster], &form.spans[cluster]);
        let bits = header.field_bits(form.attributes());
        let mask = lanes::<N>(bits.map(|bits| (1u32 << bits) - 1));
        let own_least = self.least[cluster];
        let first = span.first_vertex as usize;
        let count = header.vertex_count() as usize;
        let sources = &self.sources[first..first + count];
        let is_own = |source: &&u32| **source >> word::KIND_SHIFT <= word::ANEW;
        let own = sources.iter().filter(is_own).count();
        read_differences(form, span.first_own as usize, &mut self.differences[..own]);
        // Those before this cluster and after it hold what it repeats.
        let (before, rest) = self.values.split_at_mut(first);
        let (values, after) = rest.split_at_mut(count);
        let moved = |from: &Lanes<N>, least: &Lanes<N>| -> Lanes<N> {
            std::array::from_fn(|lane| {
                let absolute = from[lane].wrapping_add(least[lane]);
                absolute.wrapping_sub(own_least[lane]) & mask[lane]
            })
        };
        let mut differences = self.differences.iter();
        for (vertex, &source) in sources.iter().enumerate() {
            values[vertex] = match source >> word::KIND_SHIFT {
                word::REPEATED => {
                    let (other, at) = word::parts(source);
                    let at = form.spans[other].first_vertex as usize + at;
                    let from = match at < first {
                        true => &before[at],
                        false => &after[at - first - count],
                    };
                    moved(from, &self.least[other])
                }
                word::INHERITED => {
                    let (parent, at) = word::parts(source);
                    moved(&self.parents[parent].vertex(at), &[0; N])
                }
                kind => {
                    // As many as own vertices were read.
                    let difference = differences.next().unwrap_or(&[0; N]);
                    let mut expected = match kind {
                        word::BEYOND => {
                            let [a, b, opposite, _] = source.to_le_bytes();
                            let at = |corner: u8| &values[corner as usize];
                            beyond(at(a), at(b), at(opposite))
                        }
                        _ => match vertex {
                            0 => [0; N],
                            _ => values[vertex - 1],
                        },
                    };
                    // Normals stay differences until the surface is known.
                    (expected[field::NORMAL], expected[field::NORMAL + 1]) = (0, 0);
                    std::array::from_fn(|lane| {
                        expected[lane].wrapping_add(difference[lane]) & mask[lane]
                    })
                }
            };
        }
        if own > 0 && form.attributes().has(Attributes::NORMAL) {
            let shift = surface_shift([bits[0], bits[1], bits[2]]);
            let strips = Strips::new(
                self.strips(cluster),
                header.triangle_count(),
                header.index_bits(),
            );
            let values = &mut self.values[first..first + count];
            self.surface
                .normals(values, sources, strips.triangles(), shift);
        }
    }

    /// Writes a cluster's header and payload.
    fn write(&mut self, cluster: usize, words: &mut [u32]) -> Result<(), FormatError> {
        let (mut header, span) = (self.form.headers[cluster], &self.form.spans[cluster]);
        let first = span.first_vertex as usize;
        let values = &self.values[first..first + header.vertex_count() as usize];
        header.0[cluster_word::COUNTS] &= (1 << ROUND_SHIFT) - 1;
        header.0[cluster_word::PAYLOAD] = span.payload_word;
        if header.has_material_table() {
            header.0[cluster_word::MATERIALS] += self.form.tables_word;
        }
        let largest = values.iter().fold([0; N], |largest: Lanes<N>, value| {
            std::array::from_fn(|lane| largest[lane].max(value[lane]))
        });
        header.0[cluster_word::EXTENT..][..3].copy_from_slice(&largest[..3]);
        check_largest(&header, &largest)?;
        let at = PAGE_HEADER_WORDS + cluster * CLUSTER_HEADER_WORDS;
        words[at..at + CLUSTER_HEADER_WORDS].copy_from_slice(&header.0);

        let strips = self.strips(cluster);
        let mut writer = Bits::new(&mut self.records);
        let [x, y, z, nu, nv, u, v, r, g, b, a] = header.field_bits(self.form.attributes());
        for value in values {
            let wide = |lane: usize| value[lane] as u64;
            writer.push(wide(0) | wide(1) << x, x + y);
            writer.push(wide(2) | wide(3) << z | wide(4) << (z + nu), z + nu + nv);
            writer.push(wide(5) | wide(6) << u, u + v);
            if N > 8 {
                let [rg, ba] = [wide(7) | wide(8) << r, wide(9) | wide(10) << b];
                writer.push(rg | ba << (r + g), r + g + b + a);
            }
        }
        writer.align();
        let count = header.payload_words(self.form.attributes());
        let payload = &mut words[span.payload_word as usize..][..count];
        let (own_strips, records) = payload.split_at_mut(strips.len());
        own_strips.copy_from_slice(strips);
        let records: &mut [u8] = bytemuck::cast_slice_mut(records);
        records.copy_from_slice(&self.records[..records.len()]);
        Ok(())
    }
}

/// That positions need their bits and lie where coordinates are exact, and that colours end at full scale.
fn check_largest(header: &ClusterHeader, largest: &[u32]) -> Result<(), FormatError> {
    for (axis, &extent) in largest[..3].iter().enumerate() {
        let (bits, found) = (bits_for(extent), header.widths()[axis]);
        ensure(bits == found, "bits of a coordinate", bits, found)?;
        let high = i64::from(header.origin()[axis]) + i64::from(extent);
        ensure(
            high <= MAX_EXTENT_STEPS,
            "position",
            "within 2^23 steps of the centre",
            high,
        )?;
    }
    for (&low, &extent) in header
        .color_min()
        .iter()
        .zip(largest.iter().skip(field::COLOR))
    {
        let high = u32::from(low) + extent;
        ensure(high <= 255, "colour", "at most 255", high)?;
    }
    Ok(())
}

/// What is expected beyond an edge, in every lane.
#[inline(always)]
fn beyond<const N: usize>(a: &Lanes<N>, b: &Lanes<N>, opposite: &Lanes<N>) -> Lanes<N> {
    std::array::from_fn(|lane| beyond_edge(lane, [a[lane], b[lane], opposite[lane]]))
}

/// Places of a cluster's vertices, and the sums of the normals around them.
#[derive(Debug)]
struct Surface {
    places: [[i32; 4]; MAX_CLUSTER_VERTICES],
    sums: [[i32; 4]; MAX_CLUSTER_VERTICES],
}

impl Default for Surface {
    fn default() -> Self {
        Self {
            places: [[0; 4]; MAX_CLUSTER_VERTICES],
            sums: [[0; 4]; MAX_CLUSTER_VERTICES],
        }
    }
}

impl Surface {
    /// Turns the differences of a cluster's own normals into normals.
    fn normals<const N: usize>(
        &mut self,
        values: &mut [Lanes<N>],
        sources: &[u32],
        triangles: impl Iterator<Item = [u8; 3]>,
        shift: u32,
    ) {
        for (place, value) in self.places.iter_mut().zip(values.iter()) {
            *place = std::array::from_fn(|axis| match axis {
                3 => 0,
                axis => (value[axis] >> shift) as i32,
            });
        }
        self.sums[..values.len()].fill([0; 4]);
        for triangle in triangles {
            let [a, b, c] = triangle.map(|vertex| &self.places[vertex as usize]);
            let normal = triangle_normal(a, b, c);
            for vertex in triangle {
                let sum = &mut self.sums[vertex as usize];
                *sum = std::array::from_fn(|axis| sum[axis].wrapping_add(normal[axis]));
            }
        }
        for ((&source, value), &[x, y, z, _]) in sources.iter().zip(values).zip(&self.sums) {
            if source >> word::KIND_SHIFT > word::ANEW {
                continue;
            }
            for (axis, expected) in on_octahedron([x, y, z]).into_iter().enumerate() {
                let own = &mut value[field::NORMAL + axis];
                *own = own.wrapping_add(expected) & ((1 << NORMAL_BITS) - 1);
            }
        }
    }
}

/// The planes of some own vertices, from the page's number `first` on, as lanes.
fn read_differences<const N: usize>(form: &DiskForm, first: usize, into: &mut [Lanes<N>]) {
    let layout = form.layout();
    let planes: &[u8] = bytemuck::cast_slice(&form.words[layout.vertex_planes..]);
    let (mut next, count) = (first, into.len());
    let mut plane = || {
        let own = &planes[next..][..count];
        next += 4 * layout.vertex_plane_words;
        own
    };
    for (lane, &field_bytes) in layout.field_bytes.iter().enumerate().take(N) {
        match field_bytes {
            0 => into.iter_mut().for_each(|it| it[lane] = 0),
            1 => {
                for (it, &low) in into.iter_mut().zip(plane()) {
                    it[lane] = signed(low as u32);
                }
            }
            2 => {
                let (low, high) = (plane(), plane());
                for ((it, &low), &high) in into.iter_mut().zip(low).zip(high) {
                    it[lane] = signed(u32::from_le_bytes([low, high, 0, 0]));
                }
            }
            _ => {
                let (low, middle, high) = (plane(), plane(), plane());
                let bytes = low.iter().zip(middle).zip(high);
                for (it, ((&low, &middle), &high)) in into.iter_mut().zip(bytes) {
                    it[lane] = signed(u32::from_le_bytes([low, middle, high, 0]));
                }
            }
        }
    }
}

/// Bytes of the most vertex records: five coordinates of 24, two normals of 10, four channels of 8; and the eight that a
/// push may touch.
const MOST_RECORD_BYTES: usize = (5 * 24 + 2 * 10 + 4 * 8) * MAX_CLUSTER_VERTICES / 8 + 16;

/// Writes a bit stream into bytes that are there, eight at a time; what lies after the last bit is garbage until it is aligned.
struct Bits<'a> {
    bytes: &'a mut [u8],
    at: usize,
    /// Fewer than eight bits that are not a byte yet.
    waiting: u64,
    bits: u32,
}

impl<'a> Bits<'a> {
    fn new(bytes: &'a mut [u8]) -> Self {
        Self {
            bytes,
            at: 0,
            waiting: 0,
            bits: 0,
        }
    }

    /// Appends the low `bits` (at most 56) of a value that has no others.
    #[inline(always)]
    fn push(&mut self, value: u64, bits: u32) {
        self.waiting |= value << self.bits;
        if let Some(eight) = self.bytes.get_mut(self.at..self.at + 8) {
            eight.copy_from_slice(&self.waiting.to_le_bytes());
        }
        let bits = self.bits + bits;
        self.at += bits as usize / 8;
        self.waiting >>= bits & !7;
        self.bits = bits & 7;
    }

    /// Fills up to a word with zeros.
    fn align(&mut self) {
        let bits = 8 * self.at as u32 + self.bits;
        self.push(0, bits.next_multiple_of(32) - bits);
    }
}

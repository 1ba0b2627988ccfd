//! Disk form to checked view: the one place where bytes from outside become trusted. Whatever passes here can be
//! transcoded and drawn without another check, whatever its parents hold.

use super::check::{check_header, hex, within};
use super::digits::Digits;
use super::sources::{MOST_PARENTS, kind, word};
use super::stored::{Counts, Stored, unfolded};
use super::topology::{Steps, Triangles};
use super::{DiskForm, HEADER_WORDS, Layout, MAGIC, header_word, plane_widths, round, rounds};
use crate::cluster::Attributes;
use crate::error::{FormatError, ensure};
use crate::limits::{MAX_DISK_FORM_BYTES, MAX_PAGE_CLUSTERS};
use crate::memory_form::{
    CLUSTER_HEADER_WORDS, PAGE_HEADER_WORDS, STRIP_WORDS_SHIFT, cluster_word,
};
use crate::strips::{self, MOST_WORDS};

/// Where one cluster's data begins in either form; follows from the headers before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ClusterSpan {
    /// First vertex of the page's.
    pub first_vertex: u32,
    /// First of its words in the strips.
    pub first_strip: u32,
    /// First payload word in the memory form, from the start of the page.
    pub payload_word: u32,
    /// First of its own vertices in the vertex planes.
    pub first_own: u32,
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
            "LSD5",
            hex(header[header_word::MAGIC]),
        )?;
        let attributes = Attributes(header[header_word::ATTRIBUTES]);
        ensure(
            attributes.0 & !Attributes::ALL == 0,
            "disk form attributes",
            "at most 7",
            attributes.0,
        )?;
        let counts = Counts::read(header)?;
        let widths = header[header_word::PLANE_WIDTHS];
        let layout = Layout::new(attributes, &counts, widths);
        ensure(
            layout.words <= most,
            "staged words",
            format_args!("at most {most}"),
            layout.words,
        )?;
        let stored = Stored::new(counts, &layout.field_bytes);
        ensure(
            stored.bytes == 4 * words.len(),
            "disk form bytes",
            stored.bytes,
            4 * words.len(),
        )?;

        let bytes: &[u8] = bytemuck::cast_slice(&words);
        let mut form = Self {
            words: vec![0; layout.words],
            layout,
            headers: Vec::with_capacity(counts.clusters),
            spans: Vec::with_capacity(counts.clusters),
            parents: stored.read_parents(bytes),
            tables_word: 0,
        };
        form.words[..HEADER_WORDS].copy_from_slice(header);
        let mut parents = Vec::with_capacity(counts.clusters);
        for (cluster, (header, count)) in stored.read_columns(bytes).into_iter().enumerate() {
            check_header(&header, attributes).map_err(|error| within(error, cluster))?;
            form.headers.push(header);
            parents.push(count);
        }
        for (at, word, expected) in [
            (
                "disk form plane widths",
                header_word::PLANE_WIDTHS,
                plane_widths(form.headers.iter()),
            ),
            (
                "disk form rounds",
                header_word::ROUNDS,
                rounds(form.headers.iter()),
            ),
        ] {
            ensure(
                header[word] == expected,
                at,
                hex(expected),
                hex(header[word]),
            )?;
        }
        form.place(&counts)?;
        form.check_parents(&parents)?;
        stored.stage_planes(bytes, &layout, bytemuck::cast_slice_mut(&mut form.words));
        form.unpack(&stored, bytes, &counts, &parents)?;
        form.place_payloads(attributes, &counts)?;
        form.check_repeated()?;
        for word in (0..cluster_word::EXTENT).filter(|&word| word != cluster_word::PAYLOAD) {
            let column = form.layout.column(word);
            for (cluster, header) in form.headers.iter().enumerate() {
                form.words[column + cluster] = header.0[word];
            }
        }
        for cluster in 0..counts.clusters {
            form.check_cluster(cluster, attributes)?;
        }
        Ok(form)
    }

    fn place(&mut self, counts: &Counts) -> Result<(), FormatError> {
        let (mut vertex, mut triangle) = (0, 0);
        for header in &self.headers {
            self.spans.push(ClusterSpan {
                first_vertex: vertex as u32,
                first_strip: 0,
                payload_word: 0,
                first_own: 0,
            });
            vertex += header.vertex_count() as usize;
            triangle += header.triangle_count() as usize;
        }
        for (at, expected, found) in [
            ("vertices of all clusters", counts.vertices, vertex),
            ("triangles of all clusters", counts.triangles, triangle),
        ] {
            ensure(expected == found, at, expected, found)?;
        }
        Ok(())
    }

    /// Where the memory form has what; the words of the strips are known.
    fn place_payloads(
        &mut self,
        attributes: Attributes,
        counts: &Counts,
    ) -> Result<(), FormatError> {
        let mut payload = PAGE_HEADER_WORDS + CLUSTER_HEADER_WORDS * self.layout.cluster_count;
        for (header, span) in self.headers.iter().zip(&mut self.spans) {
            span.payload_word = payload as u32;
            payload += header.payload_words(attributes);
        }
        self.tables_word = payload as u32;
        let total = payload + counts.table_words;
        ensure(
            total == self.memory_words(),
            "memory form words",
            total,
            self.memory_words(),
        )?;
        ensure(
            total <= crate::limits::PAGE_WORDS,
            "memory form words",
            format_args!("at most {}", crate::limits::PAGE_WORDS),
            total,
        )
    }

    /// Parents lie group after group, in pages before this one.
    fn check_parents(&self, counts: &[u32]) -> Result<(), FormatError> {
        let mut named = 0usize;
        for (cluster, header) in self.headers.iter().enumerate() {
            let before = cluster.checked_sub(1);
            let same = before.filter(|&before| self.headers[before].group() == header.group());
            match same {
                Some(before) => ensure(
                    counts[before] == counts[cluster],
                    "parents of clusters of one group",
                    counts[before],
                    counts[cluster],
                )?,
                None => {
                    let count = counts[cluster] as usize;
                    ensure(
                        count <= MOST_PARENTS,
                        "parents of a group",
                        "at most 256",
                        count,
                    )?;
                    named += count;
                }
            }
        }
        ensure(
            named == self.parents.len(),
            "parents of all groups",
            self.parents.len(),
            named,
        )?;
        for &[page, cluster] in &self.parents {
            ensure(
                page < self.page() && (cluster as usize) < MAX_PAGE_CLUSTERS,
                "parent",
                format_args!(
                    "a cluster below {MAX_PAGE_CLUSTERS} of a page before {}",
                    self.page()
                ),
                format_args!("cluster {cluster} of page {page}"),
            )?;
        }
        Ok(())
    }

    /// Reads triangles, and where vertices come from.
    fn unpack(
        &mut self,
        stored: &Stored,
        bytes: &[u8],
        counts: &Counts,
        parents: &[u32],
    ) -> Result<(), FormatError> {
        let layout = self.layout;
        let (before, sources) = self.words.split_at_mut(layout.sources);
        let all_strips = &mut before[layout.strips..];
        let mut strip_words = 0;
        let mut strips = Vec::with_capacity(MOST_WORDS);
        let wrong = |found: &str| {
            FormatError::new(
                "triangles of all clusters",
                "steps, extra bytes and kinds for them",
                found,
            )
        };
        let digits = (
            Digits::new::<5>(stored.steps(bytes)),
            Digits::new::<3>(stored.kinds(bytes)),
        );
        let (Some(steps), Some(kinds)) = digits else {
            return Err(wrong("a byte of digits that is too large"));
        };
        let mut steps = Steps {
            digits: steps,
            extra: stored.extra(bytes).iter(),
            wrong: None,
        };
        let mut reader = Reader {
            kinds,
            repeated: stored.repeated(bytes),
            inherited: stored.inherited(bytes),
            own: 0,
            at: [0; 2],
            last_repeated: (0, 0),
            parents: 0..0,
            last_inherited: (0, 0),
            wrong: None,
        };
        let mut triangles = Triangles::default();
        let mut group = None;
        for (cluster, header) in self.headers.iter_mut().enumerate() {
            let span = &mut self.spans[cluster];
            span.first_own = reader.own as u32;
            let same = group.replace(header.group()) == Some(header.group());
            let first = if same {
                reader.parents.start
            } else {
                reader.parents.end
            };
            reader.begin(cluster as u32, first..first + parents[cluster]);
            let count = header.triangle_count() as usize;
            let found = steps.read(count, &mut triangles);
            let wrong = |expected: String, found: String| {
                within(FormatError::new("triangles", expected, found), cluster)
            };
            if let Some(found) = steps.wrong {
                return Err(wrong("steps that mean something".into(), found.into()));
            }
            let vertices = header.vertex_count() as usize;
            if found != vertices {
                return Err(wrong(format!("{vertices} vertices"), format!("{found}")));
            }
            strips.clear();
            strips::encode(triangles.first(count), header.index_bits(), &mut strips);
            header.0[cluster_word::WIDTHS] |= (strips.len() as u32) << STRIP_WORDS_SHIFT;
            span.first_strip = strip_words as u32;
            let Some(own) = all_strips.get_mut(strip_words..strip_words + strips.len()) else {
                return Err(wrong(
                    format!("strips of {} words", counts.strip_words),
                    "more".into(),
                ));
            };
            own.copy_from_slice(&strips);
            strip_words += strips.len();
            let own = &mut sources[span.first_vertex as usize..][..vertices];
            reader.read(&triangles.beyond[..vertices], own);
            if let Some(found) = reader.wrong {
                return Err(wrong("vertices that are there".into(), found.into()));
            }
        }
        let left = steps.digits.finish().and(reader.kinds.finish());
        left.map_err(wrong)?;
        if steps.extra.len() > 0 {
            return Err(wrong("more extra bytes"));
        }
        for (at, expected, found) in [
            ("repeated vertices", counts.repeated, reader.at[0]),
            ("inherited vertices", counts.inherited, reader.at[1]),
            ("words of all strips", counts.strip_words, strip_words),
        ] {
            ensure(expected == found, at, expected, found)?;
        }
        Ok(())
    }

    /// What is repeated lies in a cluster of an earlier round, and is not itself repeated.
    fn check_repeated(&self) -> Result<(), FormatError> {
        let sources = &self.words[self.layout.sources..];
        for (cluster, (header, span)) in self.headers.iter().zip(&self.spans).enumerate() {
            let own = &sources[span.first_vertex as usize..][..header.vertex_count() as usize];
            for &source in own
                .iter()
                .filter(|&&it| it >> word::KIND_SHIFT == word::REPEATED)
            {
                let (other, vertex) = word::parts(source);
                let target = self.headers.get(other).is_some_and(|target| {
                    let first = self.spans[other].first_vertex as usize;
                    round(target) < round(header)
                        && (vertex as u32) < target.vertex_count()
                        && sources[first + vertex] >> word::KIND_SHIFT != word::REPEATED
                });
                let expected = "a vertex of an earlier round that is not repeated itself";
                ensure(
                    target,
                    "repeated vertex",
                    expected,
                    format_args!("vertex {vertex} of cluster {other}"),
                )
                .map_err(|error| within(error, cluster))?;
            }
        }
        Ok(())
    }
}

/// Reads where vertices come from.
struct Reader<'a> {
    kinds: Digits,
    repeated: [&'a [u8]; 3],
    inherited: [&'a [u8]; 2],
    own: usize,
    /// How many have been read of the other two.
    at: [usize; 2],
    /// Cluster and vertex.
    last_repeated: (u32, u8),
    /// Those of the group.
    parents: std::ops::Range<u32>,
    last_inherited: (u32, u8),
    wrong: Option<&'static str>,
}

impl Reader<'_> {
    fn begin(&mut self, cluster: u32, parents: std::ops::Range<u32>) {
        self.last_repeated = (cluster, 0);
        self.parents = parents;
        self.last_inherited = (0, 0);
    }

    /// A cluster's vertices; own ones lie `beyond` what the triangles say.
    fn read(&mut self, beyond: &[u32], into: &mut [u32]) {
        for (&beyond, source) in beyond.iter().zip(into) {
            *source = match self.kinds.next() {
                kind::OWN => {
                    self.own += 1;
                    beyond
                }
                kind::REPEATED => self.repeat(),
                _ => self.inherit(),
            };
        }
    }

    #[cold]
    fn refuse(&mut self, found: &'static str) -> u32 {
        self.wrong.get_or_insert(found);
        0
    }

    #[inline(always)]
    fn repeat(&mut self) -> u32 {
        let [low, high, vertex] = self.repeated;
        let at = self.at[0];
        let (Some(&low), Some(&high), Some(&vertex)) = (low.get(at), high.get(at), vertex.get(at))
        else {
            return self.refuse("more repeated vertices than there are");
        };
        self.at[0] += 1;
        let (last_cluster, last_vertex) = self.last_repeated;
        let apart = unfolded(u32::from_le_bytes([low, high, 0, 0]));
        let cluster = last_cluster.wrapping_add(apart) & 0xffff;
        let vertex = step_from(vertex, (cluster == last_cluster).then_some(last_vertex));
        self.last_repeated = (cluster, vertex);
        word::of(word::REPEATED, cluster, vertex)
    }

    #[inline(always)]
    fn inherit(&mut self) -> u32 {
        let [parent, vertex] = self.inherited;
        let at = self.at[1];
        let (Some(&parent), Some(&vertex)) = (parent.get(at), vertex.get(at)) else {
            return self.refuse("more inherited vertices than there are");
        };
        self.at[1] += 1;
        let (last_parent, last_vertex) = self.last_inherited;
        let parent = last_parent.wrapping_add(unfolded(parent as u32)) & 0xff;
        if parent >= self.parents.end - self.parents.start {
            return self.refuse("an inherited vertex of no parent");
        }
        let vertex = step_from(vertex, (parent == last_parent).then_some(last_vertex));
        self.last_inherited = (parent, vertex);
        word::of(word::INHERITED, self.parents.start + parent, vertex)
    }
}

/// The vertex number that a byte stands for.
#[inline(always)]
fn step_from(byte: u8, last: Option<u8>) -> u8 {
    match last {
        Some(last) => last.wrapping_add(unfolded(byte as u32) as u8),
        None => byte,
    }
}

//! Sources: each vertex is stored once. One that a cluster of an earlier round of the page has, in all its fields, is repeated; one that a
//! parent has (a cluster that the group was simplified to, in a page that this one depends on) is inherited; the others are the
//! cluster's own.
//!
//! Rounds say in which order clusters can be unpacked: what is repeated lies in a cluster of an earlier one, so that all clusters of
//! a round can be unpacked at once. Neighbours get different rounds, the first that is free; a few do for any page.

use crate::cluster::Cluster;

/// Rounds of a page at most; four bits of a cluster's counts.
pub(super) const MOST_ROUNDS: u32 = 16;
/// Parents of a group that can be inherited from: an index of one byte.
pub(super) const MOST_PARENTS: usize = 256;

/// Where a vertex's values come from, as it is staged: two bits that say which, and who.
pub mod word {
    /// Own, beyond an edge: its ends and opposite corner, a byte each.
    pub const BEYOND: u32 = 0;
    /// Own, at a beginning.
    pub const ANEW: u32 = 1;
    /// Of another cluster of the page: vertex, and cluster from bit 8.
    pub const REPEATED: u32 = 2;
    /// Of a parent: vertex, and parent of the page from bit 8.
    pub const INHERITED: u32 = 3;
    /// First bit of the kind.
    pub const KIND_SHIFT: u32 = 30;

    /// Vertex `vertex` of cluster or parent `of`.
    pub(in super::super) fn of(kind: u32, of: u32, vertex: u8) -> u32 {
        kind << KIND_SHIFT | of << 8 | vertex as u32
    }

    /// Cluster or parent, and vertex.
    #[inline]
    pub(in super::super) fn parts(word: u32) -> (usize, usize) {
        ((word >> 8 & 0x3f_ffff) as usize, (word & 0xff) as usize)
    }
}

/// Digits that say which of three a vertex is.
pub(super) mod kind {
    pub const OWN: u8 = 0;
    pub const REPEATED: u8 = 1;
    pub const INHERITED: u8 = 2;
}

/// A cluster that others were simplified to, and where it lies.
#[derive(Debug, Clone, Copy)]
pub struct Parent<'a> {
    /// Page of the asset.
    pub page: u32,
    /// Cluster of that page.
    pub index: u32,
    /// As its page has it: in [`super::canonical`] order.
    pub cluster: &'a Cluster,
}

/// Where a vertex comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    Own,
    Repeated {
        cluster: u32,
        vertex: u8,
    },
    /// `parent` counts from the first of its group.
    Inherited {
        parent: u32,
        vertex: u8,
    },
}

/// What is known of a page before it is written.
#[derive(Debug)]
pub(super) struct Sources {
    /// A round a cluster.
    pub rounds: Vec<u32>,
    /// For each cluster its vertices.
    pub vertices: Vec<Vec<Source>>,
}

/// All fields of a vertex.
type Key = ([i32; 3], [u16; 2], [i32; 2], [u8; 4]);

fn key(cluster: &Cluster, vertex: usize) -> Key {
    (
        cluster.positions[vertex],
        cluster.normals.get(vertex).copied().unwrap_or_default(),
        cluster.uvs.get(vertex).copied().unwrap_or_default(),
        cluster.colors.get(vertex).copied().unwrap_or_default(),
    )
}

/// A number that keys which differ seldom have in common: where they do, vertices are stored twice.
fn hash(&([x, y, z], normal, [u, v], color): &Key) -> u64 {
    // The golden ratio of 2^64 (Knuth, "The Art of Computer Programming", volume 3, 6.4).
    const FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;
    let pair = |low: u32, high: u32| low as u64 | (high as u64) << 32;
    let normal = normal[0] as u32 | (normal[1] as u32) << 16;
    let words = [
        pair(x as u32, y as u32),
        pair(z as u32, normal),
        pair(u as u32, v as u32),
        u32::from_le_bytes(color) as u64,
    ];
    words.iter().fold(FACTOR, |hash, word| {
        let mixed = (hash ^ word).wrapping_mul(FACTOR);
        mixed ^ mixed >> 32
    })
}

/// A vertex by the hash of its fields, and whose it is.
type Entry = (u64, u32, u8);

/// Vertices of `clusters`, those with equal fields beside each other.
fn sorted<'a>(clusters: impl IntoIterator<Item = &'a Cluster>) -> Vec<Entry> {
    let mut entries = Vec::new();
    for (number, cluster) in (0..).zip(clusters) {
        let vertices = 0..cluster.positions.len();
        entries.extend(vertices.map(|vertex| {
            let hash = hash(&key(cluster, vertex));
            (hash, number, vertex as u8)
        }));
    }
    entries.sort_unstable();
    entries
}

impl Sources {
    /// Finds them; `parents` of a cluster are those whose child group is its group.
    pub fn new(clusters: &[Cluster], parents: &[Parent<'_>]) -> Self {
        let equal = Equal::new(clusters);
        let rounds = equal.rounds(clusters.len());
        let of = |cluster: &Cluster| vec![Source::Own; cluster.positions.len()];
        let mut sources = Self {
            vertices: clusters.iter().map(of).collect(),
            rounds,
        };
        sources.repeat(&equal);
        sources.inherit(clusters, parents);
        sources
    }

    fn repeat(&mut self, equal: &Equal) {
        for run in equal.runs() {
            let round = |entry: &&Entry| (self.rounds[entry.1 as usize], entry.1);
            let Some(&(_, cluster, vertex)) = run.iter().min_by_key(round) else {
                continue;
            };
            let first = self.rounds[cluster as usize];
            for &(_, other, at) in run {
                if self.rounds[other as usize] > first {
                    let source = Source::Repeated { cluster, vertex };
                    self.vertices[other as usize][at as usize] = source;
                }
            }
        }
    }

    /// What a parent has is inherited, also where it could be repeated; what repeats it stays.
    fn inherit(&mut self, clusters: &[Cluster], parents: &[Parent<'_>]) {
        let mut first = 0;
        for same in clusters.chunk_by(|a, b| a.group == b.group) {
            let range = first..first + same.len();
            first = range.end;
            let own = parents
                .iter()
                .filter(|parent| parent.cluster.child_group == same[0].group);
            let own: Vec<&Cluster> = own
                .map(|parent| parent.cluster)
                .take(MOST_PARENTS)
                .collect();
            let entries = sorted(own.iter().copied());
            for (cluster, sources) in same.iter().zip(&mut self.vertices[range]) {
                inherit(cluster, sources, &own, &entries);
            }
        }
    }
}

/// Takes what a cluster's parents have from them, each vertex from the parent of the one before where it can.
fn inherit(cluster: &Cluster, sources: &mut [Source], parents: &[&Cluster], entries: &[Entry]) {
    let (mut last_parent, mut last_vertex) = (0, 0u8);
    for (vertex, source) in sources.iter_mut().enumerate() {
        let key = key(cluster, vertex);
        let hash = hash(&key);
        let start = entries.partition_point(|entry| entry.0 < hash);
        let same = entries[start..].iter().take_while(|entry| entry.0 == hash);
        let same =
            same.filter(|entry| key == self::key(parents[entry.1 as usize], entry.2 as usize));
        let nearest = same.min_by_key(|&&(_, parent, vertex)| {
            (parent != last_parent, parent, vertex.abs_diff(last_vertex))
        });
        if let Some(&(_, parent, vertex)) = nearest {
            (last_parent, last_vertex) = (parent, vertex);
            *source = Source::Inherited { parent, vertex };
        }
    }
}

/// Vertices of a page, those with equal fields beside each other.
struct Equal<'a> {
    clusters: &'a [Cluster],
    entries: Vec<Entry>,
}

impl<'a> Equal<'a> {
    fn new(clusters: &'a [Cluster]) -> Self {
        Self {
            entries: sorted(clusters),
            clusters,
        }
    }

    /// Runs of vertices that are equal, two at least.
    fn runs(&self) -> impl Iterator<Item = &[Entry]> {
        let key = |entry: &Entry| key(&self.clusters[entry.1 as usize], entry.2 as usize);
        self.entries
            .chunk_by(|a, b| a.0 == b.0)
            // Different ones with one hash are left alone.
            .filter(move |run| run.len() > 1 && run.iter().all(|entry| key(entry) == key(&run[0])))
    }

    /// Different rounds for clusters that have a vertex in common, as far as rounds go.
    fn rounds(&self, clusters: usize) -> Vec<u32> {
        let mut neighbours = vec![Vec::new(); clusters];
        for run in self.runs() {
            for (_, one, _) in run {
                let others = run.iter().map(|entry| entry.1);
                neighbours[*one as usize].extend(others.filter(|other| other < one));
            }
        }
        let mut rounds = Vec::with_capacity(clusters);
        for earlier in neighbours {
            let taken = earlier
                .iter()
                .fold(0u32, |taken, &other| taken | 1u32 << rounds[other as usize]);
            rounds.push(taken.trailing_ones().min(MOST_ROUNDS - 1));
        }
        rounds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(positions: &[i32]) -> Cluster {
        Cluster {
            positions: positions.iter().map(|&x| [x, 0, 0]).collect(),
            normals: positions.iter().map(|_| [7, 8]).collect(),
            ..Cluster::default()
        }
    }

    #[test]
    fn a_vertex_is_known_only_where_every_field_is_the_same() {
        let mut other = points(&[2, 1]);
        other.normals[0] = [7, 9];
        let sources = Sources::new(&[points(&[1, 2]), other], &[]);
        assert_eq!(sources.rounds, [0, 1]);
        assert_eq!(sources.vertices[0], [Source::Own; 2]);
        let repeated = Source::Repeated {
            cluster: 0,
            vertex: 0,
        };
        assert_eq!(sources.vertices[1], [Source::Own, repeated]);
    }

    #[test]
    fn what_is_repeated_lies_in_an_earlier_round_and_is_no_repetition() {
        let clusters: Vec<Cluster> = (0..40)
            .map(|seed| points(&[seed % 5, seed % 7, seed % 3, seed, seed / 2]))
            .collect();
        let sources = Sources::new(&clusters, &[]);
        let mut repeated = 0;
        for (at, vertices) in sources.vertices.iter().enumerate() {
            for source in vertices {
                if let Source::Repeated { cluster, vertex } = *source {
                    let target = sources.vertices[cluster as usize][vertex as usize];
                    assert_eq!(target, Source::Own);
                    assert!(sources.rounds[cluster as usize] < sources.rounds[at]);
                    repeated += 1;
                }
            }
        }
        assert!(repeated > 50, "{repeated}");
    }

    #[test]
    fn a_group_inherits_from_its_own_parents_only() {
        let mut clusters = [points(&[1, 2]), points(&[1, 3])];
        clusters[1].group = 1;
        let mut parents = [points(&[9, 1]), points(&[3])];
        parents[1].child_group = 1;
        let parents: Vec<Parent<'_>> = (0..)
            .zip(&parents)
            .map(|(index, cluster)| Parent {
                page: 0,
                index,
                cluster,
            })
            .collect();
        let sources = Sources::new(&clusters, &parents);
        let inherited = |vertex| Source::Inherited { parent: 0, vertex };
        assert_eq!(sources.vertices[0], [inherited(1), Source::Own]);
        let repeated = Source::Repeated {
            cluster: 0,
            vertex: 0,
        };
        assert_eq!(sources.vertices[1], [repeated, inherited(0)]);
    }
}

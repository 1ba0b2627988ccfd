//! Triangles of a cluster in memory form: strips, any triangle of which can be read without those before it (after Karis et al., "A
//! deep dive into Nanite virtualized geometry", SIGGRAPH 2021, where a strip's masks are counted in the same way).
//!
//! ```text
//! for each 32 triangles three masks: NEW, RESTART, TURN | word boundary | listed vertices (index bits each) | word boundary
//! ```
//!
//! A triangle begins with an edge of the one before it, `[from, to, third]`: with `[third, to]`, or, where TURN is set, with `[from, third]`.
//! Its own third corner is the next vertex that no triangle had where NEW is set, else it is listed. RESTART: nothing is taken from the triangle before; the
//! first two corners are listed as well, or, where TURN is set, the last two are next vertices, and with NEW all three are.
//!
//! What comes before a triangle is counted in the masks: next vertices, one for each NEW and two for each RESTART with TURN; listed ones,
//! one for each that is not NEW and two for each RESTART without TURN.

use crate::bits::read_bits;

/// Masks of 32 triangles, in order.
pub mod mask {
    /// The third corner is the next vertex.
    pub const NEW: usize = 0;
    /// The triangle takes nothing from the one before.
    pub const RESTART: usize = 1;
    /// Which edge it takes; of a restart, whether it has next vertices besides the third.
    pub const TURN: usize = 2;
    /// Masks.
    pub const COUNT: usize = 3;
}

/// Words of the largest cluster: masks of 128 triangles, and three listed vertices of eight bits for each.
pub const MOST_WORDS: usize = 4 * mask::COUNT + 3 * 128 * 8 / 32;

/// Appends the words of triangles; any will do, those in the order of [`crate::disk_form::canonical`] become few.
pub fn encode(
    triangles: impl ExactSizeIterator<Item = [u8; 3]>,
    index_bits: u32,
    words: &mut Vec<u32>,
) {
    let count = triangles.len();
    let masks = words.len();
    words.resize(masks + mask::COUNT * count.div_ceil(32), 0);
    // Listed vertices that do not fill a word yet.
    let (mut waiting, mut waiting_bits) = (0u64, 0);
    let mut next = 0u32;
    // Of the triangle before; no number at first.
    let [mut last_from, mut last_to, mut last_third] = [u32::MAX; 3];
    let mut block = [0u32; mask::COUNT];
    for (number, triangle) in triangles.enumerate() {
        let [from, to, third] = triangle.map(u32::from);
        let straight = from == last_third && to == last_to;
        let turned = !straight && from == last_from && to == last_third;
        let mut is_new = third == next;
        let mut turns = turned;
        // Strips first, since a branch less is what their speed comes from.
        let mut list = third as u64;
        let mut listed = u32::from(!is_new);
        let restarts = !(straight || turned);
        if restarts {
            if third == to + 1 && to == next {
                (turns, is_new, list, listed) = (true, false, from as u64, 1);
            } else if from == next && to == next + 1 && third == next + 2 {
                (turns, is_new, listed) = (true, true, 0);
            } else {
                listed += 2;
                list = from as u64 | (to as u64) << index_bits | list << (2 * index_bits);
            }
        }
        let list_bits = listed * index_bits;
        waiting |= (list & ((1 << list_bits) - 1)) << waiting_bits;
        waiting_bits += list_bits;
        if waiting_bits >= 32 {
            words.push(waiting as u32);
            waiting >>= 32;
            waiting_bits -= 32;
        }
        next += u32::from(is_new) + 2 * u32::from(restarts && turns);
        [last_from, last_to, last_third] = [from, to, third];
        for (mask, is_set) in [
            (mask::NEW, is_new),
            (mask::RESTART, restarts),
            (mask::TURN, turns),
        ] {
            block[mask] |= u32::from(is_set) << (number % 32);
        }
        if number % 32 == 31 || number + 1 == count {
            words[masks + mask::COUNT * (number / 32)..][..mask::COUNT].copy_from_slice(&block);
            block = [0; mask::COUNT];
        }
    }
    if waiting_bits > 0 {
        words.push(waiting as u32);
    }
}

/// Random access into words that [`encode`] wrote. What is past them reads as zeros.
#[derive(Debug, Clone, Copy)]
pub struct Strips<'a> {
    words: &'a [u32],
    listed: &'a [u32],
    triangle_count: u32,
    index_bits: u32,
}

/// What the triangles before one have used up.
#[derive(Debug, Clone, Copy, Default)]
struct Used {
    vertices: u32,
    listed: u32,
}

impl<'a> Strips<'a> {
    /// Words of a cluster with so many triangles, whose vertex numbers have so many bits.
    pub fn new(words: &'a [u32], triangle_count: u32, index_bits: u32) -> Self {
        let masks = mask::COUNT * triangle_count.div_ceil(32) as usize;
        Self {
            words,
            listed: words.get(masks..).unwrap_or(&[]),
            triangle_count,
            index_bits,
        }
    }

    fn mask(&self, block: u32, mask: usize) -> u32 {
        self.words
            .get(mask::COUNT * block as usize + mask)
            .copied()
            .unwrap_or(0)
    }

    fn has(&self, triangle: u32, mask: usize) -> bool {
        self.mask(triangle / 32, mask) >> (triangle % 32) & 1 == 1
    }

    fn used_before(&self, triangle: u32) -> Used {
        let (mut new, mut with_two, mut restarts) = (0, 0, 0);
        for block in 0..=triangle / 32 {
            let before = match block < triangle / 32 {
                true => u32::MAX,
                false => (1 << (triangle % 32)) - 1,
            };
            let restart = self.mask(block, mask::RESTART) & before;
            new += (self.mask(block, mask::NEW) & before).count_ones();
            restarts += restart.count_ones();
            with_two += (restart & self.mask(block, mask::TURN)).count_ones();
        }
        Used {
            vertices: new + 2 * with_two,
            listed: triangle - new + 2 * (restarts - with_two),
        }
    }

    fn listed(&self, number: u32) -> u32 {
        read_bits(
            self.listed,
            (number * self.index_bits) as usize,
            self.index_bits,
        )
    }

    fn third(&self, triangle: u32) -> u32 {
        let used = self.used_before(triangle);
        let is_new = self.has(triangle, mask::NEW);
        match (
            self.has(triangle, mask::RESTART),
            self.has(triangle, mask::TURN),
        ) {
            (true, true) => used.vertices + 1 + u32::from(is_new),
            _ if is_new => used.vertices,
            (true, false) => self.listed(used.listed + 2),
            (false, _) => self.listed(used.listed),
        }
    }

    /// The first two corners of a restart.
    fn edge(&self, triangle: u32) -> [u32; 2] {
        let used = self.used_before(triangle);
        match (
            self.has(triangle, mask::TURN),
            self.has(triangle, mask::NEW),
        ) {
            (false, _) => [self.listed(used.listed), self.listed(used.listed + 1)],
            (true, true) => [used.vertices, used.vertices + 1],
            (true, false) => [self.listed(used.listed), used.vertices],
        }
    }

    /// The last triangle up to this one that restarts or turns the other way: what the others turn around comes from there.
    fn last_bend(&self, triangle: u32) -> u32 {
        let turns = match self.has(triangle, mask::TURN) {
            true => u32::MAX,
            false => 0,
        };
        let mut up_to = u32::MAX >> (31 - triangle % 32);
        for block in (0..=triangle / 32).rev() {
            let bends = self.mask(block, mask::RESTART) | (self.mask(block, mask::TURN) ^ turns);
            if bends & up_to != 0 {
                return 32 * block + (bends & up_to).ilog2();
            }
            up_to = u32::MAX;
        }
        0
    }

    /// Vertex numbers of a triangle.
    pub fn triangle(&self, triangle: u32) -> [u32; 3] {
        let third = self.third(triangle);
        if self.has(triangle, mask::RESTART) {
            let [from, to] = self.edge(triangle);
            return [from, to, third];
        }
        let turns = self.has(triangle, mask::TURN);
        let bend = self.last_bend(triangle);
        // Around `from` where it turns, else around `to`.
        let around = match self.has(bend, mask::RESTART) {
            true => self.edge(bend)[usize::from(!turns)],
            false => self.third(bend.saturating_sub(1)),
        };
        let newest = self.third(triangle.saturating_sub(1));
        match turns {
            true => [around, newest, third],
            false => [newest, around, third],
        }
    }

    /// All triangles, one after the other: faster than each by itself.
    pub fn triangles(&self) -> impl Iterator<Item = [u8; 3]> + use<'a> {
        let strips = *self;
        let mut used = Used::default();
        let mut last = [0u32; 3];
        (0..self.triangle_count).map(move |triangle| {
            let block = triangle / 32;
            let bit = |mask| strips.mask(block, mask) >> (triangle % 32) & 1 == 1;
            let (is_new, restarts, turns) = (bit(mask::NEW), bit(mask::RESTART), bit(mask::TURN));
            let mut next = || {
                used.vertices += 1;
                used.vertices - 1
            };
            let mut list = || {
                used.listed += 1;
                strips.listed(used.listed - 1)
            };
            let [from, to] = match (restarts, turns) {
                (false, false) => [last[2], last[1]],
                (false, true) => [last[0], last[2]],
                (true, false) => [list(), list()],
                (true, true) if is_new => [next(), next()],
                (true, true) => [list(), next()],
            };
            let third = match is_new || restarts && turns {
                true => next(),
                false => list(),
            };
            last = [from, to, third];
            last.map(|vertex| vertex as u8)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bits::bits_for;
    use crate::cluster::{Cluster, MaterialRange};
    use crate::disk_form::canonical;
    use proptest::prelude::*;

    fn comes_back(triangles: &[[u8; 3]], index_bits: u32) -> usize {
        let mut words = vec![7];
        encode(triangles.iter().copied(), index_bits, &mut words);
        assert!(words.len() - 1 <= MOST_WORDS);
        let strips = Strips::new(&words[1..], triangles.len() as u32, index_bits);
        let one_by_one: Vec<[u8; 3]> = (0..triangles.len() as u32)
            .map(|triangle| strips.triangle(triangle).map(|vertex| vertex as u8))
            .collect();
        assert_eq!(one_by_one, triangles);
        assert_eq!(strips.triangles().collect::<Vec<_>>(), triangles);
        words.len() - 1
    }

    proptest! {
        #[test]
        fn any_triangles_come_back(
            (triangles, most) in (0u8..=255).prop_flat_map(|most| {
                (prop::collection::vec(prop::array::uniform3(0..=most), 1..=128), Just(most))
            })
        ) {
            comes_back(&triangles, bits_for(most as u32));
        }

        #[test]
        fn strips_fans_and_restarts_come_back(
            steps in prop::collection::vec((0u8..6, any::<u8>(), any::<u8>()), 1..=128)
        ) {
            let (mut triangles, mut next) = (vec![], 0u32);
            for (kind, a, b) in steps {
                let count = next.max(1);
                let known = |value: u8| (value as u32 % count) as u8;
                let last = triangles.last().copied().unwrap_or([0; 3]);
                let mut new = || { next += 1; (next - 1) as u8 };
                let [from, to, third]: [u8; 3] = last;
                triangles.push(match kind {
                    _ if triangles.is_empty() => [new(), new(), new()],
                    0 => [third, to, known(a)],
                    1 => [from, third, known(a)],
                    2 => [third, to, new()],
                    3 => [from, third, new()],
                    4 => [known(a), new(), new()],
                    _ => [known(a), known(b), new()],
                });
                if next > 250 {
                    break;
                }
            }
            comes_back(&triangles, 8);
        }
    }

    #[test]
    fn a_grid_takes_under_nine_bits_a_triangle() {
        // 8 x 8 squares.
        let triangles: Vec<[u8; 3]> = (0..64u8)
            .flat_map(|square| {
                let a = square / 8 * 9 + square % 8;
                [[a, a + 1, a + 10], [a, a + 10, a + 9]]
            })
            .collect();
        let ordered = canonical(&Cluster {
            positions: vec![[0; 3]; 81],
            triangles,
            materials: vec![MaterialRange {
                slot: 0,
                triangle_count: 128,
            }],
            ..Cluster::default()
        });
        let words = comes_back(&ordered.triangles, bits_for(80));
        assert!(32 * words < 9 * 128, "{words} words");
    }
}

//! Near: pairs of parts of one material that lie near each other.

use glam::DVec3;

use super::Part;

/// Neighbours of a part that are tried.
const NEIGHBOURS: usize = 6;
/// Parts a cell of the grid that neighbours are looked up in.
const CELL_PARTS: f64 = 2.0;
/// Cells along a side at most.
const MOST_CELLS: usize = 64;

/// Two parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    /// Squared distance of their centres.
    pub squared: f64,
    /// Their numbers, the smaller one first.
    pub parts: [u32; 2],
}

/// Pairs that a stand-in within `budget` of both may have, nearest first.
pub(super) fn pairs(parts: &[Part], budget: f64) -> Vec<Pair> {
    if parts.len() < 2 || budget <= 0.0 {
        return Vec::new();
    }
    let cells = Cells::new(parts);
    let mut pairs = Vec::new();
    let mut near: Vec<(f64, u32)> = Vec::new();
    for (own, part) in (0u32..).zip(parts) {
        near.clear();
        cells.visit(part.center, |other| {
            let there = &parts[other as usize];
            if other == own || there.slot != part.slot {
                return;
            }
            let squared = part.center.distance_squared(there.center);
            // A strip from one to the other is that far from both half way.
            let reach = 2.0 * budget + part.radius + there.radius;
            if squared <= reach * reach {
                near.push((squared, other));
            }
        });
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        pairs.extend(near.iter().take(NEIGHBOURS).map(|&(squared, other)| Pair {
            squared,
            parts: [own.min(other), own.max(other)],
        }));
    }
    pairs.sort_unstable_by(|a, b| a.squared.total_cmp(&b.squared).then(a.parts.cmp(&b.parts)));
    pairs.dedup_by_key(|pair| pair.parts);
    pairs
}

/// A grid over the centres of parts.
struct Cells {
    low: DVec3,
    size: DVec3,
    counts: [usize; 3],
    /// Cell and number of each part, sorted.
    parts: Vec<(usize, u32)>,
}

impl Cells {
    fn new(parts: &[Part]) -> Self {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for part in parts {
            low = low.min(part.center);
            high = high.max(part.center);
        }
        let extent = (high - low).max_element().max(f64::MIN_POSITIVE);
        // A flat heap has a cell across.
        let size = (high - low).max(DVec3::splat(1e-3 * extent));
        let cell = (size.element_product() * CELL_PARTS / parts.len() as f64).cbrt();
        let counts = (size / cell).to_array();
        let mut cells = Self {
            low,
            size,
            counts: counts.map(|count| (count as usize + 1).min(MOST_CELLS)),
            parts: Vec::new(),
        };
        let centers = parts.iter().map(|part| part.center);
        let numbers = centers.map(|center| cells.number(cells.cell(center)));
        cells.parts = numbers.zip(0..).collect();
        cells.parts.sort_unstable();
        cells
    }

    fn cell(&self, at: DVec3) -> [usize; 3] {
        let share = (at - self.low) / self.size;
        std::array::from_fn(|axis| {
            let count = self.counts[axis];
            ((share[axis] * count as f64) as usize).min(count - 1)
        })
    }

    fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Calls `take` with the parts in the cell of a point and in those round it.
    fn visit(&self, at: DVec3, mut take: impl FnMut(u32)) {
        let cell = self.cell(at);
        let around = |axis: usize| {
            let own = cell[axis];
            own.saturating_sub(1)..(own + 2).min(self.counts[axis])
        };
        let row = around(0);
        for z in around(2) {
            for y in around(1) {
                let first = self.number([row.start, y, z]);
                let end = first + row.len();
                let from = self.parts.partition_point(|&(cell, _)| cell < first);
                let own = self.parts[from..].iter();
                own.take_while(|&&(cell, _)| cell < end)
                    .for_each(|&(_, part)| take(part));
            }
        }
    }
}

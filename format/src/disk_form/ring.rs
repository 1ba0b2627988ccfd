//! The open edges of a cluster while its triangles come, one after the other around a gate (see `topology` for the steps).

use crate::limits::MAX_CLUSTER_TRIANGLES;

/// Beginning and end of an edge as the triangle beyond it has them, and the third corner on this side.
pub(super) type Edge = [u8; 3];

/// Edges of one ring over time: three of its first triangle, one more with each other.
const MOST_EDGES: usize = MAX_CLUSTER_TRIANGLES + 2;

/// The edge that a step is about, and its neighbours in the ring. It is handed from step to step, so that it lies in registers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gate {
    number: u8,
    from: u8,
    to: u8,
    opposite: u8,
    before: u8,
    after: u8,
}

impl Gate {
    #[inline(always)]
    pub fn edge(self) -> Edge {
        [self.from, self.to, self.opposite]
    }

    /// The edge and its opposite corner, a byte each.
    #[inline(always)]
    pub fn word(self) -> u32 {
        u32::from_le_bytes([self.from, self.to, self.opposite, 0])
    }

    /// Whether it begins and ends as a triangle does.
    #[inline(always)]
    pub fn is_below(self, triangle: [u8; 3]) -> bool {
        self.from == triangle[0] && self.to == triangle[1]
    }
}

/// The open edges; what it holds of the gate is old.
#[derive(Debug)]
pub(super) struct Ring {
    count: u8,
    from: [u8; MOST_EDGES],
    to: [u8; MOST_EDGES],
    opposite: [u8; MOST_EDGES],
    before: [u8; MOST_EDGES],
    after: [u8; MOST_EDGES],
}

impl Default for Ring {
    fn default() -> Self {
        Self {
            count: 0,
            from: [0; MOST_EDGES],
            to: [0; MOST_EDGES],
            opposite: [0; MOST_EDGES],
            before: [0; MOST_EDGES],
            after: [0; MOST_EDGES],
        }
    }
}

/// Steps take the gate and give the next one; none where the next triangle begins anew.
impl Ring {
    /// Where the edge before the gate comes from, if the two meet.
    #[inline(always)]
    pub fn third_before(&self, gate: Gate) -> Option<u8> {
        let before = gate.before as usize;
        let meets = gate.before != gate.number && self.to[before] == gate.from;
        meets.then(|| self.from[before])
    }

    /// Where the edge after the gate leads to, if the two meet.
    #[inline(always)]
    pub fn third_after(&self, gate: Gate) -> Option<u8> {
        let after = gate.after as usize;
        let meets = gate.after != gate.number && self.from[after] == gate.to;
        meets.then(|| self.to[after])
    }

    /// The first triangle of a ring. None may be open.
    pub fn begin(&mut self, [a, b, c]: [u8; 3]) -> Gate {
        let edge = |number: u8, [from, to, opposite]: Edge| Gate {
            number,
            from,
            to,
            opposite,
            before: (number + 2) % 3,
            after: (number + 1) % 3,
        };
        self.count = 3;
        self.store(edge(0, [b, a, c]));
        self.store(edge(1, [a, c, b]));
        edge(2, [c, b, a])
    }

    /// Nothing beyond the gate.
    #[inline(always)]
    pub fn border(&mut self, gate: Gate) -> Option<Gate> {
        if gate.after == gate.number {
            return None;
        }
        self.link(gate.before, gate.after);
        Some(self.load(gate.after))
    }

    /// A triangle whose third corner is [`Self::third_before`].
    #[inline(always)]
    pub fn before(&mut self, mut gate: Gate) -> Option<Gate> {
        let gone = gate.before;
        gate.opposite = gate.from;
        gate.from = self.from[gone as usize];
        gate.before = self.before[gone as usize];
        if gate.after == gone {
            (gate.before, gate.after) = (gate.number, gate.number);
        } else {
            self.after[gate.before as usize] = gate.number;
        }
        self.fold(gate)
    }

    /// A triangle whose third corner is [`Self::third_after`].
    #[inline(always)]
    pub fn after(&mut self, mut gate: Gate) -> Option<Gate> {
        let gone = gate.after;
        gate.opposite = gate.to;
        gate.to = self.to[gone as usize];
        gate.after = self.after[gone as usize];
        if gate.before == gone {
            (gate.before, gate.after) = (gate.number, gate.number);
        } else {
            self.before[gate.after as usize] = gate.number;
        }
        self.fold(gate)
    }

    /// A triangle with a vertex of no edge beside the gate: its edge from there on is the gate.
    #[inline(always)]
    pub fn corner(&mut self, gate: Gate, third: u8) -> Gate {
        let left = self.count;
        self.count += 1;
        self.store(Gate {
            number: left,
            to: third,
            opposite: gate.to,
            after: gate.number,
            ..gate
        });
        // A gate that is alone is before itself.
        self.after[gate.before as usize] = left;
        let is_alone = gate.before == gate.number;
        Gate {
            from: third,
            opposite: gate.from,
            before: left,
            after: if is_alone { left } else { gate.after },
            ..gate
        }
    }

    #[inline(always)]
    fn store(&mut self, edge: Gate) {
        let at = edge.number as usize;
        self.from[at] = edge.from;
        self.to[at] = edge.to;
        self.opposite[at] = edge.opposite;
        self.before[at] = edge.before;
        self.after[at] = edge.after;
    }

    #[inline(always)]
    fn load(&self, number: u8) -> Gate {
        let at = number as usize;
        Gate {
            number,
            from: self.from[at],
            to: self.to[at],
            opposite: self.opposite[at],
            before: self.before[at],
            after: self.after[at],
        }
    }

    /// Makes two edges neighbours.
    #[inline(always)]
    fn link(&mut self, before: u8, after: u8) {
        self.after[before as usize] = after;
        self.before[after as usize] = before;
    }

    /// Closes the gate against the edge after or before it, where that is the same edge from the other side; then the edge after
    /// both is the gate.
    #[inline(always)]
    fn fold(&mut self, gate: Gate) -> Option<Gate> {
        let is_reverse = |edge: u8| {
            edge != gate.number
                && self.from[edge as usize] == gate.to
                && self.to[edge as usize] == gate.from
        };
        let [first, last] = if is_reverse(gate.after) {
            [gate.before, self.after[gate.after as usize]]
        } else if is_reverse(gate.before) {
            [self.before[gate.before as usize], gate.after]
        } else {
            return Some(gate);
        };
        // Two edges alone: each is on both sides of the other.
        if gate.before == gate.after {
            return None;
        }
        self.link(first, last);
        Some(self.load(last))
    }
}

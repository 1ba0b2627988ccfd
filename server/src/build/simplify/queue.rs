//! Queue: the cheapest edge first, in buckets of a sixteenth of an octave of cost. Push and pop take constant time, and
//! what costs the same within 5 % comes last in, first out: the same order on every machine.

/// Bits of an f32's mantissa that name a bucket.
const MANTISSA_BITS: u32 = 4;
const SHIFT: u32 = 23 - MANTISSA_BITS;
/// All positive floats.
const BUCKETS: usize = 1 << (8 + MANTISSA_BITS);
const NONE: u32 = u32::MAX;

/// Numbers below a known count, each at most once in the queue.
#[derive(Debug)]
pub(super) struct Queue {
    heads: Vec<u32>,
    /// Next number of the same bucket.
    next: Vec<u32>,
    /// One bit a bucket, and one bit for 64 of them.
    filled: [u64; BUCKETS / 64],
    words: [u64; BUCKETS / 4096],
}

impl Default for Queue {
    fn default() -> Self {
        Self {
            heads: vec![NONE; BUCKETS],
            next: Vec::new(),
            filled: [0; BUCKETS / 64],
            words: [0; BUCKETS / 4096],
        }
    }
}

impl Queue {
    /// Empties the queue and makes room for numbers below `count`.
    pub fn clear(&mut self, count: usize) {
        self.heads.fill(NONE);
        self.filled.fill(0);
        self.words.fill(0);
        self.next.clear();
        self.next.resize(count, NONE);
    }

    /// Number of the bucket of a cost. Rounding may leave a cost a little below 0.
    pub fn bucket(cost: f32) -> usize {
        match cost > 0.0 {
            true => (cost.to_bits() >> SHIFT) as usize,
            false => 0,
        }
    }

    pub fn push(&mut self, number: u32, cost: f32) {
        let bucket = Self::bucket(cost);
        self.next[number as usize] = self.heads[bucket];
        self.heads[bucket] = number;
        self.filled[bucket / 64] |= 1 << (bucket % 64);
        self.words[bucket / 4096] |= 1 << (bucket / 64 % 64);
    }

    /// Takes a number out of the cheapest bucket; gives the bucket too.
    pub fn pop(&mut self) -> Option<(u32, usize)> {
        let group = self.words.iter().position(|&word| word != 0)?;
        let word = group * 64 + self.words[group].trailing_zeros() as usize;
        let bucket = word * 64 + self.filled[word].trailing_zeros() as usize;
        let number = self.heads[bucket];
        self.heads[bucket] = self.next[number as usize];
        if self.heads[bucket] == NONE {
            self.filled[word] &= self.filled[word] - 1;
            if self.filled[word] == 0 {
                self.words[group] &= self.words[group] - 1;
            }
        }
        Some((number, bucket))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cheapest_first_within_a_sixteenth() {
        let costs: Vec<f32> = (0..5000u32)
            .map(|i| {
                ((i * 7919 % 5003) as f32).powi(3) * 1e-20 + if i % 50 == 0 { 0.0 } else { 1e-30 }
            })
            .collect();
        let mut queue = Queue::default();
        queue.clear(costs.len());
        (0..costs.len() as u32).for_each(|i| queue.push(i, costs[i as usize]));
        let mut last = 0.0f32;
        let mut count = 0;
        while let Some((number, _)) = queue.pop() {
            let cost = costs[number as usize];
            assert!(cost >= last * (1.0 - 1.0 / 16.0), "{cost} after {last}");
            last = last.max(cost);
            count += 1;
        }
        assert_eq!(count, costs.len());
    }
}

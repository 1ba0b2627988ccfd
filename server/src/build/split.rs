//! Split: triangles into parts of equal number that are compact in space, by halving along the longest side.

/// Keys of the triangles of a part; kept between calls.
#[derive(Debug, Default)]
pub(super) struct Splitter {
    keys: Vec<u64>,
}

impl Splitter {
    /// Splits `order`, indices into `centroids`, into `parts` parts that differ by one in number at most, and calls
    /// `emit` with each. The same whatever the order was before.
    pub fn split(
        &mut self,
        centroids: &[[f32; 3]],
        order: &mut [u32],
        parts: usize,
        emit: &mut impl FnMut(&mut [u32]),
    ) {
        if parts <= 1 {
            // The source's order inside a part: neighbours in the file are often neighbours in space.
            order.sort_unstable();
            emit(order);
            return;
        }
        let lower_parts = parts / 2;
        let lower = (order.len() * lower_parts).div_ceil(parts);
        let axis = longest_side(centroids, order);
        self.keys.clear();
        self.keys.extend(order.iter().map(|&index| {
            (ascending(centroids[index as usize][axis]) as u64) << 32 | index as u64
        }));
        if lower > 0 && lower < self.keys.len() {
            self.keys.select_nth_unstable(lower);
        }
        for (index, key) in order.iter_mut().zip(&self.keys) {
            *index = *key as u32;
        }
        let (lower, upper) = order.split_at_mut(lower);
        self.split(centroids, lower, lower_parts, emit);
        self.split(centroids, upper, parts - lower_parts, emit);
    }
}

/// The axis along which the centroids reach farthest.
pub(super) fn longest_side(centroids: &[[f32; 3]], order: &[u32]) -> usize {
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for &index in order {
        for axis in 0..3 {
            low[axis] = low[axis].min(centroids[index as usize][axis]);
            high[axis] = high[axis].max(centroids[index as usize][axis]);
        }
    }
    let side = |axis: usize| high[axis] - low[axis];
    (1..3).fold(
        0,
        |best, axis| if side(axis) > side(best) { axis } else { best },
    )
}

/// Bits that ascend as the number does.
pub(super) fn ascending(value: f32) -> u32 {
    let bits = value.to_bits();
    bits ^ ((bits as i32 >> 31) as u32 | 0x8000_0000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_equal_and_hold_everything_once() {
        let centroids: Vec<[f32; 3]> = (0..1000u32)
            .map(|i| [(i * 37 % 101) as f32, (i * 53 % 97) as f32 - 48.0, 0.0])
            .collect();
        let mut seen = vec![0; 1000];
        let mut order: Vec<u32> = (0..1000).rev().collect();
        let mut sizes = Vec::new();
        Splitter::default().split(&centroids, &mut order, 9, &mut |part| {
            sizes.push(part.len());
            part.iter().for_each(|&index| seen[index as usize] += 1);
        });
        assert_eq!(sizes.len(), 9);
        assert!(
            sizes.iter().all(|size| (111..=112).contains(size)),
            "{sizes:?}"
        );
        assert!(seen.iter().all(|&times| times == 1));
        assert!(ascending(-1.0) < ascending(-0.5) && ascending(-0.5) < ascending(0.25));
    }
}

//! Split: triangles into parts of equal number that are compact in space, by halving across the direction they are
//! spread widest along. Each cut is smoothed: triangles that stick out over it change places, pair by pair, as long as the
//! halves share fewer vertices then.

use glam::{Vec3, Vec4};

/// Steps towards the direction along which triangles are spread widest.
const ITERATIONS: usize = 6;
/// Times that a cut is looked over.
const PASSES: usize = 3;

/// What is split: indices of all triangles' corners, below `vertices`, and their middles, whose fourth
/// numbers are 0.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape<'a> {
    pub triangles: &'a [[u32; 3]],
    pub centroids: &'a [Vec4],
    pub vertices: usize,
}

/// Kept between calls.
#[derive(Debug, Default)]
pub(super) struct Splitter {
    keys: Vec<u64>,
    /// Corners at each vertex that the lower half has, and the upper.
    uses: Vec<[u32; 2]>,
    /// Triangles that stick out of either half: by how many vertices less a change would do, and their places in the order.
    out: [Vec<(i32, u32)>; 2],
}

impl Splitter {
    /// Splits `order`, indices of triangles, into `parts` parts that differ by one in number at most, and calls
    /// `emit` with each. The same whatever the order was before.
    pub fn split(
        &mut self,
        shape: &Shape,
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
        let along = longest_direction(shape.centroids, order);
        self.keys.clear();
        self.keys.extend(order.iter().map(|&index| {
            let key = shape.centroids[index as usize].dot(along);
            (ascending(key) as u64) << 32 | index as u64
        }));
        if lower > 0 && lower < self.keys.len() {
            self.keys.select_nth_unstable(lower);
        }
        for (index, key) in order.iter_mut().zip(&self.keys) {
            *index = *key as u32;
        }
        self.smooth(shape, order, lower);
        let (lower, upper) = order.split_at_mut(lower);
        self.split(shape, lower, lower_parts, emit);
        self.split(shape, upper, parts - lower_parts, emit);
    }

    fn smooth(&mut self, shape: &Shape, order: &mut [u32], lower: usize) {
        if self.uses.len() < shape.vertices {
            self.uses.resize(shape.vertices, [0; 2]);
        }
        let corners = |index: u32| shape.triangles[index as usize].map(|vertex| vertex as usize);
        for &index in &*order {
            for vertex in corners(index) {
                self.uses[vertex] = [0; 2];
            }
        }
        for (place, &index) in order.iter().enumerate() {
            for vertex in corners(index) {
                self.uses[vertex][usize::from(place >= lower)] += 1;
            }
        }
        for _ in 0..PASSES {
            self.out.iter_mut().for_each(Vec::clear);
            for (place, &index) in order.iter().enumerate() {
                let half = usize::from(place >= lower);
                let corners = corners(index);
                let at_cut = corners
                    .iter()
                    .any(|&vertex| self.uses[vertex][1 - half] > 0);
                if at_cut {
                    let gain = self.gain(corners, half);
                    if gain >= 0 {
                        self.out[half].push((-gain, place as u32));
                    }
                }
            }
            let mut out = std::mem::take(&mut self.out);
            for list in &mut out {
                list.sort_unstable_by_key(|&(loss, place)| (loss, order[place as usize]));
            }
            let mut changed = false;
            for (&(_, own), &(_, other)) in out[0].iter().zip(&out[1]) {
                let (own, other) = (own as usize, other as usize);
                let [mine, theirs] = [own, other].map(|place| corners(order[place]));
                let first = self.gain(mine, 0);
                self.change(mine, 0);
                if first + self.gain(theirs, 1) > 0 {
                    self.change(theirs, 1);
                    order.swap(own, other);
                    changed = true;
                } else {
                    self.change(mine, 1);
                }
            }
            self.out = out;
            if !changed {
                return;
            }
        }
    }

    /// By how many the vertices of both halves together would become fewer if a triangle left `half` for the other.
    fn gain(&self, corners: [usize; 3], half: usize) -> i32 {
        let of = |vertex: usize| {
            let uses = self.uses[vertex];
            i32::from(uses[half] == 1) - i32::from(uses[1 - half] == 0)
        };
        corners.map(of).iter().sum()
    }

    /// Lets a triangle leave `half`.
    fn change(&mut self, corners: [usize; 3], half: usize) {
        for vertex in corners {
            self.uses[vertex][half] -= 1;
            self.uses[vertex][1 - half] += 1;
        }
    }
}

/// The direction along which the centroids are spread widest: the first eigenvector of their covariance, by iteration from
/// the axis of the largest variance. Its fourth number is 0.
fn longest_direction(centroids: &[Vec4], order: &[u32]) -> Vec4 {
    // From a point among them, so that nothing cancels.
    let origin = order
        .first()
        .map_or(Vec4::ZERO, |&first| centroids[first as usize]);
    let mut sum = Vec4::ZERO;
    let mut rows = [Vec4::ZERO; 3];
    for &index in order {
        let at = centroids[index as usize] - origin;
        sum += at;
        rows[0] += at * at.x;
        rows[1] += at * at.y;
        rows[2] += at * at.z;
    }
    let mean = sum / order.len().max(1) as f32;
    (0..3).for_each(|axis| rows[axis] -= sum * mean[axis]);
    let variance = Vec3::new(rows[0].x, rows[1].y, rows[2].z);
    let mut along = Vec4::ZERO;
    along[variance.max_position()] = 1.0;
    for _ in 0..ITERATIONS {
        let turned = rows[0] * along.x + rows[1] * along.y + rows[2] * along.z;
        match turned.try_normalize() {
            Some(unit) => along = unit,
            None => break,
        }
    }
    along
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
        let centroids: Vec<Vec4> = (0..1000u32)
            .map(|i| Vec4::new((i * 37 % 101) as f32, (i * 53 % 97) as f32 - 48.0, 0.0, 0.0))
            .collect();
        let mut seen = vec![0; 1000];
        let mut order: Vec<u32> = (0..1000).rev().collect();
        let mut sizes = Vec::new();
        let shape = Shape {
            triangles: &(0..1000).map(|i| [i, i + 1, i + 2]).collect::<Vec<_>>(),
            centroids: &centroids,
            vertices: 1002,
        };
        Splitter::default().split(&shape, &mut order, 9, &mut |part| {
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

    /// A ragged cut through a square grid: smoothing takes teeth off, and nothing else.
    #[test]
    fn smooth_cuts_share_few_vertices() {
        let row = 33;
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        for a in (0..32 * row).filter(|a| a % row < 32) {
            triangles.extend([[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]);
        }
        // As on a rough surface, whose centroids leap from triangle to triangle.
        let rough = |index: u32| (index.wrapping_mul(2_654_435_761) >> 28) as f32 / 4.0;
        let centroids: Vec<Vec4> = (0u32..)
            .zip(&triangles)
            .map(|(index, corners)| Vec4::X * ((corners[0] % row) as f32 + rough(index)))
            .collect();
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        order.sort_by(|&a, &b| centroids[a as usize][0].total_cmp(&centroids[b as usize][0]));
        let shared = |order: &[u32]| {
            let vertices = |half: &[u32]| -> std::collections::HashSet<u32> {
                half.iter().flat_map(|&i| triangles[i as usize]).collect()
            };
            let (lower, upper) = order.split_at(1024);
            vertices(lower).intersection(&vertices(upper)).count()
        };
        let before = shared(&order);
        let shape = Shape {
            triangles: &triangles,
            centroids: &centroids,
            vertices: 33 * 33,
        };
        Splitter::default().smooth(&shape, &mut order, 1024);
        let after = shared(&order);
        assert!(after * 5 < before * 4, "{after} of {before}");
        order.sort_unstable();
        assert!(order.into_iter().eq(0..2048));
    }
}

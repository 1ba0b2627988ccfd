//! Reflex corners in a grid: what may lie inside of an ear.

use glam::DVec2;

/// Corners by cell, the polygon's box cut into about as many cells as there are corners.
pub(super) struct Grid {
    least: DVec2,
    cells_per_unit: DVec2,
    side: usize,
    /// Corners of cell `c` are `corners[starts[c]..starts[c + 1]]`.
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl Grid {
    /// Of the corners at `points` that `is_in` says.
    pub(super) fn new(points: &[DVec2], is_in: impl Fn(usize) -> bool) -> Self {
        let least = points.iter().fold(DVec2::INFINITY, |a, &b| a.min(b));
        let most = points.iter().fold(DVec2::NEG_INFINITY, |a, &b| a.max(b));
        let count = (0..points.len()).filter(|&at| is_in(at)).count();
        let side = (count as f64).sqrt().ceil().max(1.0);
        let size = most - least;
        let per_unit = |length: f64| match length > 0.0 {
            true => side / length,
            false => 0.0,
        };
        let mut grid = Self {
            least,
            cells_per_unit: DVec2::new(per_unit(size.x), per_unit(size.y)),
            side: side as usize,
            starts: vec![0; side as usize * side as usize + 1],
            corners: vec![0; count],
        };
        let cells: Vec<(usize, u32)> = (0..points.len())
            .filter(|&at| is_in(at))
            .map(|at| (grid.cell(points[at]), at as u32))
            .collect();
        for &(cell, _) in &cells {
            grid.starts[cell + 1] += 1;
        }
        for cell in 1..grid.starts.len() {
            grid.starts[cell] += grid.starts[cell - 1];
        }
        let mut next = grid.starts.clone();
        for (cell, corner) in cells {
            grid.corners[next[cell] as usize] = corner;
            next[cell] += 1;
        }
        grid
    }

    fn place(&self, point: DVec2) -> (usize, usize) {
        let place = (point - self.least) * self.cells_per_unit;
        let last = self.side - 1;
        // A cast holds NaN and what is out of range to the ends.
        ((place.x as usize).min(last), (place.y as usize).min(last))
    }

    fn cell(&self, point: DVec2) -> usize {
        let (column, row) = self.place(point);
        row * self.side + column
    }

    /// Whether `is_met` holds for any corner in the cells of the box `least..=most`; counts cells
    /// and corners looked at in `steps`.
    pub(super) fn any_in(
        &self,
        least: DVec2,
        most: DVec2,
        steps: &mut u64,
        mut is_met: impl FnMut(u32) -> bool,
    ) -> bool {
        let ((left, bottom), (right, top)) = (self.place(least), self.place(most));
        for row in bottom..=top {
            *steps += (right - left + 1) as u64;
            // Cells of a row lie side by side.
            let cell = row * self.side + left;
            let first = self.starts[cell] as usize;
            let last = self.starts[cell + right - left + 1] as usize;
            *steps += (last - first) as u64;
            if self.corners[first..last].iter().any(|&it| is_met(it)) {
                return true;
            }
        }
        false
    }
}

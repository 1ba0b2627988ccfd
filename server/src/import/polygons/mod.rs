//! Polygons: faces of more than three corners cut into triangles, always two fewer than corners.
//!
//! Readers write each face as a fan from its first corner, which names all its corners. A fan that
//! covers its polygon stays. The others are cut by `ears`, along the plane of Newell's normal.
//! The count of triangles never depends on positions, so a mesh can be counted before it is read.

mod ears;
mod reflex;

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::warnings::Warnings;
use ears::Cut;

/// Polygons of more corners stay fans: the cut holds some 60 bytes a corner.
pub(super) const MOST_CORNERS: usize = 1 << 17;
/// Sine of the angle up to which a corner counts as straight: rounding of positions turns it.
const STRAIGHT_SIN: f64 = 1e-9;

/// A face of more than three corners, as triangles of a list.
#[derive(Clone, Copy)]
pub(super) struct Polygon {
    /// Its first triangle.
    pub(super) first: u32,
    /// Its triangles: two fewer than its corners.
    pub(super) count: u32,
}

impl Polygon {
    pub(super) fn range(self) -> Range<usize> {
        let first = self.first as usize;
        first..first + self.count as usize
    }
}

/// Corners of a fan, in order.
pub(super) fn corners<T: Copy>(fan: &[[T; 3]]) -> Vec<T> {
    let start = fan.iter().take(1).flat_map(|&[a, b, _]| [a, b]);
    start.chain(fan.iter().map(|&[_, _, c]| c)).collect()
}

/// Cuts polygons and counts those that cannot be cut well.
#[derive(Default)]
pub(super) struct Cutter {
    crossing: u64,
    too_long: u64,
    too_winding: u64,
}

impl Cutter {
    /// Triangles of the polygon `corners` as places in it; `None` where its fan is right.
    pub(super) fn cut(&mut self, corners: &[DVec3]) -> Option<Vec<[u32; 3]>> {
        if corners.len() > MOST_CORNERS {
            self.too_long += 1;
            return None;
        }
        // A reader refuses what is not finite; here it would have no area.
        let first = *corners.first()?;
        if !corners.iter().all(|it| it.as_vec3().is_finite()) {
            return None;
        }
        // From the first corner: areas far from the origin lose nothing.
        let local: Vec<DVec3> = corners.iter().map(|&it| it - first).collect();
        let (normal, area) = newell(&local);
        if normal.length() <= STRAIGHT_SIN * area {
            // No side is up: a line, or a figure of eight.
            self.crossing += u64::from(area > 0.0);
            return None;
        }
        if fan_covers(&local, normal) {
            return None;
        }
        let (triangles, cut) = ears::cut(&flat(&local, normal));
        match cut {
            Cut::Whole => {}
            Cut::Crossing => self.crossing += 1,
            Cut::TooWinding => self.too_winding += 1,
        }
        Some(triangles)
    }

    /// Says what was counted.
    pub(super) fn note(&self, place: &str, warnings: &mut Warnings) {
        let what = "polygons that cross themselves cut as well as can be";
        warnings.add(what, self.crossing, place);
        let what = format!("polygons of more than {MOST_CORNERS} corners cut into fans");
        warnings.add(what, self.too_long, place);
        let what = "polygons of too many turns cut in part into fans";
        warnings.add(what, self.too_winding, place);
    }
}

/// Newell's normal, twice the area long, and twice the area of the fan's triangles.
fn newell(local: &[DVec3]) -> (DVec3, f64) {
    let crosses = local.windows(2).map(|side| side[0].cross(side[1]));
    crosses.fold((DVec3::ZERO, 0.0), |(normal, area), cross| {
        (normal + cross, area + cross.length())
    })
}

/// Whether the fan from the first corner, which is at zero, covers its polygon once.
fn fan_covers(local: &[DVec3], normal: DVec3) -> bool {
    let up = normal.normalize();
    let mut angle = 0.0;
    for side in local.windows(2).skip(1) {
        let (sine, cosine) = (side[0].cross(side[1]).dot(up), side[0].dot(side[1]));
        if sine < -STRAIGHT_SIN * side[0].length() * side[1].length() {
            return false;
        }
        angle += sine.atan2(cosine).max(0.0);
    }
    // The corner's own angle; one more turn is a polygon that overlaps itself.
    angle < std::f64::consts::TAU
}

/// Along the normal's largest axis onto the other two: coordinates stay exact, and areas positive.
fn flat(local: &[DVec3], normal: DVec3) -> Vec<DVec2> {
    let size = normal.abs();
    let axis = match size.max_element() {
        most if most == size.z => 2,
        most if most == size.y => 1,
        _ => 0,
    };
    let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
    if normal[axis] < 0.0 {
        std::mem::swap(&mut u, &mut v);
    }
    local.iter().map(|it| DVec2::new(it[u], it[v])).collect()
}

#[cfg(test)]
mod tests;

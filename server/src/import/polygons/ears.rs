//! Ears: a flat polygon cut corner by corner, bridges to holes included (Meisters 1975; Held 2001).
//!
//! An ear is a convex corner whose triangle holds no reflex corner. Cutting one off changes its two
//! neighbours only, so a queue finds all. Where no ear is left although corners are, the polygon
//! crosses or touches itself, and the demands become weaker until one can be cut. Steps are bounded
//! in the number of corners; `earcut` was not taken for that, and because it leaves straight
//! corners out, so that its count of triangles depends on positions.

use std::collections::VecDeque;

use glam::DVec2;

use super::reflex::Grid;

/// Looks at cells and corners for each corner of the polygon; beyond, what is left is a fan.
/// Outlines of maps take some tens, a comb a quarter of its corners.
const STEPS_PER_CORNER: u64 = 1 << 12;

/// How well a polygon could be cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cut {
    /// Its triangles are its area.
    Whole,
    /// It crosses itself.
    Crossing,
    /// Out of steps.
    TooWinding,
}

/// How much is demanded of an ear.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Demand {
    /// Nothing inside or on its border.
    Strict,
    /// Nothing inside.
    Open,
    /// No area that counts twice: a corner that is not reflex.
    Convex,
    Nothing,
}

/// Cuts the polygon `points`, whose area is positive: triangles of places in it, two fewer.
pub(super) fn cut(points: &[DVec2]) -> (Vec<[u32; 3]>, Cut) {
    let mut ring = Ring::new(points);
    let is_forced = ring.run();
    let cut = match () {
        () if ring.steps > ring.most_steps => Cut::TooWinding,
        () if is_forced || !turns_once(points) || sides_cross(points) => Cut::Crossing,
        () => Cut::Whole,
    };
    (ring.triangles, cut)
}

/// Rest of a polygon.
struct Ring<'a> {
    points: &'a [DVec2],
    next: Vec<u32>,
    previous: Vec<u32>,
    /// May lie inside of an ear: reflex or straight, and not cut off.
    is_reflex: Vec<bool>,
    is_cut: Vec<bool>,
    is_waiting: Vec<bool>,
    waiting: VecDeque<u32>,
    grid: Grid,
    left: usize,
    triangles: Vec<[u32; 3]>,
    steps: u64,
    most_steps: u64,
}

impl<'a> Ring<'a> {
    fn new(points: &'a [DVec2]) -> Self {
        let count = points.len() as u32;
        let next: Vec<u32> = (1..count).chain([0]).collect();
        let previous: Vec<u32> = [count - 1].into_iter().chain(0..count - 1).collect();
        let reflex = |at: usize| {
            let (before, after) = (previous[at] as usize, next[at] as usize);
            cross(points[before], points[at], points[after]) <= 0.0
        };
        let is_reflex: Vec<bool> = (0..points.len()).map(reflex).collect();
        Self {
            points,
            grid: Grid::new(points, |at| is_reflex[at]),
            next,
            previous,
            is_reflex,
            is_cut: vec![false; points.len()],
            is_waiting: vec![true; points.len()],
            waiting: (0..count).collect(),
            left: points.len(),
            triangles: Vec::with_capacity(points.len().saturating_sub(2)),
            steps: 0,
            most_steps: STEPS_PER_CORNER * u64::from(count),
        }
    }

    /// Cuts until a triangle is left; says whether a corner was cut that is no ear.
    fn run(&mut self) -> bool {
        let (mut demand, mut is_forced) = (Demand::Strict, false);
        let mut start = 0;
        while self.left > 3 {
            let Some(corner) = self.waiting.pop_front() else {
                demand = match demand {
                    Demand::Strict => Demand::Open,
                    Demand::Open => Demand::Convex,
                    Demand::Convex | Demand::Nothing => Demand::Nothing,
                };
                self.wait_again(start);
                continue;
            };
            self.is_waiting[corner as usize] = false;
            if self.is_cut[corner as usize] {
                continue;
            }
            if self.steps > self.most_steps {
                demand = Demand::Nothing;
            }
            if !self.is_ear(corner, demand) {
                continue;
            }
            start = self.next[corner as usize];
            is_forced |= matches!(demand, Demand::Convex | Demand::Nothing);
            self.cut_off(corner);
            if demand != Demand::Strict && self.steps <= self.most_steps {
                demand = Demand::Strict;
                self.wait_again(start);
            }
        }
        let corner = start as usize;
        self.triangles
            .push([self.previous[corner], start, self.next[corner]]);
        is_forced
    }

    fn at(&self, corner: u32) -> DVec2 {
        self.points[corner as usize]
    }

    fn around(&self, corner: u32) -> [u32; 3] {
        let at = corner as usize;
        [self.previous[at], corner, self.next[at]]
    }

    fn is_ear(&mut self, corner: u32, demand: Demand) -> bool {
        let around = self.around(corner);
        let [a, b, c] = around.map(|it| self.at(it));
        let area = cross(a, b, c);
        self.steps += 1;
        if demand == Demand::Nothing {
            return true;
        }
        if area <= 0.0 {
            // A spike has no area; one less hides nothing.
            let is_spike = a == b || b == c || (a - b).dot(c - b) > 0.0;
            return area == 0.0 && (is_spike || demand == Demand::Convex);
        }
        if demand == Demand::Convex {
            return true;
        }
        let (least, most) = (a.min(b).min(c), a.max(b).max(c));
        let mut steps = 0;
        let blocked = self.grid.any_in(least, most, &mut steps, |other| {
            !around.contains(&other)
                && self.is_reflex[other as usize]
                && self.blocks(other, [a, b, c], demand)
        });
        self.steps += steps;
        !blocked
    }

    /// Whether the reflex corner `other` keeps the triangle `a b c` from being an ear at `b`.
    fn blocks(&self, other: u32, [a, b, c]: [DVec2; 3], demand: Demand) -> bool {
        let point = self.at(other);
        if point == b {
            // A tip that touches the corner from within, or a bridge that leaves it.
            let [before, _, after] = self.around(other).map(|it| self.at(it));
            return [before, after]
                .iter()
                .any(|&it| cross(a, b, it) > 0.0 && cross(b, c, it) > 0.0);
        }
        if point == a || point == c {
            return false;
        }
        let sides = [cross(a, b, point), cross(b, c, point), cross(c, a, point)];
        match demand {
            Demand::Strict => sides.iter().all(|&it| it >= 0.0),
            _ => sides.iter().all(|&it| it > 0.0),
        }
    }

    fn cut_off(&mut self, corner: u32) {
        let [before, _, after] = self.around(corner);
        self.triangles.push([before, corner, after]);
        self.next[before as usize] = after;
        self.previous[after as usize] = before;
        self.is_cut[corner as usize] = true;
        self.is_reflex[corner as usize] = false;
        self.left -= 1;
        for neighbour in [before, after] {
            let [a, b, c] = self.around(neighbour).map(|it| self.at(it));
            // Reflex corners become convex, never the other way, unless the polygon crosses itself.
            let at = neighbour as usize;
            self.is_reflex[at] = self.is_reflex[at] && cross(a, b, c) <= 0.0;
            if !self.is_waiting[at] {
                self.is_waiting[at] = true;
                self.waiting.push_back(neighbour);
            }
        }
    }

    /// All corners that are left wait, from `start` on.
    fn wait_again(&mut self, start: u32) {
        self.waiting.clear();
        let mut corner = start;
        for _ in 0..self.left {
            self.is_waiting[corner as usize] = true;
            self.waiting.push_back(corner);
            corner = self.next[corner as usize];
        }
        self.steps += self.left as u64;
    }
}

/// Twice the area of a triangle, positive where it is counter-clockwise.
fn cross(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - b)
}

/// Whether the sides turn around once: twice is a polygon that overlaps itself. A side that turns
/// back on itself could be either way, and is not judged.
fn turns_once(points: &[DVec2]) -> bool {
    let mut sides: Vec<DVec2> = points.windows(2).map(|it| it[1] - it[0]).collect();
    sides.extend(points.first().zip(points.last()).map(|(a, b)| a - b));
    sides.retain(|it| *it != DVec2::ZERO);
    let mut turn = 0.0;
    for (at, side) in sides.iter().enumerate() {
        let next = sides[(at + 1) % sides.len()];
        let (sine, cosine) = (side.perp_dot(next), side.dot(next));
        if sine == 0.0 && cosine < 0.0 {
            return true;
        }
        turn += sine.atan2(cosine);
    }
    (turn - std::f64::consts::TAU).abs() < 1.0
}

/// Whether two sides cross each other, not only touch; looked at in short polygons only.
fn sides_cross(points: &[DVec2]) -> bool {
    /// Ears and turns tell of most that are longer; this takes the square of it.
    const MOST_CORNERS: usize = 256;
    if points.len() > MOST_CORNERS {
        return false;
    }
    let side = |at: usize| (points[at], points[(at + 1) % points.len()]);
    let parts = |a: DVec2, b: DVec2, c: DVec2, d: DVec2| cross(a, b, c) * cross(a, b, d) < 0.0;
    (0..points.len()).any(|one| {
        let (a, b) = side(one);
        (0..one).any(|other| {
            let (c, d) = side(other);
            parts(a, b, c, d) && parts(c, d, a, b)
        })
    })
}

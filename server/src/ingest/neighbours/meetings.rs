//! Meetings: where the boxes of instances overlap. Only vertices there can coincide.

use glam::{DAffine3, DVec3};

use super::Placed;
use crate::import::{ImportError, MeshSource};

/// Pairs of boxes that are tested; after them the rest of the instances may meet anything.
const MOST_TESTS: u64 = 1 << 26;
/// Boxes that are kept of a mesh; more of them become one.
const MOST_BOXES: usize = 32;
/// Share of the size of a mesh by which its boxes grow: equal vertices may differ by rounding.
const GROWTH: f64 = 1.0 / (1 << 14) as f64;

/// A box. Without a point where `low` is above `high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Box3 {
    pub low: DVec3,
    pub high: DVec3,
}

impl Box3 {
    const EMPTY: Self = Self {
        low: DVec3::MAX,
        high: DVec3::MIN,
    };

    pub(super) fn add(&mut self, point: DVec3) {
        self.low = self.low.min(point);
        self.high = self.high.max(point);
    }

    /// Longest side.
    pub(super) fn extent(&self) -> f64 {
        (self.high - self.low).max_element().max(0.0)
    }

    pub(super) fn holds(&self, point: DVec3) -> bool {
        self.low.cmple(point).all() && point.cmple(self.high).all()
    }

    fn grown(self, by: f64) -> Self {
        Self {
            low: self.low - by,
            high: self.high + by,
        }
    }

    fn shared(self, other: Self) -> Option<Self> {
        let low = self.low.max(other.low);
        let high = self.high.min(other.high);
        low.cmple(high).all().then_some(Self { low, high })
    }

    fn joined(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }

    /// The box of its eight corners under `map`.
    pub(super) fn mapped(&self, map: &DAffine3) -> Self {
        let mut all = Self::EMPTY;
        for corner in 0..8u8 {
            let pick = |axis: usize| match corner >> axis & 1 {
                0 => self.low[axis],
                _ => self.high[axis],
            };
            all.add(map.transform_point3(DVec3::new(pick(0), pick(1), pick(2))));
        }
        all
    }
}

/// The box of a mesh, object space.
pub(super) fn bounds(mesh: &dyn MeshSource) -> Result<Box3, ImportError> {
    let mut bounds = Box3::EMPTY;
    for index in 0..mesh.piece_count() {
        let piece = mesh.piece(index)?;
        for &position in &piece.positions {
            bounds.add(DVec3::from(position.map(f64::from)));
        }
    }
    Ok(bounds)
}

/// Where each mesh may meet another instance, object space.
#[derive(Debug, Clone, Default)]
pub(super) struct Meeting {
    boxes: Vec<Box3>,
    /// The mesh may meet others everywhere.
    is_whole: bool,
}

impl Meeting {
    pub(super) fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    pub(super) fn holds(&self, position: [f32; 3]) -> bool {
        let point = DVec3::from(position.map(f64::from));
        self.boxes.iter().any(|part| part.holds(point))
    }

    fn add(&mut self, part: Box3, own: &Box3) {
        if part == *own {
            self.boxes = vec![part];
            self.is_whole = true;
        }
        if self.boxes.contains(&part) {
            return;
        }
        self.boxes.push(part);
        if self.boxes.len() > MOST_BOXES {
            let all = self.boxes.drain(..).fold(Box3::EMPTY, Box3::joined);
            self.boxes.push(all);
        }
    }
}

/// Sizes of instances as bits, from the smallest on; the last bit is all larger ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Sizes(u64);

impl Sizes {
    fn bit(smallest: i16, size: i16) -> u64 {
        1 << (size as i32 - smallest as i32).clamp(0, 63)
    }

    pub(super) fn holds(self, smallest: i16, size: i16) -> bool {
        self.0 & Self::bit(smallest, size) != 0
    }
}

/// Where instances may meet.
#[derive(Debug)]
pub(super) struct Meetings {
    /// Of each mesh.
    pub of_mesh: Vec<Meeting>,
    /// Sizes of the instances that each instance meets.
    pub sizes: Vec<Sizes>,
    pub smallest_size: i16,
}

/// Finds the meetings of `bounds.len()` meshes: a sweep along x over the boxes of the instances.
pub(super) fn meetings(placed: &[Placed], bounds: &[Box3]) -> Meetings {
    let mut of_mesh = vec![Meeting::default(); bounds.len()];
    let size = |instance: usize| placed[instance].size.unwrap_or(i16::MIN);
    let smallest_size = (0..placed.len()).map(size).min().unwrap_or(0);
    let mut sizes = vec![Sizes::default(); placed.len()];
    let world: Vec<Box3> = placed
        .iter()
        .map(|placed| {
            let own = bounds[placed.mesh].mapped(&placed.world_from_object);
            own.grown(GROWTH * own.extent())
        })
        .collect();
    let mut order: Vec<usize> = (0..placed.len()).collect();
    order.sort_by(|&a, &b| world[a].low.x.total_cmp(&world[b].low.x));
    let mut meet = |instance: usize, part: Box3| {
        let Placed {
            mesh,
            object_from_world,
            ..
        } = &placed[instance];
        if of_mesh[*mesh].is_whole {
            return;
        }
        let own = bounds[*mesh];
        // Grown again: the way back rounds.
        let part = part.mapped(object_from_world);
        let part = part.grown(GROWTH * own.extent());
        if let Some(part) = part.shared(own) {
            of_mesh[*mesh].add(part, &own);
        }
    };
    let mut active: Vec<usize> = vec![];
    let mut tests = 0;
    for (place, &instance) in order.iter().enumerate() {
        let own = world[instance];
        active.retain(|&other| world[other].high.x >= own.low.x);
        tests += active.len() as u64;
        if tests > MOST_TESTS {
            for &rest in active.iter().chain(&order[place..]) {
                meet(rest, world[rest]);
                sizes[rest] = Sizes(u64::MAX);
            }
            break;
        }
        for &other in &active {
            if let Some(part) = own.shared(world[other]) {
                meet(instance, part);
                meet(other, part);
                sizes[instance].0 |= Sizes::bit(smallest_size, size(other));
                sizes[other].0 |= Sizes::bit(smallest_size, size(instance));
            }
        }
        active.push(instance);
    }
    Meetings {
        of_mesh,
        sizes,
        smallest_size,
    }
}

//! Where everything stands: blocks from the middle outward, each with its list of instances.

use super::street::{KERB, PITCH, STEP};
use crate::samples::number::Random;

/// What a mesh is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Hills,
    Monument,
    PavedBlock,
    GreenBlock,
    Tower,
    House,
    Tree,
    Car,
    Lamp,
    Bench,
}

/// An instance inside a block.
#[derive(Clone, Debug)]
pub(super) struct Item {
    pub(super) mesh: usize,
    /// Metres from the block's middle.
    pub(super) at: [f64; 3],
    /// Turns about y.
    pub(super) turns: f64,
    pub(super) scale: f64,
}

/// A block and what stands on it.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) at: [f64; 3],
    pub(super) items: Vec<Item>,
}

/// The whole city.
pub(super) struct Plan {
    pub(super) blocks: Vec<Block>,
    /// Metres from the origin to the farthest block's corner.
    pub(super) radius_metres: f64,
}

/// About how many instances a block takes.
const ITEMS_A_BLOCK: f64 = 26.0;

impl Plan {
    /// Exactly `instances` instances of the meshes of `catalogue`.
    pub(super) fn new(instances: usize, catalogue: &[(super::Kind, usize)], seed: u64) -> Self {
        let shelf = Shelf::new(catalogue);
        let expected = (instances as f64 / ITEMS_A_BLOCK / std::f64::consts::PI)
            .sqrt()
            .max(1.5);
        let reach = (expected * 1.6) as i64 + 3;
        let mut cells: Vec<(i64, i64, i64)> = (-reach..=reach)
            .flat_map(|z| (-reach..=reach).map(move |x| (x * x + z * z, z, x)))
            .collect();
        cells.sort_unstable();
        let land = Item {
            mesh: shelf.only(Kind::Hills),
            at: [0.0; 3],
            turns: 0.0,
            scale: 1.0,
        };
        let mut blocks = vec![Block {
            at: [0.0; 3],
            items: vec![land],
        }];
        let mut left = instances - 1;
        let mut farthest = 0;
        for (distance, z, x) in cells {
            if left == 0 {
                break;
            }
            let mut random = Random::new(
                seed,
                1 << 32 | ((z + reach) as u64) << 16 | (x + reach) as u64,
            );
            let share = (distance as f64).sqrt() / expected;
            let mut items = lay_out(distance == 0, share, &shelf, &mut random);
            items.truncate(left);
            left -= items.len();
            farthest = distance;
            blocks.push(Block {
                at: [x as f64 * PITCH, 0.0, z as f64 * PITCH],
                items,
            });
        }
        Self {
            blocks,
            radius_metres: ((farthest as f64).sqrt() + 0.75) * PITCH,
        }
    }
}

/// The catalogue by kind.
struct Shelf<'a>(&'a [(Kind, usize)]);

impl Shelf<'_> {
    fn new(catalogue: &[(Kind, usize)]) -> Shelf<'_> {
        Shelf(catalogue)
    }

    /// Mesh indices of a kind, in the order of their number; towers from low to high.
    fn all(&self, kind: Kind) -> Vec<usize> {
        let mut meshes: Vec<_> = (0..self.0.len())
            .filter(|&mesh| self.0[mesh].0 == kind)
            .collect();
        meshes.sort_by_key(|&mesh| (self.0[mesh].1 % 6, self.0[mesh].1));
        meshes
    }

    /// The first mesh of a kind; 0 where the catalogue has none.
    fn only(&self, kind: Kind) -> usize {
        self.all(kind).first().copied().unwrap_or(0)
    }
}

/// Collects a block's instances.
struct Lot<'a> {
    items: Vec<Item>,
    shelf: &'a Shelf<'a>,
}

impl Lot<'_> {
    fn put(&mut self, mesh: usize, at: [f64; 3], turns: f64, scale: f64) {
        self.items.push(Item {
            mesh,
            at,
            turns,
            scale,
        });
    }

    /// One of a kind at random; nothing where the catalogue has none.
    fn any(&mut self, kind: Kind, at: [f64; 3], turns: f64, scale: f64, random: &mut Random) {
        let meshes = self.shelf.all(kind);
        if let Some(&mesh) = meshes.get(random.below(meshes.len())) {
            self.put(mesh, at, turns, scale);
        }
    }
}

/// A block at `share` of the city's radius.
fn lay_out(is_middle: bool, share: f64, shelf: &Shelf<'_>, random: &mut Random) -> Vec<Item> {
    let mut lot = Lot {
        items: Vec::new(),
        shelf,
    };
    let is_park = !is_middle && share > 0.16 && random.unit() < 0.09;
    let is_downtown = share < random.between(0.42, 0.56);
    let ground = if is_middle || (is_downtown && !is_park) {
        Kind::PavedBlock
    } else {
        Kind::GreenBlock
    };
    lot.put(shelf.only(ground), [0.0; 3], 0.0, 1.0);
    if is_middle {
        lot.put(shelf.only(Kind::Monument), [0.0, STEP, 0.0], 0.0, 1.0);
        square(&mut lot, random);
    } else if is_park {
        park(&mut lot, random);
    } else if is_downtown {
        downtown(&mut lot, share, random);
    } else {
        houses(&mut lot, random);
    }
    roadside(&mut lot, share, random);
    lot.items
}

/// Trees and benches round the monument.
fn square(lot: &mut Lot<'_>, random: &mut Random) {
    for side in 0..4 {
        for step in [-13.0, -4.5, 4.5, 13.0] {
            let at = turned(side, step, 16.5, STEP);
            lot.any(
                Kind::Tree,
                at,
                random.unit(),
                random.between(0.75, 0.9),
                random,
            );
            lot.any(
                Kind::Bench,
                turned(side, step, 12.2, STEP),
                0.5 + side as f64 * 0.25,
                1.0,
                random,
            );
        }
    }
}

fn park(lot: &mut Lot<'_>, random: &mut Random) {
    for row in 0..5 {
        for column in 0..5 {
            if random.unit() < 0.22 {
                continue;
            }
            let place = |index: i32, random: &mut Random| {
                (f64::from(index) - 2.0) * 8.2 + random.between(-2.2, 2.2)
            };
            let at = [place(column, random), STEP, place(row, random)];
            lot.any(
                Kind::Tree,
                at,
                random.unit(),
                random.between(0.85, 1.45),
                random,
            );
        }
    }
    for side in 0..4 {
        lot.any(
            Kind::Bench,
            turned(side, random.between(-8.0, 8.0), 19.6, STEP),
            side as f64 * 0.25,
            1.0,
            random,
        );
    }
}

/// Four towers, higher toward the middle.
fn downtown(lot: &mut Lot<'_>, share: f64, random: &mut Random) {
    let towers = lot.shelf.all(Kind::Tower);
    let count = towers.len();
    for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let rank = (1.0 - share / 0.56) * count as f64 + random.between(-1.6, 1.1);
        let rank = rank.clamp(0.0, count as f64 - 1.0) as usize;
        let quarter = random.below(4) as f64 * 0.25;
        if let Some(&mesh) = towers.get(rank) {
            lot.put(mesh, [x * 10.4, STEP, z * 10.4], quarter, 1.0);
        }
    }
}

/// Two rows of three houses with gardens between.
fn houses(lot: &mut Lot<'_>, random: &mut Random) {
    for row in [-1.0, 1.0] {
        for column in [-1.0, 0.0, 1.0] {
            let at = [
                column * 13.4 + random.between(-0.5, 0.5),
                STEP,
                row * (11.8 + random.between(-0.8, 0.4)),
            ];
            let turns = if row > 0.0 { 0.0 } else { 0.5 };
            lot.any(Kind::House, at, turns, 1.0, random);
        }
        for _ in 0..4 {
            let at = [
                random.between(-19.0, 19.0),
                STEP,
                row * random.between(0.5, 3.2),
            ];
            lot.any(
                Kind::Tree,
                at,
                random.unit(),
                random.between(0.65, 1.0),
                random,
            );
        }
    }
}

/// Trees and lamps on the pavement, cars at the kerb and in the lane.
fn roadside(lot: &mut Lot<'_>, share: f64, random: &mut Random) {
    for side in 0..4 {
        for step in [-16.0, -5.0, 6.0, 17.0] {
            if random.unit() < 0.6 {
                let at = turned(side, step, 22.2, STEP);
                lot.any(
                    Kind::Tree,
                    at,
                    random.unit(),
                    random.between(0.6, 0.85),
                    random,
                );
            }
        }
        let quarter = side as f64 * 0.25;
        lot.any(
            Kind::Lamp,
            turned(side, 22.6, KERB - 0.7, STEP),
            quarter,
            1.0,
            random,
        );
        let parked = if share < 0.5 { 3 } else { 1 };
        for _ in 0..parked {
            let slot = (random.below(7) as f64 - 3.0) * 5.4;
            let at = turned(side, slot, KERB + 1.15, 0.0);
            if !lot.items.iter().any(|item| near(item.at, at)) {
                lot.any(Kind::Car, at, quarter + 0.25, 1.0, random);
            }
        }
        if random.unit() < 0.55 {
            let at = turned(side, random.between(-22.0, 22.0), KERB + 5.4, 0.0);
            lot.any(Kind::Car, at, quarter + 0.25, 1.0, random);
        }
    }
}

fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    (a[0] - b[0]).abs() < 5.0 && (a[2] - b[2]).abs() < 1.5
        || (a[2] - b[2]).abs() < 5.0 && (a[0] - b[0]).abs() < 1.5
}

/// `across` along side `side` of a block, `out` from its middle: side 0 is +z, 1 is +x, and so on.
fn turned(side: usize, across: f64, out: f64, y: f64) -> [f64; 3] {
    match side % 4 {
        0 => [across, y, out],
        1 => [out, y, -across],
        2 => [-across, y, -out],
        _ => [-out, y, across],
    }
}

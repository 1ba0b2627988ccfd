//! The order of instances: along a Morton curve of the centres of their boxes.

use lodestream_format::scene::Instance;
use rayon::prelude::*;

use super::AssetBox;

/// Instances of a block: a run of as many, counted from the first, is near each other.
pub(in crate::ingest) const BLOCK_INSTANCES: usize = 64;
/// Bits of an axis in the key.
const AXIS_BITS: u32 = 21;

/// Sorts; equal keys stay in their order, whatever the thread count. `boxes` are of the assets.
pub(super) fn sort(instances: &mut Vec<Instance>, boxes: &[AssetBox]) {
    let center = |instance: &Instance| {
        let [x, y, z] = boxes[instance.asset as usize].center.map(f64::from);
        instance
            .world_from_object
            .map(|[a, b, c, offset]| a * x + b * y + c * z + offset)
    };
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for instance in &*instances {
        for (axis, value) in center(instance).into_iter().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
    }
    // One unit on all axes: the cells are cubes.
    let extent = (0..3).map(|axis| high[axis] - low[axis]);
    let extent = extent.fold(f64::MIN_POSITIVE, f64::max);
    let cells = f64::from((1u32 << AXIS_BITS) - 1);
    let key = |instance: &Instance| {
        let axes = center(instance);
        (0..3).fold(0u64, |key, axis| {
            // Saturates: far out the differences may be infinite or no numbers.
            let cell = ((axes[axis] - low[axis]) / extent * cells) as u64;
            key | spread(cell.min(cells as u64)) << axis
        })
    };
    let mut keys: Vec<(u64, u32)> = instances
        .par_iter()
        .zip(0..instances.len() as u32)
        .map(|(instance, index)| (key(instance), index))
        .collect();
    keys.par_sort_unstable();
    let sorted = keys
        .iter()
        .map(|&(_, index)| instances[index as usize].clone());
    *instances = sorted.collect();
}

/// The lowest 21 bits, two zeros before each.
fn spread(cell: u64) -> u64 {
    let mut bits = cell & 0x1f_ffff;
    bits = (bits | bits << 32) & 0x001f_0000_0000_ffff;
    bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
    bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
    bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
    (bits | bits << 2) & 0x1249_2492_4924_9249
}

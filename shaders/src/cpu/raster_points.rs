//! Points to the visbuffer. Twin of `wgsl/raster_points.wgsl`.

use super::fetch_vertex::visbuffer_word;
use crate::types::{ClusterItem, POINT_FLAG};

/// Draws `points` over a visbuffer. Their ids count down from the last of `capacity` visible items.
pub fn raster_points(visbuffer: &mut [u64], points: &[ClusterItem], capacity: u32) {
    for (index, item) in (0..).zip(points) {
        let depth = f32::from_bits(item.page_word);
        let word = visbuffer_word(depth, capacity - 1 - index, 0);
        let pixel = &mut visbuffer[(item.page & !POINT_FLAG) as usize];
        *pixel = word.max(*pixel);
    }
}

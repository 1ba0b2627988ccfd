//! Twins of the passes: the same f32 operations in the same order, over slices instead of bindings.

pub mod barycentric;
pub mod compact_requests;
pub mod cull_clusters;
pub mod cull_instances;
pub mod cull_nodes;
pub mod cut;
pub mod cut_brute;
pub mod error_metric;
pub mod false_color;
pub mod fetch_vertex;
pub mod hash;
pub mod hzb;
pub mod light;
pub mod mask_cutoffs;
pub mod mip_rows;
pub mod occlusion;
pub mod prepare;
pub mod proxy;
pub mod raster;
pub mod raster_choice;
pub mod raster_points;
pub mod sample_texture;
pub mod scan;
pub mod shade;
pub mod snap;
pub mod srgb;
pub mod surface;
pub mod texture;
pub mod transcode;
pub mod view;
pub mod visit;

pub use cut::{Culled, cut, cut_early, cut_late, requests_only};
pub use cut_brute::{cut_brute, requests_brute};
pub use hzb::Hzb;
pub use mip_rows::MipRows;
pub use occlusion::Occluder;
pub use raster::{needs_masked, raster, raster_masked, raster_overdraw};
pub use raster_points::raster_points;
pub use shade::{rounding_px, shade};
pub use texture::{Layout, Mips, Textures, build_textures, mip_chain};
pub use transcode::transcode;
pub use view::{Camera, CameraError, Capacities, near_for_radius};

/// Appends as the passes do: nothing is written past the capacity, and the count keeps counting.
fn append<T>(list: &mut Vec<T>, item: T, count: &mut u32, capacity: u32) {
    if *count < capacity {
        list.push(item);
    }
    *count += 1;
}

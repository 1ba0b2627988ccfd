//! Twin of `wgsl/shared/error_metric.wgsl` and `wgsl/shared/refine.wgsl`.

use glam::Vec3;
use lodestream_format::Sphere;
use lodestream_format::hierarchy::{Group, ROOT_ERROR};

use super::view::{cross3, dot3, rel_from_local, sum3};
use crate::types::{InstanceRecord, NOT_INSTALLED, View};

/// Share of the lod sphere's largest coordinate by which each level counts as nearer. It outweighs rounding, so that a
/// coarser group's projected error never comes out below a finer one's.
pub const LEVEL_SLACK: f32 = 1.0 / (1 << 18) as f32;
/// The level that hierarchy nodes count as: above every group's.
pub const NODE_LEVEL: f32 = 65.0;
/// Least error of a request, pixels.
pub const SMALLEST_REQUEST_PX: f32 = 1e-30;
/// Largest error of a request for anything but a root group, pixels.
pub const LARGEST_REQUEST_PX: f32 = 1e29;
/// Error of a request for root groups, pixels.
pub const ROOT_REQUEST_PX: f32 = 1e30;
/// Units of [`RequestRecord::priority`](crate::types::RequestRecord::priority) in a pixel.
pub const PRIORITY_UNITS_A_PX: f32 = 64.0;
/// Where the sum of a priority's units ends.
pub const MOST_PRIORITY: u32 = u32::MAX;

/// Most pixels by which a visible surface in the lod sphere (local metres) moves when it moves by
/// `error_metres` (local) in any direction. The WGSL has the proof.
pub fn projected_error_px(
    view: &View,
    instance: &InstanceRecord,
    lod_sphere: Sphere,
    error_metres: f32,
    level: f32,
) -> f32 {
    let center = rel_from_local(instance, view, Vec3::from(lod_sphere.center));
    let radius = lod_sphere.radius * instance.max_scale;
    let slack = level * LEVEL_SLACK;
    let reach = radius + slack * (sum3(center.abs()) + 2.0 * radius);
    let forward = Vec3::from(view.forward);
    let nearest = dot3(forward, center) - reach;
    let depth = nearest.max(view.near_metres);
    let across = cross3(forward, center) / depth;
    let tangent = dot3(across, across).sqrt() + reach / depth;
    let secant = (1.0 + tangent * tangent).sqrt().min(view.corner_secant);
    let moved = error_metres * instance.max_scale * (1.0 + slack);
    moved * view.pixels_at_one_metre * secant / (nearest - moved).max(view.near_metres)
}

/// Whether the pixel error asks for more detail than a group's coarser replacement has.
pub fn error_wanted(view: &View, error_metres: f32, projected_px: f32) -> bool {
    view.is_reference() || error_metres >= ROOT_ERROR || projected_px > view.pixel_error_px
}

/// Bits of the error of a streaming request: they order as the errors do and are never zero.
#[allow(
    clippy::manual_clamp,
    reason = "not a number has to become the smallest; `clamp` would keep it"
)]
pub fn request_bits(error_metres: f32, projected_px: f32) -> u32 {
    if error_metres >= ROOT_ERROR {
        ROOT_REQUEST_PX.to_bits()
    } else {
        projected_px
            .max(SMALLEST_REQUEST_PX)
            .min(LARGEST_REQUEST_PX)
            .to_bits()
    }
}

/// Share of one group of one instance in the priority of its pages, at most the picture's width and
/// height; never zero.
#[allow(
    clippy::manual_clamp,
    reason = "not a number has to become the smallest; `clamp` would keep it"
)]
pub fn priority_units(error_metres: f32, projected_px: f32, size_px: [u32; 2]) -> u32 {
    let most_px = (size_px[0] + size_px[1]) as f32;
    let px = match error_metres >= ROOT_ERROR {
        true => most_px,
        false => projected_px.max(0.0).min(most_px),
    };
    ((px * PRIORITY_UNITS_A_PX) as u32).max(1)
}

/// The words of a page's request: the bits of the largest error of any visible group, the
/// saturating sum of their units, and the bits of the largest error of any hidden group.
pub type RequestWords = [u32; 3];

/// Adds what one visible group of one instance asks of a page.
pub fn add_request(words: &mut RequestWords, error_bits: u32, units: u32) {
    words[0] = words[0].max(error_bits);
    words[1] = words[1].saturating_add(units);
}

/// Adds what one hidden group of one instance asks of a page.
pub fn add_hidden_request(words: &mut RequestWords, error_bits: u32) {
    words[2] = words[2].max(error_bits);
}

/// Whether all pages of a group are installed; `page_base` is its asset's first page.
pub fn group_installed(page_table: &[u32], group: &Group, page_base: u32) -> bool {
    group
        .pages()
        .all(|page| page_table[(page_base + page) as usize] != NOT_INSTALLED)
}

/// Projected error of what would replace the group, taken as of `level`.
pub fn group_projected_px(
    view: &View,
    group: &Group,
    instance: &InstanceRecord,
    level: f32,
) -> f32 {
    projected_error_px(
        view,
        instance,
        group.lod_sphere(),
        group.parent_error_metres,
        level,
    )
}

/// The one refinement predicate: whether the clusters of a group replace what is coarser.
pub fn refine(
    view: &View,
    page_table: &[u32],
    group: &Group,
    instance: &InstanceRecord,
    page_base: u32,
) -> bool {
    let projected_px = group_projected_px(view, group, instance, group.level as f32);
    error_wanted(view, group.parent_error_metres, projected_px)
        && group_installed(page_table, group, page_base)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::cpu::view::Camera;

    fn instance(linear: [f32; 9], translation: [f32; 3], max_scale: f32) -> InstanceRecord {
        InstanceRecord {
            translation_high: translation,
            asset: 0,
            translation_low: [0.0; 3],
            max_scale,
            linear_x: [linear[0], linear[1], linear[2]],
            mirrored: 0,
            linear_y: [linear[3], linear[4], linear[5]],
            spare_0: 0,
            linear_z: [linear[6], linear[7], linear[8]],
            proxy: 0,
        }
    }

    const IDENTITY: [f32; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    fn view(eye: [f64; 3], near_metres: f32) -> View {
        view_of(eye, 60.0, near_metres)
    }

    fn view_of(eye: [f64; 3], fov_y_degrees: f64, near_metres: f32) -> View {
        let camera = Camera {
            eye: eye.into(),
            target: glam::DVec3::ZERO,
            up: glam::DVec3::Y,
            fov_y_degrees,
            size_px: [800, 600],
        };
        camera.view(near_metres, 1.0)
    }

    #[test]
    fn a_metre_at_ten_metres() {
        let view = view([0.0, 0.0, 10.0], 0.01);
        let point = Sphere::default();
        let px = |error_metres: f32, scale: f32| {
            let instance = instance(IDENTITY, [0.0; 3], scale);
            projected_error_px(&view, &instance, point, error_metres, 0.0)
        };
        // A metre towards the eye leaves nine.
        let expected = 300.0 / 30f32.to_radians().tan() / 9.0;
        assert!((px(1.0, 1.0) - expected).abs() < 1e-3, "{}", px(1.0, 1.0));
        assert_eq!(px(1.0, 2.0), px(2.0, 1.0));
    }

    #[test]
    fn a_metre_in_the_corner_covers_more_and_nothing_beyond_the_corner_counts() {
        let view = view([0.0, 0.0, 10.0], 0.01);
        let px = |x: f32| {
            let instance = instance(IDENTITY, [x, 0.0, 0.0], 1.0);
            projected_error_px(&view, &instance, Sphere::default(), 1e-3, 0.0)
        };
        // Ten metres aside at ten metres' depth: 45 degrees.
        assert!((px(10.0) / px(0.0) - 2f32.sqrt().min(view.corner_secant)).abs() < 1e-4);
        let half_y = 30f32.to_radians().tan();
        let corner = (1.0 + half_y.powi(2) * (1.0 + (4f32 / 3.0).powi(2))).sqrt();
        assert!((px(1e5) / px(0.0) - corner).abs() < 1e-4);
    }

    #[test]
    fn requests_order_and_are_never_zero() {
        let px = [f32::NAN, -1.0, 0.0, 1e-20, 1.0, 2.0, 1e20, f32::INFINITY];
        let bits = px.map(|px| request_bits(1.0, px));
        assert!(bits.is_sorted() && bits[0] > 0);
        assert!(request_bits(ROOT_ERROR, 0.0) > bits[7]);
        let units = px.map(|px| priority_units(1.0, px, [800, 600]));
        assert_eq!(units, [1, 1, 1, 1, 64, 128, 1400 * 64, 1400 * 64]);
        assert_eq!(priority_units(ROOT_ERROR, 0.0, [800, 600]), 1400 * 64);
    }

    /// The steps of `request_pages` in `cull_nodes.wgsl`, taken by many threads in any order: an
    /// addition that wraps, then, any time later, the maximum of the thread whose addition wrapped.
    #[test]
    fn guarded_additions_saturate_in_any_order() {
        let hash = super::super::hash::hash;
        let (mut saturated, mut exact) = (0, 0);
        for case in 0..2000u32 {
            let chance = |step: u32| hash(case.wrapping_mul(0x9e37_79b9) ^ step);
            let size = chance(0) >> (chance(1) % 32);
            let units: Vec<u32> = (0..40)
                .map(|at| (chance(2 + at) % size.max(1)).max(1))
                .collect();
            let mut words = [0; 3];
            units
                .iter()
                .for_each(|&units| add_request(&mut words, 1, units));
            let (mut word, mut next, mut waiting) = (0u32, 0, 0);
            for step in 100.. {
                let adds = next < units.len() && (waiting == 0 || chance(step) % 3 != 0);
                if adds {
                    waiting += u32::from(word > MOST_PRIORITY - units[next]);
                    word = word.wrapping_add(units[next]);
                    next += 1;
                } else if waiting > 0 {
                    word = MOST_PRIORITY;
                    waiting -= 1;
                } else {
                    break;
                }
            }
            assert_eq!(word, words[1], "case {case}");
            match word {
                MOST_PRIORITY => saturated += 1,
                _ => exact += 1,
            }
        }
        assert!(saturated > 50 && exact > 50, "{saturated} {exact}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        /// However bad the cancellation: the sphere and error of a higher level, around those of a lower one, never
        /// project to less. Otherwise both levels of one surface would be drawn. The spheres touch where they are nearest
        /// to the eye, so that only rounding decides.
        #[test]
        fn coarser_never_projects_to_less(
            center in prop::array::uniform3(-1e3f32..1e3),
            radius in 0f32..1e3,
            shift in prop::sample::select(vec![1e-7, 1e-4, 1.0, 300.0]),
            part in 0f64..1.0,
            level in 0u32..63,
            eye in prop::array::uniform3(-5e3f64..5e3),
            near in prop::sample::select(vec![1e-6f32, 1e-3, 0.05]),
            scale in prop::sample::select(vec![1.0f32, 0.3, 7.7]),
            translation in prop::array::uniform3(-1e7f32..1e7),
        ) {
            prop_assume!(glam::DVec3::from(eye).length() > 1.0);
            let mut view = view(eye, near);
            // The eye near the instance, wherever that is.
            view.eye_high = std::array::from_fn(|axis| translation[axis] + eye[axis] as f32);
            let instance = instance(IDENTITY.map(|value| value * scale), translation, scale);
            let inner = Sphere { center, radius };
            let center: [f32; 3] = std::array::from_fn(|axis| center[axis] + (view.forward[axis] as f64 * shift * part) as f32);
            let distance = (0..3).map(|axis| (center[axis] as f64 - inner.center[axis] as f64).powi(2)).sum::<f64>().sqrt();
            let outer = Sphere { center, radius: lodestream_format::bounds::round_up(distance + radius as f64) };
            prop_assert!(outer.contains(&inner));
            let fine = projected_error_px(&view, &instance, inner, 0.01, level as f32);
            let coarse = projected_error_px(&view, &instance, outer, 0.01, (level + 1) as f32);
            prop_assert!(coarse >= fine, "{} {}", coarse, fine);
        }

        /// The same for any sphere around any other, in any direction of any lens.
        #[test]
        fn enclosing_never_projects_to_less(
            center in prop::array::uniform3(-1f32..1.0),
            toward in prop::array::uniform3(-1f64..1.0),
            inner_radius in -6f32..0.0,
            shift in -6f64..0.5,
            size in -6i32..7,
            level in 0u32..63,
            eye in prop::array::uniform3(-3f64..3.0),
            fov_y_degrees in 0.01f64..179.0,
            error in -6f32..0.0,
            error_grows in prop::sample::select(vec![1f32, 1.0, 1.5]),
        ) {
            prop_assume!(glam::DVec3::from(toward).length() > 0.1);
            let size = 10f64.powi(size);
            let view = view_of(eye.map(|axis| axis * size), fov_y_degrees, 1e-5 * size as f32);
            let instance = instance(IDENTITY, [0.0; 3], 1.0);
            let inner = Sphere {
                center: center.map(|axis| axis * size as f32),
                radius: 10f32.powf(inner_radius) * size as f32,
            };
            let step = glam::DVec3::from(toward).normalize() * 10f64.powf(shift) * size;
            let center: [f32; 3] =
                std::array::from_fn(|axis| inner.center[axis] + step[axis] as f32);
            let moved = std::array::from_fn(|axis| center[axis] as f64 - inner.center[axis] as f64);
            let distance = glam::DVec3::from_array(moved).length();
            let radius = lodestream_format::bounds::round_up(distance + inner.radius as f64);
            let outer = Sphere { center, radius };
            prop_assert!(outer.contains(&inner));
            let error = 10f32.powf(error) * size as f32;
            let fine = projected_error_px(&view, &instance, inner, error, level as f32);
            let coarser = error * error_grows;
            let coarse = projected_error_px(&view, &instance, outer, coarser, (level + 1) as f32);
            prop_assert!(coarse >= fine, "{} {}", coarse, fine);
        }
    }
}

//! Twin of `wgsl/shared/error_metric.wgsl` and `wgsl/shared/refine.wgsl`.

use glam::Vec3;
use lodestream_format::Sphere;
use lodestream_format::hierarchy::{Group, ROOT_ERROR};

use super::view::{dot3, rel_from_local, sum3};
use crate::types::{InstanceRecord, NOT_INSTALLED, View};

/// Share of the lod sphere's largest coordinate by which each level counts as nearer. It outweighs rounding, so that a
/// coarser group's projected error never comes out below a finer one's.
pub const LEVEL_SLACK: f32 = 1.0 / (1 << 20) as f32;
/// The level that hierarchy nodes count as: above every group's.
pub const NODE_LEVEL: f32 = 65.0;
/// Least priority of a request, pixels.
pub const SMALLEST_PRIORITY_PX: f32 = 1e-30;
/// Largest priority of a request for anything but a root group, pixels.
pub const LARGEST_PRIORITY_PX: f32 = 1e29;
/// Priority of root groups, pixels.
pub const ROOT_PRIORITY_PX: f32 = 1e30;

/// Pixels that `error_metres` (local) covers at the nearest depth of the lod sphere (local metres).
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
    let nearest = dot3(Vec3::from(view.forward), center)
        - radius
        - slack * (sum3(center.abs()) + 2.0 * radius);
    let depth = nearest.max(view.near_metres);
    error_metres * instance.max_scale * (1.0 + slack) * view.pixels_at_one_metre / depth
}

/// Whether the pixel error asks for more detail than a group's coarser replacement has.
pub fn error_wanted(view: &View, error_metres: f32, projected_px: f32) -> bool {
    view.is_reference() || error_metres >= ROOT_ERROR || projected_px > view.pixel_error_px
}

/// Bits of a streaming request's priority: they order as the priorities do and are never zero.
#[allow(
    clippy::manual_clamp,
    reason = "not a number has to become the smallest; `clamp` would keep it"
)]
pub fn priority_bits(error_metres: f32, projected_px: f32) -> u32 {
    if error_metres >= ROOT_ERROR {
        ROOT_PRIORITY_PX.to_bits()
    } else {
        projected_px
            .max(SMALLEST_PRIORITY_PX)
            .min(LARGEST_PRIORITY_PX)
            .to_bits()
    }
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
            spare_1: 0,
        }
    }

    const IDENTITY: [f32; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    fn view(eye: [f64; 3], near_metres: f32) -> View {
        let camera = Camera {
            eye: eye.into(),
            target: glam::DVec3::ZERO,
            up: glam::DVec3::Y,
            fov_y_degrees: 60.0,
            size_px: [800, 600],
        };
        camera.view(near_metres, 1.0)
    }

    #[test]
    fn a_metre_at_ten_metres() {
        let view = view([0.0, 0.0, 10.0], 0.01);
        let point = Sphere::default();
        let px = projected_error_px(&view, &instance(IDENTITY, [0.0; 3], 1.0), point, 1.0, 0.0);
        assert!(
            (px - 300.0 / 30f32.to_radians().tan() / 10.0).abs() < 1e-3,
            "{px}"
        );
        let twice = projected_error_px(&view, &instance(IDENTITY, [0.0; 3], 2.0), point, 1.0, 0.0);
        assert_eq!(twice, 2.0 * px);
    }

    #[test]
    fn priorities_order_and_are_never_zero() {
        let px = [f32::NAN, -1.0, 0.0, 1e-20, 1.0, 2.0, 1e20, f32::INFINITY];
        let bits = px.map(|px| priority_bits(1.0, px));
        assert!(bits.is_sorted() && bits[0] > 0);
        assert!(priority_bits(ROOT_ERROR, 0.0) > bits[7]);
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
    }
}

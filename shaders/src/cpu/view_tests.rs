//! Tests of the camera and the frustum.

use glam::{DVec4, Mat4, Vec4};
use proptest::prelude::*;

use super::*;

fn camera(eye: DVec3, target: DVec3, up: DVec3) -> Camera {
    Camera {
        eye,
        target,
        up,
        fov_y_degrees: 50.0,
        size_px: [640, 480],
    }
}

fn vector(scale: f64) -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-scale..scale).prop_map(DVec3::from)
}

/// Clip coordinates of a world point, through f32 relative space as the passes go.
fn clip(view: &View, eye: DVec3, world: DVec3) -> DVec4 {
    let rel = (world - eye).as_vec3();
    (Mat4::from_cols_array_2d(&view.clip_from_rel) * Vec4::from((rel, 1.0))).as_dvec4()
}

#[test]
fn target_is_the_middle_and_up_is_up() {
    let camera = camera(
        DVec3::new(1e7, 2.0, 3.0),
        DVec3::new(1e7, 2.0, -7.0),
        DVec3::Y,
    );
    let view = camera.view(0.05, 1.0);
    let middle = clip(&view, camera.eye, camera.target);
    assert!(middle.x.abs() < 1e-6 && middle.y.abs() < 1e-6);
    assert!((middle.w - 10.0).abs() < 1e-6, "w is the depth");
    assert!(
        (middle.z / middle.w - 0.005).abs() < 1e-8,
        "reversed depth near / z"
    );
    let above = clip(&view, camera.eye, camera.target + DVec3::Y);
    assert!(above.y > 0.0 && above.x.abs() < 1e-6);
    let right = clip(&view, camera.eye, camera.target + DVec3::X);
    assert!(right.x > 0.0 && right.y.abs() < 1e-6);
}

#[test]
fn pixels_at_one_metre_are_what_the_projection_covers() {
    let camera = camera(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y);
    let view = camera.view(0.01, 1.0);
    let [low, high] = [0.0, 1.0].map(|y| clip(&view, camera.eye, DVec3::new(0.0, y, -1.0)).y);
    let pixels = (high - low) * 0.5 * 480.0;
    assert!((pixels - view.pixels_at_one_metre as f64).abs() < 1e-3);
}

#[test]
fn degenerate_cameras_still_have_axes() {
    let nan = DVec3::splat(f64::NAN);
    let cases = [
        (DVec3::ONE, DVec3::ONE, DVec3::Y, "target"),
        (DVec3::ZERO, DVec3::Y, DVec3::Y, "up"),
        (DVec3::ZERO, DVec3::Z * 1e-300, DVec3::Z, "up"),
        (DVec3::ZERO, DVec3::X, DVec3::ZERO, "up"),
        (DVec3::ZERO, nan, DVec3::Y, "target"),
        (DVec3::ZERO, DVec3::X, nan, "up"),
    ];
    for (eye, target, up, field) in cases {
        let camera = camera(eye, target, up);
        let [right, up, forward] = camera.axes();
        for (a, b, dot) in [
            (right, right, 1.0),
            (up, up, 1.0),
            (forward, forward, 1.0),
            (right, up, 0.0),
            (right, forward, 0.0),
            (up, forward, 0.0),
        ] {
            assert!((a.dot(b) - dot).abs() < 1e-12, "{camera:?}");
        }
        assert_eq!(camera.check().map_err(|error| error.field), Err(field));
    }
    let extreme = Camera {
        fov_y_degrees: f64::NAN,
        size_px: [0, 0],
        ..camera(DVec3::ZERO, DVec3::X, DVec3::Y)
    };
    let view = extreme.view(0.0, 1.0);
    assert!(view.near_metres > 0.0 && view.size_px == [1, 1]);
    assert!(
        view.clip_from_rel
            .iter()
            .flatten()
            .all(|value| value.is_finite())
    );
    assert_eq!(extreme.check().map_err(|error| error.field), Err("fov"));
}

#[test]
fn near_follows_small_scenes_and_stops_at_five_centimetres() {
    assert_eq!(near_for_radius(1e7), 0.05);
    assert_eq!(near_for_radius(1.0), 1e-4);
    assert!(near_for_radius(1e-9) > 0.0 && near_for_radius(0.0) > 0.0);
}

proptest! {
    #[test]
    fn framing_shows_the_whole_sphere(center in vector(1e6), radius in 1e-6f64..1e6, width in 1u32..3000, height in 1u32..3000, around in vector(1.0)) {
        prop_assume!(around.length() > 1e-3);
        let camera = Camera::framing(center, radius, [width, height]);
        prop_assert_eq!(camera.check(), Ok(()));
        let view = camera.view(near_for_radius(radius), 1.0);
        let seen = clip(&view, camera.eye, center + around.normalize() * radius);
        prop_assert!(seen.w > view.near_metres as f64);
        prop_assert!(seen.x.abs() <= seen.w && seen.y.abs() <= seen.w, "{:?}", seen);
    }

    /// The planes and the projection agree on which points are inside, but for a sliver along the border.
    #[test]
    fn planes_bound_what_the_projection_shows(eye in vector(1e5), target in vector(1e5), offset in vector(100.0)) {
        let camera = camera(eye, target, DVec3::Y);
        prop_assume!(camera.check().is_ok());
        let view = camera.view(0.05, 1.0);
        let seen = clip(&view, eye, eye + offset);
        let margin = [seen.w - seen.x.abs(), seen.w - seen.y.abs(), seen.w - 0.05].into_iter().fold(f64::MAX, f64::min);
        let rel = offset.as_vec3();
        let inside = view.planes_in_rel.iter().all(|plane| dot3(Vec3::new(plane[0], plane[1], plane[2]), rel) + plane[3] >= 0.0);
        prop_assert!(margin.abs() < 1e-3 || inside == (margin > 0.0), "{} {}", margin, inside);
    }

    /// A point of a box inside the frustum means that the box passes, under any linear map.
    #[test]
    fn frustum_test_is_conservative(
        linear in prop::array::uniform9(-3f32..3.0),
        corner in prop::array::uniform3(-10f32..10.0),
        size in prop::array::uniform3(0f32..5.0),
        part in prop::array::uniform3(0f32..=1.0),
        eye in vector(30.0),
        far in vector(1e7),
    ) {
        let (translation_high, translation_low) = split(far);
        let instance = InstanceRecord {
            translation_high, asset: 0, translation_low, max_scale: 9.0,
            linear_x: [linear[0], linear[1], linear[2]], mirrored: 0,
            linear_y: [linear[3], linear[4], linear[5]], spare_0: 0,
            linear_z: [linear[6], linear[7], linear[8]], proxy: 0,
        };
        let camera = camera(far + eye, far, DVec3::Y);
        prop_assume!(camera.check().is_ok());
        let view = camera.view(0.05, 1.0);
        let point = std::array::from_fn(|axis| corner[axis] + part[axis] * size[axis]);
        let seen = clip(&view, camera.eye, instance.world_from_local(Vec3::from(point).as_dvec3()));
        let inside = seen.w >= 0.05 + 1e-4 && seen.x.abs() <= seen.w - 1e-4 && seen.y.abs() <= seen.w - 1e-4;
        let corner_max = std::array::from_fn(|axis| corner[axis] + size[axis]);
        let passes = aabb_in_frustum(&instance, &view, corner, corner_max, CLUSTER_SLACK);
        prop_assert!(passes || !inside);
    }
}

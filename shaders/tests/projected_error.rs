//! The projected error against geometry in f64: no point of the picture moves by more pixels.

mod dag;

use dag::Random;
use glam::{DVec2, DVec3};
use lodestream_format::Sphere;
use lodestream_shaders::cpu::Camera;
use lodestream_shaders::cpu::error_metric::projected_error_px;
use lodestream_shaders::types::InstanceRecord;

const NEAR_METRES: f32 = 0.01;
const CASES: usize = 4000;
const POINTS: usize = 40;
/// Directions in the plane of the axis and the point, in which the worst one lies, and others.
const DIRECTIONS: usize = 48;
/// Pixels are compared after f32 arithmetic.
const ROUNDING: f64 = 1e-5;

/// A pinhole picture in f64.
struct Picture {
    camera: Camera,
    axes: [DVec3; 3],
    pixels_at_one_metre: f64,
}

impl Picture {
    fn new(camera: Camera) -> Self {
        let half_tangent = (0.5 * camera.fov_y_degrees).to_radians().tan();
        Self {
            axes: camera.axes(),
            pixels_at_one_metre: 0.5 * camera.size_px[1] as f64 / half_tangent,
            camera,
        }
    }

    /// Place from the middle of the picture, pixels; `None` before the near plane.
    fn place_px(&self, point: DVec3) -> Option<DVec2> {
        let [right, up, forward] = self.axes;
        let rel = point - self.camera.eye;
        let depth = rel.dot(forward);
        let place = DVec2::new(rel.dot(right), rel.dot(up)) * (self.pixels_at_one_metre / depth);
        (depth >= NEAR_METRES as f64).then_some(place)
    }

    fn shows(&self, place_px: DVec2) -> bool {
        let [width, height] = self.camera.size_px.map(|size| 0.5 * size as f64);
        place_px.x.abs() <= width && place_px.y.abs() <= height
    }
}

fn instance() -> InstanceRecord {
    let mut instance: InstanceRecord = bytemuck::Zeroable::zeroed();
    instance.max_scale = 1.0;
    (
        instance.linear_x[0],
        instance.linear_y[1],
        instance.linear_z[2],
    ) = (1.0, 1.0, 1.0);
    instance
}

fn random_camera(random: &mut Random) -> Camera {
    Camera {
        eye: random.vector(1.0),
        target: random.vector(10.0),
        up: DVec3::Y,
        fov_y_degrees: random.range(1.0, 170.0),
        size_px: [0, 0].map(|_| 100 + random.below(3000) as u32),
    }
}

/// A point of the ball, as often on its border as inside.
fn point_of(random: &mut Random, sphere: &Sphere) -> DVec3 {
    let reach = random.range(0.0, 2.0).min(1.0) * sphere.radius as f64;
    DVec3::from(sphere.center.map(f64::from)) + random.vector(1.0).normalize_or_zero() * reach
}

/// The largest distance in the picture by which `point` moves, of those moves that the picture
/// shows at one end or the other.
fn worst_move_px(random: &mut Random, picture: &Picture, point: DVec3, error: f64) -> Option<f64> {
    let from = picture.place_px(point)?;
    let [_, _, forward] = picture.axes;
    let rel = point - picture.camera.eye;
    let outward = (rel - forward * rel.dot(forward)).normalize_or(picture.axes[0]);
    let ends = (0..DIRECTIONS).filter_map(|number| {
        let turn = std::f64::consts::TAU * number as f64 / DIRECTIONS as f64;
        let (sine, cosine) = turn.sin_cos();
        let direction = match number % 4 {
            0 => random.vector(1.0).normalize_or_zero(),
            _ => outward * cosine + forward * sine,
        };
        let to = picture.place_px(point + direction * error)?;
        (picture.shows(from) || picture.shows(to)).then(|| from.distance(to))
    });
    ends.max_by(f64::total_cmp)
}

#[test]
fn no_point_of_the_picture_moves_by_more_pixels_than_the_metric_says() {
    let mut random = Random(2);
    let instance = instance();
    let mut used = Vec::new();
    for case in 0..CASES {
        let camera = random_camera(&mut random);
        let picture = Picture::new(camera);
        let distance = 10f64.powf(random.range(-1.0, 3.0));
        let center = camera.eye + random.vector(1.0).normalize_or_zero() * distance;
        let sphere = Sphere {
            center: center.as_vec3().to_array(),
            radius: (distance * 10f64.powf(random.range(-3.0, 0.2))) as f32,
        };
        let error = (distance * 10f64.powf(random.range(-5.0, -0.3))) as f32;
        let view = camera.view(NEAR_METRES, 1.0);
        let said_px = projected_error_px(&view, &instance, sphere, error, 0.0) as f64;
        let moves = (0..POINTS).filter_map(|_| {
            let point = point_of(&mut random, &sphere);
            worst_move_px(&mut random, &picture, point, error as f64)
        });
        let Some(most_px) = moves.max_by(f64::total_cmp) else {
            continue;
        };
        assert!(
            most_px <= said_px * (1.0 + ROUNDING),
            "case {case}: {most_px} px, {said_px} px said: {camera:?} {sphere:?} error {error}"
        );
        // How tight it is depends on how large the sphere is for its distance.
        if sphere.radius as f64 <= 0.1 * distance {
            used.push(most_px / said_px);
        }
    }
    used.sort_by(f64::total_cmp);
    let share = |part: f64| used[(part * used.len() as f64) as usize];
    println!(
        "{} of {CASES} spheres in the picture and small for their distance: {:.3} of the said pixels \
         are used at the median, {:.3} at the tenth",
        used.len(),
        share(0.5),
        share(0.1)
    );
    assert!(used.len() > CASES / 20, "{} cases", used.len());
    assert!(share(0.5) > 0.8, "median {}", share(0.5));
}

/// The metric of before: the depth alone. It has to fail where the new one holds, else the test
/// above tests nothing.
#[test]
fn depth_alone_falls_short_in_the_corner() {
    let mut random = Random(5);
    let camera = Camera {
        eye: DVec3::ZERO,
        target: DVec3::NEG_Z,
        up: DVec3::Y,
        fov_y_degrees: 120.0,
        size_px: [1600, 900],
    };
    let picture = Picture::new(camera);
    let corner = DVec3::new(3.0, 1.7, -1.0) * 100.0;
    let (error, depth) = (0.01, 100.0);
    let most_px = worst_move_px(&mut random, &picture, corner, error).expect("in the picture");
    let by_depth_px = error * picture.pixels_at_one_metre / depth;
    assert!(most_px > 3.4 * by_depth_px, "{most_px} {by_depth_px}");
}

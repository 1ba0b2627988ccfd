//! The projected error against geometry in f64: random points of a sphere are moved by the error in
//! the worst direction, and the picture tells how many pixels they move.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use lodestream_format::Sphere;
use lodestream_shaders::cpu::Camera;
use lodestream_shaders::cpu::error_metric::projected_error_px;
use lodestream_shaders::types::InstanceRecord;

use super::claims::Claim;
use crate::samples::number::Random;

/// Fields of view of the rows, degrees from the picture's bottom to its top.
const FIELDS_OF_VIEW: [[f64; 2]; 4] = [[1.0, 10.0], [10.0, 60.0], [60.0, 120.0], [120.0, 170.0]];
const SPHERES: usize = 4000;
const POINTS: usize = 16;
const DIRECTIONS: usize = 32;
const NEAR_METRES: f32 = 0.01;
/// f32 arithmetic of the metric, as a share.
const ROUNDING: f64 = 1e-5;
/// Largest radius, as a share of the distance, of the spheres that tell how tight the metric is.
const SMALL_SPHERE: f64 = 0.02;

/// A row a range of fields of view.
pub(super) fn claims() -> Vec<Claim> {
    FIELDS_OF_VIEW.into_iter().map(claim).collect()
}

fn claim([narrow, wide]: [f64; 2]) -> Claim {
    let mut random = Random::new(16, narrow as u64);
    let mut all = Vec::new();
    let mut small = Vec::new();
    for _ in 0..SPHERES {
        let camera = Camera {
            eye: somewhere(&mut random) * 1e3,
            target: somewhere(&mut random) * 1e3,
            up: DVec3::Y,
            fov_y_degrees: random.between(narrow, wide),
            size_px: [1920, 1080],
        };
        let picture = Pinhole::new(&camera);
        let place_px = DVec2::new(random.between(-960.0, 960.0), random.between(-540.0, 540.0));
        let depth = 10f64.powf(random.between(-1.0, 3.0));
        let at = camera.eye + picture.ray(place_px) * depth;
        let share = 10f64.powf(random.between(-4.0, 0.0));
        let sphere = Sphere {
            radius: (share * depth) as f32,
            ..Sphere::default()
        };
        let error = depth * 10f64.powf(random.between(-5.0, -1.0));
        let view = camera.view(NEAR_METRES, 1.0);
        let said_px = projected_error_px(&view, &instance(at), sphere, error as f32, 0.0);
        let moved_px = (0..POINTS)
            .map(|_| at + place_in(&mut random, &sphere))
            .map(|point| picture.worst_move_px(point, error))
            .fold(0.0, f64::max);
        let used = moved_px / f64::from(said_px);
        all.push(used);
        if share <= SMALL_SPHERE {
            small.push(used);
        }
    }
    let worst = all.iter().copied().fold(0.0, f64::max);
    let broken = all.iter().filter(|&&it| it > 1.0 + ROUNDING).count();
    small.sort_by(f64::total_cmp);
    Claim {
        case: format!("projected error, {narrow} to {wide} degrees"),
        reference: "points moved by the error in f64, any direction, 16:9".into(),
        expected: format!("{SPHERES} cameras, none moves by more pixels than said"),
        found: format!(
            "{broken} do, by {worst:.3} of the said pixels at most; small spheres use {:.3} at the \
             median",
            small.get(small.len() / 2).copied().unwrap_or(f64::NAN)
        ),
        holds: broken == 0,
    }
}

fn somewhere(random: &mut Random) -> DVec3 {
    DVec3::from([(); 3].map(|()| random.between(-1.0, 1.0)))
}

/// From the middle of the ball to a point of it, half of the time on its border.
fn place_in(random: &mut Random, sphere: &Sphere) -> DVec3 {
    let away = random.between(0.0, 2.0).min(1.0) * f64::from(sphere.radius);
    somewhere(random).normalize_or_zero() * away
}

/// The local origin at a place of the world.
fn instance(at: DVec3) -> InstanceRecord {
    let high = at.as_vec3();
    InstanceRecord {
        translation_high: high.to_array(),
        asset: 0,
        translation_low: (at - high.as_dvec3()).as_vec3().to_array(),
        max_scale: 1.0,
        linear_x: [1.0, 0.0, 0.0],
        mirrored: 0,
        linear_y: [0.0, 1.0, 0.0],
        spare_0: 0,
        linear_z: [0.0, 0.0, 1.0],
        proxy: 0,
    }
}

/// A picture in f64.
struct Pinhole {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    pixels_at_one_metre: f64,
    half_px: DVec2,
}

impl Pinhole {
    fn new(camera: &Camera) -> Self {
        let [right, up, forward] = camera.axes();
        let half_px = DVec2::from(camera.size_px.map(f64::from)) / 2.0;
        Self {
            eye: camera.eye,
            right,
            up,
            forward,
            pixels_at_one_metre: half_px.y / (camera.fov_y_degrees / 2.0).to_radians().tan(),
            half_px,
        }
    }

    /// From the eye to the point of the picture, one metre deep.
    fn ray(&self, place_px: DVec2) -> DVec3 {
        let at = place_px / self.pixels_at_one_metre;
        self.forward + self.right * at.x + self.up * at.y
    }

    /// Pixels from the picture's middle; `None` before the near plane.
    fn place_px(&self, point: DVec3) -> Option<DVec2> {
        let rel = point - self.eye;
        let depth = rel.dot(self.forward);
        let across = DVec2::new(rel.dot(self.right), rel.dot(self.up));
        (depth >= f64::from(NEAR_METRES)).then(|| across * (self.pixels_at_one_metre / depth))
    }

    fn shows(&self, place_px: DVec2) -> bool {
        place_px.abs().cmple(self.half_px).all()
    }

    /// Most pixels between the point and where it is after a move of `metres`, one of both in the
    /// picture. The worst direction lies in the plane of the axis and the point.
    fn worst_move_px(&self, point: DVec3, metres: f64) -> f64 {
        let Some(from) = self.place_px(point) else {
            return 0.0;
        };
        let rel = point - self.eye;
        let outward = (rel - self.forward * rel.dot(self.forward)).normalize_or(self.right);
        let aside = outward.cross(self.forward);
        let mut worst = 0.0f64;
        for index in 0..DIRECTIONS {
            let (sine, cosine) = (TAU * index as f64 / DIRECTIONS as f64).sin_cos();
            let in_plane = outward * cosine + self.forward * sine;
            let off_plane = outward * cosine + aside * sine;
            for direction in [in_plane, off_plane] {
                if let Some(to) = self.place_px(point + direction * metres)
                    && (self.shows(from) || self.shows(to))
                {
                    worst = worst.max(from.distance(to));
                }
            }
        }
        worst
    }
}

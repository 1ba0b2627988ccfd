//! A virtual viewer: a camera over a scene, and the pages that the GPU would ask for, found by the CPU twins. No page and no
//! GPU is needed: requests depend on the hierarchy alone.

use glam::DVec3;
use lodestream_client::stream::{OpenedScene, StreamingRequest};
use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::{Camera, Capacities, near_for_radius, requests_only};

/// What a virtual viewer has to know of a scene; many viewers share one.
#[derive(Debug)]
pub struct ViewedScene {
    arrays: SceneArrays,
    center: DVec3,
    radius_metres: f64,
    near_metres: f32,
}

impl ViewedScene {
    /// Flattens an opened scene.
    pub fn new(scene: &OpenedScene) -> Self {
        let assets = scene
            .assets
            .iter()
            .map(|opened| (&opened.asset, &opened.hierarchy));
        let arrays = SceneArrays::new(&scene.scene, assets);
        // A scene without instances is looked at as the unit sphere is: nothing will be wanted.
        let (center, radius_metres) = arrays.bounds_in_world().unwrap_or((DVec3::ZERO, 1.0));
        let near_metres = near_for_radius(radius_metres);
        Self {
            arrays,
            center,
            radius_metres,
            near_metres,
        }
    }

    /// The pages that `camera` wants at a pixel error, installed or not, by page number.
    pub fn requests(&self, camera: &Camera, pixel_error_px: f32) -> Vec<StreamingRequest> {
        let view = camera.view(self.near_metres, pixel_error_px);
        let view = view.with_scene(&self.arrays, Capacities::UNBOUNDED);
        let (records, _) = requests_only(&self.arrays, &view);
        records.iter().map(Into::into).collect()
    }
}

/// A seeded walk around a scene: an orbit that comes nearer and goes away again, each seed from another side at another
/// pace, so that viewers want different pages at different times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    center: DVec3,
    radius_metres: f64,
    start_turns: f64,
    turns_a_sec: f64,
    dives_a_sec: f64,
    elevation: f64,
    size_px: [u32; 2],
}

/// Pictures of virtual viewers, pixels.
pub const VIEWER_SIZE_PX: [u32; 2] = [1280, 720];
/// Angle of view of virtual viewers, degrees.
const FOV_Y_DEGREES: f64 = 50.0;

impl Orbit {
    /// The walk of viewer `seed` around `scene`.
    pub fn new(scene: &ViewedScene, seed: u64) -> Self {
        let share = |salt: u64| unit(seed.wrapping_mul(4).wrapping_add(salt));
        Self {
            center: scene.center,
            radius_metres: scene.radius_metres.max(f64::MIN_POSITIVE),
            start_turns: share(0),
            turns_a_sec: 0.01 + 0.03 * share(1),
            dives_a_sec: 0.03 + 0.05 * share(2),
            elevation: 0.1 + 0.4 * share(3),
            size_px: VIEWER_SIZE_PX,
        }
    }

    /// Where the viewer looks from after `secs` of walking.
    pub fn camera(&self, secs: f64) -> Camera {
        let turn = std::f64::consts::TAU * (self.start_turns + self.turns_a_sec * secs);
        // From 2.2 radii, where the scene fills the picture, down to 0.5, inside its bounds.
        let dive = 0.5 - 0.5 * (std::f64::consts::TAU * self.dives_a_sec * secs).cos();
        let distance = self.radius_metres * (2.2 - 1.7 * dive);
        let (sine, cosine) = turn.sin_cos();
        let outward = DVec3::new(cosine, self.elevation, sine).normalize();
        Camera {
            eye: self.center + outward * distance,
            target: self.center,
            up: DVec3::Y,
            fov_y_degrees: FOV_Y_DEGREES,
            size_px: self.size_px,
        }
    }
}

/// A number in 0..1 from a seed (SplitMix64; Steele, Lea and Flood, 2014).
fn unit(seed: u64) -> f64 {
    let mut bits = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orbits_differ_repeat_and_keep_their_distance() {
        let scene = ViewedScene {
            arrays: SceneArrays::default(),
            center: DVec3::new(1.0, 2.0, 3.0),
            radius_metres: 10.0,
            near_metres: 0.001,
        };
        let (first, second) = (Orbit::new(&scene, 1), Orbit::new(&scene, 2));
        assert_ne!(first.camera(0.0).eye, second.camera(0.0).eye);
        assert_eq!(first, Orbit::new(&scene, 1));
        for secs in 0..200 {
            let camera = first.camera(secs as f64);
            assert!(camera.check().is_ok());
            let distance = camera.eye.distance(camera.target);
            assert!((4.99..=22.01).contains(&distance), "{distance}");
        }
        assert!(scene.requests(&first.camera(0.0), 1.0).is_empty());
    }
}

//! How hands move the camera: orbit, pan, zoom, look, fly. Pixels in, a camera out; no window here.

use glam::{DQuat, DVec3};
use lodestream_shaders::cpu::Camera;

/// Radians a pixel of dragging.
const TURN: f64 = 0.006;
/// Share of the distance that a wheel's notch takes off.
const ZOOM: f64 = 0.12;
/// Cosine of the smallest angle between view and up.
const POLE: f64 = 0.995;

/// A camera with the point that it turns about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Navigation {
    camera: Camera,
    /// Metres a second of flight.
    speed: f64,
}

impl Navigation {
    /// Starts at `camera`, whose target is the pivot; `scene_radius` sets the speed of flight.
    pub fn new(camera: Camera, scene_radius: f64) -> Self {
        Self {
            camera,
            speed: scene_radius.max(1e-6) * 0.5,
        }
    }

    /// The camera for a picture of that size.
    pub fn camera(&self, size_px: [u32; 2]) -> Camera {
        Camera {
            size_px,
            ..self.camera
        }
    }

    /// Turns the eye about the target.
    pub fn orbit(&mut self, dx_px: f64, dy_px: f64) {
        let offset = self.camera.eye - self.camera.target;
        self.camera.eye = self.camera.target + self.turned(offset, -dx_px, -dy_px);
    }

    /// Turns the view about the eye.
    pub fn look(&mut self, dx_px: f64, dy_px: f64) {
        let offset = self.camera.target - self.camera.eye;
        self.camera.target = self.camera.eye + self.turned(offset, -dx_px, -dy_px);
    }

    /// Moves eye and target so that the target follows the pointer.
    pub fn pan(&mut self, dx_px: f64, dy_px: f64, height_px: u32) {
        let [right, up, _] = self.camera.axes();
        let distance = self.camera.eye.distance(self.camera.target);
        let half = (0.5 * self.camera.fov_y_degrees).to_radians().tan();
        let metres_a_pixel = 2.0 * distance * half / height_px.max(1) as f64;
        self.shift((up * dy_px - right * dx_px) * metres_a_pixel);
    }

    /// Towards the target (positive) or away from it, by notches of the wheel.
    pub fn zoom(&mut self, notches: f64) {
        let offset = self.camera.eye - self.camera.target;
        self.camera.eye = self.camera.target + offset * (1.0 - ZOOM).powf(notches);
    }

    /// Flies for `secs` along right, up and forward, each -1 to 1.
    pub fn fly(&mut self, along: [f64; 3], secs: f64) {
        let axes = self.camera.axes();
        let way = (0..3).fold(DVec3::ZERO, |way, axis| way + axes[axis] * along[axis]);
        self.shift(way * self.speed * secs);
    }

    /// Makes flight faster or slower.
    pub fn change_speed(&mut self, factor: f64) {
        self.speed = (self.speed * factor).clamp(1e-9, 1e12);
    }

    fn shift(&mut self, by: DVec3) {
        self.camera.eye += by;
        self.camera.target += by;
    }

    /// `offset` turned about up and then about right, never over the pole, where right would be undefined.
    fn turned(&self, offset: DVec3, dx_px: f64, dy_px: f64) -> DVec3 {
        let up = self.camera.up.normalize_or(DVec3::Y);
        let [right, ..] = self.camera.axes();
        let about_up = DQuat::from_axis_angle(up, dx_px * TURN);
        let turned = about_up * (DQuat::from_axis_angle(right, dy_px * TURN) * offset);
        let steep = turned.normalize_or(DVec3::Z).dot(up).abs() > POLE;
        if steep { about_up * offset } else { turned }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start() -> Navigation {
        let camera = Camera {
            eye: DVec3::new(0.0, 0.0, 5.0),
            target: DVec3::ZERO,
            up: DVec3::Y,
            fov_y_degrees: 60.0,
            size_px: [100, 100],
        };
        Navigation::new(camera, 2.0)
    }

    #[test]
    fn orbiting_keeps_the_distance_and_stops_below_the_pole() {
        let mut navigation = start();
        for _ in 0..1000 {
            navigation.orbit(13.0, 17.0);
            let camera = navigation.camera([1, 1]);
            assert!((camera.eye.distance(DVec3::ZERO) - 5.0).abs() < 1e-9);
            assert_eq!(camera.check(), Ok(()));
        }
    }

    #[test]
    fn hands_move_things_the_way_they_push() {
        // Dragging to the right turns the scene to the right: the eye goes left.
        let mut navigation = start();
        navigation.orbit(50.0, 0.0);
        assert!(navigation.camera([1, 1]).eye.x < 0.0);
        let mut navigation = start();
        navigation.pan(10.0, 0.0, 100);
        assert!(navigation.camera([1, 1]).target.x < 0.0);
        let mut navigation = start();
        navigation.zoom(1.0);
        assert!((navigation.camera([1, 1]).eye.z - 4.4).abs() < 1e-12);
        let mut navigation = start();
        navigation.fly([0.0, 0.0, 1.0], 2.0);
        assert!((navigation.camera([1, 1]).eye.z - 3.0).abs() < 1e-12);
        let mut navigation = start();
        navigation.look(10.0, 0.0);
        assert!(navigation.camera([1, 1]).target.x > 0.0);
    }
}

//! Cameras as users write them, and the camera that shows a whole scene.

use glam::DVec3;
use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::{Camera, near_for_radius};

use crate::subject::Subject;

/// Field of view of the camera that frames a scene, degrees: narrower than a window's, as product pictures are.
const FRAMING_FOV_DEGREES: f64 = 40.0;
/// Share of the picture that the framed scene leaves free at its edges.
const MARGIN: f64 = 0.04;

/// A camera that does not parse.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("camera {at}: expected {expected}, found {found}")]
pub struct CameraSyntaxError {
    /// The part.
    pub at: String,
    /// What may stand there.
    pub expected: &'static str,
    /// What stands there.
    pub found: String,
}

/// A camera without a picture: `eye=x,y,z;target=x,y,z;up=x,y,z;fov=DEG`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Where it stands, metres.
    pub eye: DVec3,
    /// The point that it looks at, metres.
    pub target: DVec3,
    /// Roughly upwards.
    pub up: DVec3,
    /// Angle of view from bottom to top, degrees.
    pub fov_degrees: f64,
}

impl Pose {
    /// The camera of a picture of that size.
    pub fn camera(&self, size_px: [u32; 2]) -> Camera {
        Camera {
            eye: self.eye,
            target: self.target,
            up: self.up,
            fov_y_degrees: self.fov_degrees,
            size_px,
        }
    }
}

impl From<&Camera> for Pose {
    fn from(camera: &Camera) -> Self {
        Self {
            eye: camera.eye,
            target: camera.target,
            up: camera.up,
            fov_degrees: camera.fov_y_degrees,
        }
    }
}

impl std::str::FromStr for Pose {
    type Err = CameraSyntaxError;

    /// `eye` and `target` must be there; `up` is +Y and `fov` 60 unless given.
    fn from_str(text: &str) -> Result<Self, CameraSyntaxError> {
        let wrong = |at: &str, expected, found: &str| CameraSyntaxError {
            at: at.to_owned(),
            expected,
            found: format!("{found:?}"),
        };
        let (mut eye, mut target) = (None, None);
        let (mut up, mut fov_degrees) = (DVec3::Y, 60.0);
        for part in text.split(';').filter(|part| !part.trim().is_empty()) {
            let (key, value) = part
                .split_once('=')
                .ok_or_else(|| wrong("part", "KEY=VALUE", part))?;
            let vector = || parse_vector(value).ok_or_else(|| wrong(key, "x,y,z", value));
            match key.trim() {
                "eye" => eye = Some(vector()?),
                "target" => target = Some(vector()?),
                "up" => up = vector()?,
                "fov" => {
                    fov_degrees = value
                        .trim()
                        .parse()
                        .map_err(|_| wrong(key, "degrees", value))?;
                }
                other => return Err(wrong("key", "eye, target, up or fov", other)),
            }
        }
        let pose = Self {
            eye: eye.ok_or_else(|| wrong("eye", "x,y,z", ""))?,
            target: target.ok_or_else(|| wrong("target", "x,y,z", ""))?,
            up,
            fov_degrees,
        };
        // Checked as the camera of any picture: the size is not the pose's.
        pose.camera([1, 1])
            .check()
            .map_err(|error| CameraSyntaxError {
                at: error.field.to_owned(),
                expected: error.expected,
                found: error.found,
            })?;
        Ok(pose)
    }
}

fn parse_vector(text: &str) -> Option<DVec3> {
    let mut numbers = text.split(',').map(|number| number.trim().parse().ok());
    let vector = DVec3::new(numbers.next()??, numbers.next()??, numbers.next()??);
    numbers.next().is_none().then_some(vector)
}

/// Shows the scene's subject as large as the picture allows: from the front right, a little above,
/// and from higher the wider it is for its height.
pub fn framing(subject: &Subject, size_px: [u32; 2]) -> Camera {
    let corners = &subject.corners;
    let Some((low, high)) = bounds(corners) else {
        return Camera::framing(DVec3::ZERO, 1.0, size_px);
    };
    let size = high - low;
    let wide = size.x.max(size.z).max(f64::MIN_POSITIVE);
    let flatness = (1.0 - size.y / wide).clamp(0.0, 1.0);
    let elevation = (14.0 + 22.0 * flatness).to_radians();
    // A scene that is deep for its width is looked at along its depth, so that it fills the picture.
    let azimuth = if size.x >= size.z { 32f64 } else { 58f64 }.to_radians();
    let back = DVec3::new(
        azimuth.sin() * elevation.cos(),
        elevation.sin(),
        azimuth.cos() * elevation.cos(),
    );
    let mut camera = Camera {
        eye: back,
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y_degrees: FRAMING_FOV_DEGREES,
        size_px,
    };
    let axes = camera.axes();
    let (eye, distance) = fit(corners, axes, size_px);
    camera.eye = eye;
    camera.target = eye + axes[2] * distance;
    camera
}

/// Eye and distance to the middle of the corners such that all lie inside the frustum and touch it: each of the four sides
/// asks the eye to stand behind a plane; opposite ones fix the sideways shift.
fn fit(corners: &[DVec3], [right, up, forward]: [DVec3; 3], size_px: [u32; 2]) -> (DVec3, f64) {
    let tan_y = (0.5 * FRAMING_FOV_DEGREES).to_radians().tan() * (1.0 - 2.0 * MARGIN);
    let tan_x = tan_y * size_px[0].max(1) as f64 / size_px[1].max(1) as f64;
    // With `a` sideways and `d` forwards, a corner is inside where |a - a_eye| <= (d - d_eye) tan.
    let along = |axis: DVec3, tan: f64| {
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for corner in corners {
            let (a, d) = (corner.dot(axis), corner.dot(forward));
            low = low.min(a + d * tan);
            high = high.max(a - d * tan);
        }
        // low >= a_eye + d_eye tan and high <= a_eye - d_eye tan, both with equality.
        (0.5 * (low + high), 0.5 * (low - high) / tan)
    };
    let (a_right, d_right) = along(right, tan_x);
    let (a_up, d_up) = along(up, tan_y);
    let depth = |pick: fn(f64, f64) -> f64, start: f64| {
        corners
            .iter()
            .map(|corner| corner.dot(forward))
            .fold(start, pick)
    };
    let (nearest, farthest) = (depth(f64::min, f64::MAX), depth(f64::max, f64::MIN));
    let size = (farthest - nearest).max(1e-9);
    let d_eye = d_right.min(d_up).min(nearest - 0.01 * size);
    let eye = right * a_right + up * a_up + forward * d_eye;
    (eye, 0.5 * (nearest + farthest) - d_eye)
}

fn bounds(corners: &[DVec3]) -> Option<(DVec3, DVec3)> {
    let first = *corners.first()?;
    let fold = |(low, high): (DVec3, DVec3), corner: &DVec3| (low.min(*corner), high.max(*corner));
    Some(corners.iter().fold((first, first), fold))
}

/// The near plane for a scene, metres: near enough for its subject.
pub fn near_metres(arrays: &SceneArrays, subject: &Subject) -> f32 {
    let whole = arrays.bounds_in_world().map_or(1.0, |(_, radius)| radius);
    near_for_radius(match subject.instances_outside {
        0 => whole,
        _ => subject.radius_metres,
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;
    use lodestream_shaders::types::{AssetRecord, InstanceRecord};

    #[test]
    fn a_pose_reads_what_the_contract_writes() {
        let pose: Pose = "eye=1,2.5,-3;target=0,0,0;up=0,0,1;fov=45".parse().unwrap();
        assert_eq!(pose.eye, DVec3::new(1.0, 2.5, -3.0));
        assert_eq!((pose.up, pose.fov_degrees), (DVec3::Z, 45.0));
        let short: Pose = "eye=0,0,5;target=0,0,0".parse().unwrap();
        assert_eq!((short.up, short.fov_degrees), (DVec3::Y, 60.0));
    }

    #[test]
    fn nonsense_is_named() {
        for (text, at) in [
            ("eye=1,2;target=0,0,0", "eye"),
            ("target=0,0,0", "eye"),
            ("eye=1,2,3;target=0,0,0;fov=wide", "fov"),
            ("eye=1,2,3;target=0,0,0;roll=3", "key"),
            ("eye=1,2,3;target=1,2,3", "target"),
            ("eye=0,5,0;target=0,0,0;up=0,1,0", "up"),
            ("nothing", "part"),
        ] {
            assert_eq!(text.parse::<Pose>().unwrap_err().at, at, "{text}");
        }
    }

    /// All corners inside the picture, and on each axis pair at least one near its edge: neither cut off nor lost in space.
    #[test]
    fn framing_fills_the_picture_and_cuts_nothing_off() {
        for half in [
            [1.0, 1.0, 1.0],
            [50.0, 0.5, 50.0],
            [0.01, 3.0, 0.01],
            [1.0, 1.0, 80.0],
        ] {
            for size_px in [[960, 540], [300, 900]] {
                let mut arrays = SceneArrays::default();
                let mut asset: AssetRecord = bytemuck::Zeroable::zeroed();
                (asset.aabb_min, asset.aabb_max) = (half.map(|axis: f32| -axis), half);
                let mut instance: InstanceRecord = bytemuck::Zeroable::zeroed();
                instance.translation_high = [1000.0, -20.0, 4.0];
                instance.linear_x = [1.0, 0.0, 0.0];
                instance.linear_y = [0.0, 1.0, 0.0];
                instance.linear_z = [0.0, 0.0, 1.0];
                arrays.assets.push(asset);
                arrays.instances.push(instance);
                let subject = Subject::new(&arrays);
                let camera = framing(&subject, size_px);
                assert_eq!(camera.check(), Ok(()));
                let axes = camera.axes();
                let tan_y = (0.5 * camera.fov_y_degrees).to_radians().tan();
                let tan_x = tan_y * size_px[0] as f64 / size_px[1] as f64;
                let mut reach: f64 = 0.0;
                for corner in &subject.corners {
                    let rel = corner - camera.eye;
                    let depth = rel.dot(axes[2]);
                    assert!(depth > 0.0);
                    let x = (rel.dot(axes[0]) / (depth * tan_x)).abs();
                    let y = (rel.dot(axes[1]) / (depth * tan_y)).abs();
                    reach = reach.max(x).max(y);
                }
                assert!(
                    (0.85..=1.0).contains(&reach),
                    "{half:?} {size_px:?} {reach}"
                );
            }
        }
    }
}

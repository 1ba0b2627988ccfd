//! Camera paths: keys over frames, smooth between them, read from JSON. Needs no GPU: virtual viewers walk them too.
//!
//! ```json
//! {"fps": 30, "frames": 120, "size": [960, 540],
//!  "keys": [{"frame": 0, "eye": [0, 1, 5], "target": [0, 1, 0], "up": [0, 1, 0], "fov_degrees": 50}]}
//! ```

use glam::DVec3;
use lodestream_shaders::cpu::Camera;

use crate::camera::Pose;

/// A path file that cannot be walked.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// Not readable.
    #[error("{file}: {source}")]
    Read {
        /// The file.
        file: String,
        /// The system's words.
        source: std::io::Error,
    },
    /// Not the JSON that is expected.
    #[error("{file}: {source}")]
    Syntax {
        /// The file.
        file: String,
        /// Line, column and what was expected.
        source: serde_json::Error,
    },
    /// Readable, but no path.
    #[error("{file}: {at}: expected {expected}, found {found}")]
    Value {
        /// The file.
        file: String,
        /// The place.
        at: String,
        /// What may stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
}

/// A camera at one frame.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// Frame, from 0; keys ascend strictly.
    pub frame: f64,
    /// Where the camera stands, metres.
    pub eye: [f64; 3],
    /// The point that it looks at, metres.
    pub target: [f64; 3],
    /// Roughly upwards.
    #[serde(default = "plus_y")]
    pub up: [f64; 3],
    /// Angle of view from bottom to top, degrees.
    #[serde(default = "default_fov")]
    pub fov_degrees: f64,
}

fn plus_y() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

fn default_fov() -> f64 {
    60.0
}

/// A path over `frames` frames at a fixed step.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Frames a second of simulated time.
    pub fps: f64,
    /// Frames.
    pub frames: u32,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// At least one.
    pub keys: Vec<Key>,
}

impl CameraPath {
    /// Reads and checks a path file.
    pub fn read(file: &std::path::Path) -> Result<Self, PathError> {
        let name = file.display().to_string();
        let text = std::fs::read_to_string(file).map_err(|source| PathError::Read {
            file: name.clone(),
            source,
        })?;
        Self::parse(&text, &name)
    }

    /// Parses and checks the text of `file`.
    pub fn parse(text: &str, file: &str) -> Result<Self, PathError> {
        let path: Self = serde_json::from_str(text).map_err(|source| PathError::Syntax {
            file: file.to_owned(),
            source,
        })?;
        path.check(file)?;
        Ok(path)
    }

    fn check(&self, file: &str) -> Result<(), PathError> {
        let wrong = |at: String, expected: &str, found: String| PathError::Value {
            file: file.to_owned(),
            at,
            expected: expected.to_owned(),
            found,
        };
        if !(self.fps > 0.0 && self.fps.is_finite()) {
            return Err(wrong(
                "fps".into(),
                "a number above 0",
                self.fps.to_string(),
            ));
        }
        if self.frames == 0 {
            return Err(wrong("frames".into(), "at least 1", "0".into()));
        }
        if self.size.iter().any(|axis| !(1..=16_384).contains(axis)) {
            let found = format!("{:?}", self.size);
            return Err(wrong("size".into(), "1..=16384 pixels an axis", found));
        }
        if self.keys.is_empty() {
            return Err(wrong("keys".into(), "at least one", "none".into()));
        }
        for (index, key) in self.keys.iter().enumerate() {
            let at = |field: &str| format!("keys[{index}].{field}");
            let ordered = index == 0 || self.keys[index - 1].frame < key.frame;
            if !(ordered && key.frame.is_finite() && key.frame >= 0.0) {
                let found = key.frame.to_string();
                return Err(wrong(at("frame"), "0 or more, above the key before", found));
            }
            pose(key)
                .camera(self.size)
                .check()
                .map_err(|error| wrong(at(error.field), error.expected, error.found))?;
        }
        Ok(())
    }

    /// Simulated time of a frame, seconds.
    pub fn secs(&self, frame: u32) -> f64 {
        frame as f64 / self.fps
    }

    /// The camera of a frame: before the first key and after the last the camera stands still; between, a cubic through
    /// the keys whose slope at each is that of its neighbours (Catmull and Rom, "A class of local interpolating splines",
    /// 1974; for uneven spacing).
    pub fn camera(&self, frame: u32) -> Camera {
        let at = frame as f64;
        let after = self.keys.partition_point(|key| key.frame <= at);
        if after == 0 {
            return pose(&self.keys[0]).camera(self.size);
        }
        let before = after - 1;
        if after == self.keys.len() {
            return pose(&self.keys[before]).camera(self.size);
        }
        let (a, b) = (&self.keys[before], &self.keys[after]);
        let share = (at - a.frame) / (b.frame - a.frame);
        let vector = |pick: fn(&Key) -> [f64; 3]| {
            DVec3::from(std::array::from_fn(|axis| {
                self.cubic(before, share, &|key| pick(key)[axis])
            }))
        };
        let fov = self.cubic(before, share, &|key| key.fov_degrees);
        Pose {
            eye: vector(|key| key.eye),
            target: vector(|key| key.target),
            up: vector(|key| key.up),
            // The cubic may overshoot its keys; a lens may not.
            fov_degrees: fov.clamp(
                a.fov_degrees.min(b.fov_degrees),
                a.fov_degrees.max(b.fov_degrees),
            ),
        }
        .camera(self.size)
    }

    /// Hermite cubic from key `before` to the next at `share` of the way.
    fn cubic(&self, before: usize, share: f64, value: &dyn Fn(&Key) -> f64) -> f64 {
        let keys = &self.keys;
        let slope = |index: usize| {
            let (low, high) = (index.saturating_sub(1), (index + 1).min(keys.len() - 1));
            (value(&keys[high]) - value(&keys[low])) / (keys[high].frame - keys[low].frame)
        };
        let (a, b) = (&keys[before], &keys[before + 1]);
        let length = b.frame - a.frame;
        let (t, t2, t3) = (share, share * share, share * share * share);
        (2.0 * t3 - 3.0 * t2 + 1.0) * value(a)
            + (t3 - 2.0 * t2 + t) * length * slope(before)
            + (3.0 * t2 - 2.0 * t3) * value(b)
            + (t3 - t2) * length * slope(before + 1)
    }
}

fn pose(key: &Key) -> Pose {
    Pose {
        eye: key.eye.into(),
        target: key.target.into(),
        up: key.up.into(),
        fov_degrees: key.fov_degrees,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;

    const LINE: &str = r#"{"fps": 30, "frames": 31, "size": [96, 54], "keys": [
        {"frame": 0, "eye": [0, 0, 10], "target": [0, 0, 0]},
        {"frame": 10, "eye": [1, 0, 10], "target": [0, 0, 0], "fov_degrees": 30},
        {"frame": 30, "eye": [3, 0, 10], "target": [0, 0, 0], "fov_degrees": 30}]}"#;

    #[test]
    fn keys_are_met_and_a_straight_line_is_walked_at_constant_speed() {
        let path = CameraPath::parse(LINE, "line").unwrap();
        for frame in 0..=30 {
            let camera = path.camera(frame);
            assert!((camera.eye.x - frame as f64 * 0.1).abs() < 1e-12, "{frame}");
            assert!((30.0..=60.0).contains(&camera.fov_y_degrees));
        }
        assert_eq!(path.camera(30), path.camera(99));
        assert_eq!(path.secs(30), 1.0);
    }

    #[test]
    fn speed_does_not_jump_at_a_key() {
        let mut path = CameraPath::parse(LINE, "line").unwrap();
        path.keys[2].eye = [9.0, 0.0, 10.0];
        let speed = |frame: u32| path.camera(frame + 1).eye.x - path.camera(frame).eye.x;
        assert!((speed(9) - speed(10)).abs() < 0.2 * speed(9));
    }

    #[test]
    fn faults_are_named_with_their_place() {
        for (from, to, at) in [
            ("\"fps\": 30", "\"fps\": 0", "fps"),
            ("\"frames\": 31", "\"frames\": 0", "frames"),
            ("[96, 54]", "[0, 54]", "size"),
            ("\"frame\": 10", "\"frame\": 0", "keys[1].frame"),
            (
                "\"eye\": [3, 0, 10]",
                "\"eye\": [0, 0, 0]",
                "keys[2].target",
            ),
            (
                "\"fov_degrees\": 30}]",
                "\"fov_degrees\": 300}]",
                "keys[2].fov",
            ),
        ] {
            let text = LINE.replace(from, to);
            let error = CameraPath::parse(&text, "p.json").unwrap_err().to_string();
            assert!(error.starts_with(&format!("p.json: {at}: ")), "{error}");
        }
        let error = CameraPath::parse("{\"fps\": 1", "p.json")
            .unwrap_err()
            .to_string();
        assert!(error.contains("line 1"), "{error}");
    }
}

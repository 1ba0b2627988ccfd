//! Occlusion over frames: whose depths the pyramid has, and whether the next frame tests against
//! them.
//!
//! The early test and the late pass are a pair: either both run or neither does, since rejects of
//! the early test that no late pass looks at again would be lost.

use lodestream_shaders::types::{Counters, View, view_flag};

/// Frames without a test after one that hid little.
const SLEEP_FRAMES: u32 = 30;
/// A test pays where it hides at least one item in so many.
const LEAST_HIDDEN: u32 = 20;

/// The part of occlusion that a frame takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Steps {
    /// Test against the last depths; frames with a picture run the late pass too.
    pub tests: bool,
    /// Build the pyramid.
    pub builds: bool,
}

/// See the module.
#[derive(Debug, Default)]
pub struct Occlusion {
    off: bool,
    /// The view whose depths the pyramid has.
    drawn: Option<View>,
    /// Patches of the page table when it was built.
    drawn_patches: u64,
    sleep_frames: u32,
    /// Visible clusters when it fell asleep.
    slept_clusters: u32,
    last_tested: bool,
}

impl Occlusion {
    /// Turns it off or on again.
    pub fn set_off(&mut self, off: bool) {
        *self = Self {
            off,
            ..Self::default()
        };
    }

    /// Whether it is on.
    pub fn is_on(&self) -> bool {
        !self.off
    }

    /// Forgets the depths: the picture's size or the scene changed.
    pub fn forget(&mut self) {
        self.drawn = None;
    }

    /// The steps of a frame of `view`. `draws` says that it fills the visbuffer.
    pub fn plan(&mut self, view: &View, draws: bool) -> Steps {
        let asleep = draws && self.sleep_frames > 0;
        if asleep {
            self.sleep_frames -= 1;
        }
        if self.off || view.is_reference() || asleep {
            return Steps::default();
        }
        let sized = |drawn: &View| drawn.size_px == view.size_px;
        Steps {
            tests: self.drawn.as_ref().is_some_and(sized),
            builds: draws,
        }
    }

    /// The occluder of the early pass. A frame that does not draw has no late pass: hidden is
    /// hidden.
    pub fn early(&self, steps: Steps, draws: bool) -> Option<View> {
        let drawn = self.drawn.filter(|_| steps.tests)?;
        let late = if draws { 0 } else { view_flag::LATE };
        Some(View {
            flags: view_flag::OCCLUSION | late,
            ..drawn
        })
    }

    /// Notes a frame that was recorded.
    pub fn recorded(&mut self, view: &View, steps: Steps, patches: u64) {
        if steps.builds {
            self.drawn = Some(*view);
            self.drawn_patches = patches;
        }
        self.last_tested = steps.builds && steps.tests;
    }

    /// Takes the counters of a frame. One that hid little puts the test to sleep; another crowd of
    /// visible clusters wakes it.
    pub fn take(&mut self, counters: &Counters) {
        let drawn = counters.drawn_count;
        if self.sleep_frames > 0 {
            if drawn > 0 && drawn > self.slept_clusters.saturating_mul(3) / 2 {
                self.sleep_frames = 0;
            }
            return;
        }
        let hidden = counters.hidden_instances + counters.hidden_nodes + counters.hidden_clusters;
        if self.last_tested && drawn > 0 && hidden.saturating_mul(LEAST_HIDDEN) < drawn {
            self.sleep_frames = SLEEP_FRAMES;
            self.slept_clusters = drawn;
            self.drawn = None;
        }
    }

    /// Whether a frame of `view` is tested against depths of any view, or no test is wanted.
    pub fn has_depths(&self, view: &View) -> bool {
        let sized = |drawn: &View| drawn.size_px == view.size_px;
        self.off || self.sleep_frames > 0 || self.drawn.as_ref().is_some_and(sized)
    }

    /// Whether requests of `view` without a picture would be tested against depths of that very
    /// view.
    pub fn sees(&self, view: &View) -> bool {
        let same = |drawn: &View| {
            drawn.size_px == view.size_px
                && drawn.clip_from_rel == view.clip_from_rel
                && drawn.eye_high == view.eye_high
                && drawn.eye_low == view.eye_low
        };
        self.off || self.sleep_frames > 0 || self.drawn.as_ref().is_some_and(same)
    }

    /// [`Occlusion::sees`], with all pages drawn that are installed.
    pub fn is_current(&self, view: &View, patches: u64) -> bool {
        self.sees(view) && (self.off || self.sleep_frames > 0 || self.drawn_patches == patches)
    }
}

#[cfg(test)]
mod tests {
    use lodestream_shaders::cpu::Camera;

    use super::*;

    fn view(size_px: [u32; 2]) -> View {
        let camera = Camera {
            eye: glam::DVec3::Z,
            target: glam::DVec3::ZERO,
            up: glam::DVec3::Y,
            fov_y_degrees: 60.0,
            size_px,
        };
        camera.view(0.01, 1.0)
    }

    fn hiding(hidden_clusters: u32) -> Counters {
        Counters {
            drawn_count: 100,
            hidden_clusters,
            ..Counters::default()
        }
    }

    /// No frame tests without the depths of a picture of its size.
    #[test]
    fn a_frame_tests_only_against_depths_of_its_size() {
        let mut occlusion = Occlusion::default();
        let small = view([64, 64]);
        let first = occlusion.plan(&small, true);
        assert!(!first.tests && first.builds);
        occlusion.recorded(&small, first, 0);
        assert!(occlusion.plan(&small, true).tests);
        assert!(!occlusion.plan(&view([65, 64]), true).tests);
        occlusion.forget();
        assert!(!occlusion.plan(&small, true).tests);
    }

    #[test]
    fn a_test_that_hides_little_sleeps_and_wakes() {
        let mut occlusion = Occlusion::default();
        let view = view([64, 64]);
        let draw = |occlusion: &mut Occlusion, hidden| {
            let steps = occlusion.plan(&view, true);
            occlusion.recorded(&view, steps, 0);
            occlusion.take(&hiding(hidden));
            steps
        };
        draw(&mut occlusion, 0);
        assert!(draw(&mut occlusion, 50).tests);
        assert!(draw(&mut occlusion, 1).tests);
        for _ in 0..SLEEP_FRAMES {
            assert_eq!(draw(&mut occlusion, 0), Steps::default());
        }
        assert!(draw(&mut occlusion, 0).builds);
        assert!(draw(&mut occlusion, 50).tests);
    }
}

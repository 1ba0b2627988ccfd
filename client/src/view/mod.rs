//! `view`: the interactive window.
//!
//! Left drag orbits, right drag looks, middle drag or shift pans, the wheel zooms, WASD and QE fly. Digits choose the mode,
//! plus and minus the pixel error, brackets the speed of flight, F frames the scene, H hides the text, Escape leaves.

mod font;
mod navigation;
mod overlay;
mod window;

use std::path::PathBuf;

use winit::event_loop::EventLoop;

use crate::camera::Pose;
use crate::error::ClientError;
use crate::opening::SessionOptions;
use crate::report::Report;
use crate::stream::Source;

pub use navigation::Navigation;
use window::App;

/// What to show.
#[derive(Debug, Clone)]
pub struct ViewOptions {
    /// Scene (empty: the library's first), size, pixel error, pool, mode.
    pub session: SessionOptions,
    /// The first camera; without it the whole scene is framed.
    pub camera: Option<Pose>,
    /// Frames after which the window closes.
    pub frames: Option<u64>,
    /// Where the last frame is written.
    pub screenshot: Option<PathBuf>,
    /// The report.
    pub report: Option<PathBuf>,
}

/// Opens the window and stays until it is closed.
pub fn view(mut options: ViewOptions) -> Result<Report, ClientError> {
    if options.session.scene.is_empty() {
        options.session.scene = first_scene(&options.session.location)?;
    }
    // Readbacks of frames that nobody waits for come a few frames late.
    options.session.readback_updates = 8;
    let failed = |error: winit::error::EventLoopError| ClientError::Setting {
        at: "window".to_owned(),
        expected: "a display (X11 or Wayland)".to_owned(),
        // winit puts the place in its own source before the reason.
        found: error
            .to_string()
            .rsplit(": ")
            .next()
            .unwrap_or("none")
            .to_owned(),
    };
    let events = EventLoop::new().map_err(failed)?;
    let mut app = App::new(options);
    events.run_app(&mut app).map_err(failed)?;
    app.finish()
}

fn first_scene(location: &str) -> Result<String, ClientError> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| ClientError::Setting {
            at: "threads".to_owned(),
            expected: "a runtime".to_owned(),
            found: error.to_string(),
        })?;
    let source = Source::connect(location)?;
    let scenes = runtime.block_on(source.scenes())?;
    let first = scenes.into_iter().next();
    first
        .map(|entry| entry.name)
        .ok_or_else(|| ClientError::Setting {
            at: location.to_owned(),
            expected: "a library with a scene".to_owned(),
            found: "none".to_owned(),
        })
}

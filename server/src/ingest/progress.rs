//! Progress of an ingest on a terminal: what is done, the rate, the time left. Nothing where there is no terminal.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shared by all threads.
#[derive(Debug)]
pub(super) struct Progress(ProgressBar);

impl Progress {
    /// Hidden unless `show`, and unless standard error is a terminal.
    pub(super) fn new(show: bool) -> Self {
        let bar = match show {
            true => ProgressBar::new_spinner(),
            false => ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden()),
        };
        Self(bar)
    }

    /// A stage whose length is not known.
    pub(super) fn step(&self, what: &str) {
        self.0.set_message(what.to_owned());
        self.0.enable_steady_tick(Duration::from_millis(200));
    }

    /// The build, counted in triangles.
    pub(super) fn begin_triangles(&self, total: u64) {
        const TEMPLATE: &str =
            "building {bar:30} {percent:>3} % of {len} triangles, {per_sec}, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(TEMPLATE) {
            self.0.set_style(style);
        }
        self.0.set_length(total);
        self.0.set_position(0);
    }

    /// More of them are done.
    pub(super) fn triangles(&self, count: u64) {
        self.0.inc(count);
    }

    /// Leaves the line.
    pub(super) fn end(&self) {
        self.0.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

//! Progress of an ingest on a terminal: what is done, the rate, the time left. Nothing where there is no terminal.

use std::fmt::Write;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

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
        const TEMPLATE: &str = "building {wide_bar} {percent:>3} % of {triangles}, {rate}, {left}";
        if let Ok(style) = ProgressStyle::with_template(TEMPLATE) {
            // The rate is that of the whole stage: meshes end in bursts, and a rate of the last seconds jumps with them.
            let triangles = |state: &ProgressState, out: &mut dyn Write| {
                let total = state.len().unwrap_or(0) as f64;
                let _ = write!(out, "{} triangles", short(total));
            };
            let rate = |state: &ProgressState, out: &mut dyn Write| {
                let _ = write!(out, "{}/s", short(rate(state.pos(), state.elapsed())));
            };
            let left = |state: &ProgressState, out: &mut dyn Write| {
                let text = left(state.pos(), state.len().unwrap_or(0), state.elapsed());
                let _ = write!(out, "{text}");
            };
            let style = style.with_key("triangles", triangles);
            self.0
                .set_style(style.with_key("rate", rate).with_key("left", left));
        }
        self.0.set_length(total);
        self.0.set_position(0);
        self.0.reset_elapsed();
        self.0.enable_steady_tick(Duration::from_millis(200));
    }

    /// More of them are done.
    pub(super) fn triangles(&self, count: u64) {
        self.0.inc(count);
    }

    /// A warning for the log, above the line.
    pub(super) fn warn(&self, text: &str) {
        self.0.suspend(|| tracing::warn!("{text}"));
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

/// Triangles a second.
fn rate(done: u64, elapsed: Duration) -> f64 {
    done as f64 / elapsed.as_secs_f64().max(1e-3)
}

fn left(done: u64, total: u64, elapsed: Duration) -> String {
    if done == 0 {
        return "? s left".to_owned();
    }
    let secs = total.saturating_sub(done) as f64 / rate(done, elapsed);
    let secs = secs.ceil() as u64;
    let (hours, minutes, seconds) = (secs / 3600, secs / 60 % 60, secs % 60);
    match (hours, minutes) {
        (0, 0) => format!("{seconds} s left"),
        (0, _) => format!("{minutes} min {seconds:02} s left"),
        _ => format!("{hours} h {minutes:02} min left"),
    }
}

/// A count in three digits.
fn short(count: f64) -> String {
    let (value, unit) = match count {
        1e9.. => (count / 1e9, " G"),
        1e6.. => (count / 1e6, " M"),
        1e3.. => (count / 1e3, " k"),
        _ => return format!("{count:.0}"),
    };
    let digits = match value {
        100.0.. => 0,
        10.0.. => 1,
        _ => 2,
    };
    format!("{value:.digits$}{unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_and_time_left_read_well() {
        for (count, text) in [
            (0.0, "0"),
            (999.0, "999"),
            (1234.0, "1.23 k"),
            (98_765.0, "98.8 k"),
            (4_000_000.0, "4.00 M"),
            (123e9, "123 G"),
        ] {
            assert_eq!(short(count), text);
        }
        let second = Duration::from_secs(1);
        for (done, total, text) in [
            (0, 10, "? s left"),
            (10, 10, "0 s left"),
            (1, 60, "59 s left"),
            (1, 126, "2 min 05 s left"),
            (1, 7_260, "2 h 00 min left"),
        ] {
            assert_eq!(left(done, total, second), text);
        }
    }
}

//! Progress of an ingest: on a terminal what is done, the rate, the time left, and nothing where there is none; or lines of JSON for a program.

use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

/// Where progress goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ProgressTo {
    /// Nowhere.
    #[default]
    Nothing,
    /// A line of standard error, where that is a terminal.
    Terminal,
    /// Lines of JSON on standard output: `{"stage": "…"}`, and while meshes are built also `triangles` and `of`.
    Lines,
}

/// Least time between two lines of JSON of one stage.
const BETWEEN_LINES: Duration = Duration::from_millis(200);

/// Shared by all threads.
#[derive(Debug)]
pub(super) struct Progress {
    bar: ProgressBar,
    lines: Option<Lines>,
}

/// What the lines of JSON count.
#[derive(Debug, Default)]
struct Lines {
    done: AtomicU64,
    of: AtomicU64,
    told: Mutex<Option<Instant>>,
}

impl Lines {
    fn tell(line: &serde_json::Value) {
        use std::io::Write as _;
        // Nobody reads it any longer: the ingest goes on.
        let _ = writeln!(std::io::stdout().lock(), "{line}");
    }

    fn triangles(&self, count: u64) {
        let done = self.done.fetch_add(count, Ordering::Relaxed) + count;
        let of = self.of.load(Ordering::Relaxed);
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if done >= of || told.is_none_or(|told| told.elapsed() >= BETWEEN_LINES) {
            *told = Some(Instant::now());
            Self::tell(&serde_json::json!({"stage": "building", "triangles": done, "of": of}));
        }
    }
}

impl Progress {
    /// Of one run.
    pub(super) fn new(to: ProgressTo) -> Self {
        Self {
            bar: match to {
                ProgressTo::Terminal => ProgressBar::new_spinner(),
                _ => ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden()),
            },
            lines: (to == ProgressTo::Lines).then(Lines::default),
        }
    }

    /// A stage whose length is not known.
    pub(super) fn step(&self, what: &str) {
        if self.lines.is_some() {
            Lines::tell(&serde_json::json!({ "stage": what }));
        }
        self.bar.set_message(what.to_owned());
        self.bar.enable_steady_tick(Duration::from_millis(200));
    }

    /// The build, counted in triangles.
    pub(super) fn begin_triangles(&self, total: u64) {
        const TEMPLATE: &str = "building {wide_bar} {percent:>3} % of {triangles}, {rate}, {left}";
        if let Some(lines) = &self.lines {
            lines.of.store(total, Ordering::Relaxed);
        }
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
            self.bar
                .set_style(style.with_key("rate", rate).with_key("left", left));
        }
        self.bar.set_length(total);
        self.bar.set_position(0);
        self.bar.reset_elapsed();
        self.bar.enable_steady_tick(Duration::from_millis(200));
    }

    /// More of them are done.
    pub(super) fn triangles(&self, count: u64) {
        if let Some(lines) = &self.lines {
            lines.triangles(count);
        }
        self.bar.inc(count);
    }

    /// A warning for the log, above the line.
    pub(super) fn warn(&self, text: &str) {
        self.bar.suspend(|| tracing::warn!("{text}"));
    }

    /// Leaves the line.
    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
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

//! What a stretch of work cost this process: wall-clock, processor, memory.

use std::time::{Duration, Instant};

/// Time that some work took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spent {
    /// Wall-clock seconds.
    pub wall_secs: f64,
    /// Processor seconds of all threads, where the system tells.
    pub cpu_secs: Option<f64>,
}

/// Does `work` and tells what it took.
pub fn spent<T>(work: impl FnOnce() -> T) -> (T, Spent) {
    let (start, before) = (Instant::now(), cpu_time());
    let result = work();
    let wall = start.elapsed();
    let cpu = cpu_time().zip(before).map(|(after, before)| after - before);
    let spent = Spent {
        wall_secs: wall.as_secs_f64(),
        cpu_secs: cpu.map(|cpu| cpu.as_secs_f64()),
    };
    (result, spent)
}

/// Processor time of this process so far, nanoseconds kept.
#[cfg(unix)]
fn cpu_time() -> Option<Duration> {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(Duration::new(
        now.tv_sec.try_into().ok()?,
        now.tv_nsec.try_into().ok()?,
    ))
}

#[cfg(not(unix))]
fn cpu_time() -> Option<Duration> {
    None
}

/// Lets the peak start anew from what is resident now; false where the system has no such thing (it is Linux').
pub fn reset_peak() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// Largest resident set since the start or [`reset_peak`], bytes; Linux.
pub fn peak_resident_bytes() -> Option<u64> {
    status("VmHWM:")
}

/// Resident set now, bytes; Linux.
pub fn resident_bytes() -> Option<u64> {
    status("VmRSS:")
}

fn status(key: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(key))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// The middle of some figures, the mean of the two middle ones of an even number; NaN of none.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    quantile(values, 0.5)
}

/// The value below which `share` of the figures lie, between two neighbours in proportion; NaN of none.
pub fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = share * sorted.len().saturating_sub(1) as f64;
    let (below, above) = (
        sorted.get(at.floor() as usize),
        sorted.get(at.ceil() as usize),
    );
    below.zip(above).map_or(f64::NAN, |(below, above)| {
        // Equal neighbours may be infinite.
        if below == above {
            *below
        } else {
            below + (above - below) * at.fract()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_neighbours() {
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(quantile([0.0, 10.0], 0.95), 9.5);
        assert_eq!(median([f64::INFINITY; 2]), f64::INFINITY);
        assert!(median([]).is_nan());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn work_costs_time_and_memory() {
        assert!(reset_peak());
        let before = resident_bytes().unwrap();
        let (sum, spent) = spent(|| {
            let held = std::hint::black_box(vec![1u8; 64 << 20]);
            held.iter().map(|&it| u64::from(it)).sum::<u64>()
        });
        assert_eq!(sum, 64 << 20);
        assert!(spent.wall_secs > 0.0 && spent.cpu_secs.unwrap() > 0.0);
        assert!(peak_resident_bytes().unwrap() >= before + (60 << 20));
    }
}

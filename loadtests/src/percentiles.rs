//! Nearest-rank percentiles: every figure that is given was measured, none is between two measurements.

use serde::Serialize;

/// Values in ascending order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sorted(Vec<f64>);

impl Sorted {
    /// Sorts `values`; not-a-numbers come last.
    pub fn new(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self(values)
    }

    /// The smallest value that `share` of all do not exceed; `None` of nothing.
    pub fn at(&self, share: f64) -> Option<f64> {
        let rank = (share * self.0.len() as f64).ceil() as usize;
        self.0.get(rank.max(1) - 1).copied()
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

/// Seconds until something was there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Waits {
    /// Half waited no longer.
    pub p50: f64,
    /// All but a twentieth waited no longer.
    pub p95: f64,
}

impl Waits {
    /// `None` where nothing waited.
    pub fn of(sorted: &Sorted) -> Option<Self> {
        Some(Self {
            p50: sorted.at(0.5)?,
            p95: sorted.at(0.95)?,
        })
    }

    /// Waits of which each counts as its weight; `None` where nothing waited.
    pub fn weighted(mut waits: Vec<(f64, f64)>) -> Option<Self> {
        waits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: f64 = waits.iter().map(|(_, weight)| weight).sum();
        let at = |share: f64| {
            let mut passed = 0.0;
            let reached = waits.iter().find(|(_, weight)| {
                passed += weight;
                passed >= share * all
            });
            reached.or(waits.last()).map(|(secs, _)| *secs)
        };
        Some(Self {
            p50: at(0.5)?,
            p95: at(0.95)?,
        })
    }
}

/// Milliseconds of requests.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Latencies {
    /// Half took no longer.
    pub p50: f64,
    /// All but a tenth took no longer.
    pub p90: f64,
    /// All but a hundredth took no longer.
    pub p99: f64,
    /// All but a thousandth took no longer.
    pub p999: f64,
    /// None took longer.
    pub max: f64,
}

impl Latencies {
    /// `None` without requests.
    pub fn of(sorted: &Sorted) -> Option<Self> {
        Some(Self {
            p50: sorted.at(0.5)?,
            p90: sorted.at(0.9)?,
            p99: sorted.at(0.99)?,
            p999: sorted.at(0.999)?,
            max: sorted.at(1.0)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks() {
        let sorted = Sorted::new((1..=1000).rev().map(f64::from).collect());
        let expected = Latencies {
            p50: 500.0,
            p90: 900.0,
            p99: 990.0,
            p999: 999.0,
            max: 1000.0,
        };
        assert_eq!(Latencies::of(&sorted), Some(expected));
        assert_eq!(
            Waits::of(&sorted),
            Some(Waits {
                p50: 500.0,
                p95: 950.0
            })
        );
        assert_eq!(
            Waits::of(&Sorted::new(vec![3.0])),
            Some(Waits { p50: 3.0, p95: 3.0 })
        );
        assert_eq!(Waits::of(&Sorted::default()), None);
        let waits = vec![(9.0, 1.0), (2.0, 90.0), (5.0, 9.0)];
        let expected = Waits { p50: 2.0, p95: 5.0 };
        assert_eq!(Waits::weighted(waits), Some(expected));
        assert_eq!(Waits::weighted(vec![]), None);
    }
}

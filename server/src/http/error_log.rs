//! What fails, in the log: of each kind a line a second, so that a store that is down does not fill the disk as fast as viewers ask.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

const EVERY: Duration = Duration::from_secs(1);

/// When a kind was logged last, and how often it happened since.
static KINDS: Mutex<BTreeMap<&str, (Instant, u64)>> = Mutex::new(BTreeMap::new());

/// Logs an error of a kind, or counts it for the next line.
pub(super) fn error(kind: &'static str, error: &dyn Display) {
    if let Some(untold) = untold(kind, Instant::now()) {
        match untold {
            0 => tracing::error!("{kind}: {error}"),
            untold => tracing::error!("{kind}: {error} (and {untold} more since the last line)"),
        }
    }
}

/// An answer whose status was out already.
pub(super) fn cut_short(what: &impl Display) {
    error("answer cut short", what);
}

/// Of how many the log has heard nothing, if it is time for a line.
fn untold(kind: &'static str, now: Instant) -> Option<u64> {
    let mut kinds = KINDS.lock().unwrap_or_else(PoisonError::into_inner);
    match kinds.get_mut(kind) {
        Some((last, untold)) if now.saturating_duration_since(*last) < EVERY => {
            *untold += 1;
            None
        }
        Some((last, untold)) => {
            *last = now;
            Some(std::mem::take(untold))
        }
        None => {
            kinds.insert(kind, (now, 0));
            Some(0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_has_a_line_a_second_which_counts_the_others() {
        let now = Instant::now();
        let at = |kind, millis| untold(kind, now + Duration::from_millis(millis));
        assert_eq!((at("a", 0), at("b", 1)), (Some(0), Some(0)));
        assert!((2..900).all(|millis| at("a", millis).is_none()));
        assert_eq!(
            (at("a", 1000), at("a", 1001), at("b", 1002)),
            (Some(898), None, Some(0))
        );
    }
}

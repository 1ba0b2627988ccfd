//! Counters of a residency.

/// What a residency did so far and how it stands. Times are seconds, sizes bytes.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct StreamStats {
    /// Wanted pages, summed over updates, dependencies included and root pages left out.
    pub requests: u64,
    /// Times that a wanted page was not there when it began to be wanted.
    pub faults: u64,
    /// Requests for pages that the scene does not have, or whose priority was no number.
    pub ignored_requests: u64,
    /// Fetches handed out.
    pub fetches: u64,
    /// Fetches called off because the camera no longer wanted their pages.
    pub fetches_cancelled: u64,
    /// Pages that came and passed every check.
    pub pages_fetched: u64,
    /// Bytes of their frames.
    pub bytes_fetched: u64,
    /// Pages that came and were not installed, because nothing wanted them any more.
    pub pages_superseded: u64,
    /// Pages whose fetch failed, each time.
    pub failures: u64,
    /// The last failure.
    pub last_failure: Option<String>,
    /// Pages evicted.
    pub pages_evicted: u64,
    /// Pages in the pool, root pages included.
    pub pages_resident: u64,
    /// Pages wanted by the last update, as far as they were admitted.
    pub pages_wanted: u64,
    /// Visible pages of them that are not installed.
    pub pages_missing: u64,
    /// Hidden pages that are not installed: they come last, and settling does not wait for them.
    pub pages_hidden_missing: u64,
    /// Those of them that wait for the end of a back-off.
    pub pages_failed: u64,
    /// Fetches in flight.
    pub fetches_in_flight: u64,
    /// Bytes in flight.
    pub bytes_in_flight: u64,
    /// Bytes that the window allows in flight.
    pub window_bytes: u64,
    /// Measured bandwidth, bytes a second.
    pub bytes_a_sec: f64,
    /// Measured time of the shortest fetch, seconds.
    pub latency_secs: f64,
    /// Bytes of the pool.
    pub pool_bytes: u64,
    /// Slots of the pool.
    pub pool_slots: u64,
    /// Pixel error that the user asked for.
    pub pixel_error_asked: f32,
    /// Pixel error that is shown.
    pub pixel_error_shown: f32,
    /// Faults in this program: events that a page's state does not allow. Always 0.
    pub illegal_transitions: u64,
}

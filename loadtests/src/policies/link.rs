//! A link in simulated time: one byte after the other at a bandwidth, each answer a latency after its request at the
//! earliest, in the order of the requests.

use std::collections::VecDeque;

/// Bandwidth and latency.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct LinkSpeed {
    /// Megabits a second.
    pub bandwidth_mbps: f64,
    /// Milliseconds from a request to the first byte of its answer on an idle link.
    pub latency_ms: f64,
}

/// A link with what is on its way.
#[derive(Debug, Clone)]
pub struct Link {
    bytes_a_sec: f64,
    latency_secs: f64,
    free_secs: f64,
    queue: VecDeque<Answer>,
}

#[derive(Debug, Clone, Copy)]
struct Answer {
    fetch: u64,
    page: u32,
    bytes: u32,
    ready_secs: f64,
}

impl Link {
    /// An idle link.
    pub fn new(speed: LinkSpeed) -> Self {
        Self {
            bytes_a_sec: speed.bandwidth_mbps * 1e6 / 8.0,
            latency_secs: speed.latency_ms / 1e3,
            free_secs: 0.0,
            queue: VecDeque::new(),
        }
    }

    /// Asks for a page; time never runs backwards from call to call.
    pub fn send(&mut self, fetch: u64, page: u32, bytes: u32, now_secs: f64) {
        let ready_secs = now_secs + self.latency_secs;
        self.queue.push_back(Answer {
            fetch,
            page,
            bytes,
            ready_secs,
        });
    }

    /// Calls a fetch off: what of it has not begun to cross the link never will. Call after [`Link::arrived`] of the same
    /// time.
    pub fn cancel(&mut self, fetch: u64, now_secs: f64) {
        let begun = self
            .queue
            .front()
            .is_some_and(|first| first.ready_secs.max(self.free_secs) <= now_secs);
        let mut index = 0;
        self.queue.retain(|answer| {
            index += 1;
            answer.fetch != fetch || (begun && index == 1)
        });
    }

    /// Pages that came whole until now, in their order.
    pub fn arrived(&mut self, now_secs: f64) -> Vec<u32> {
        let mut pages = Vec::new();
        while let Some(first) = self.queue.front() {
            let end_secs =
                first.ready_secs.max(self.free_secs) + first.bytes as f64 / self.bytes_a_sec;
            if end_secs > now_secs {
                break;
            }
            self.free_secs = end_secs;
            pages.push(first.page);
            self.queue.pop_front();
        }
        pages
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thousand bytes a second, half a second of latency.
    fn link() -> Link {
        Link::new(LinkSpeed {
            bandwidth_mbps: 0.008,
            latency_ms: 500.0,
        })
    }

    #[test]
    fn answers_come_one_after_the_other() {
        let mut link = link();
        link.send(1, 10, 1000, 0.0);
        link.send(1, 11, 1000, 0.0);
        link.send(2, 12, 500, 1.0);
        assert!(link.arrived(1.49).is_empty());
        assert_eq!(link.arrived(1.51), [10]);
        assert_eq!(link.arrived(3.01), [11, 12]);
        link.send(3, 13, 100, 10.0);
        assert!(link.arrived(10.59).is_empty());
        assert_eq!(link.arrived(10.61), [13]);
    }

    #[test]
    fn what_is_called_off_frees_the_link_unless_it_has_begun() {
        let mut link = link();
        for page in 0..3 {
            link.send(page as u64, page, 1000, 0.0);
        }
        assert!(link.arrived(1.0).is_empty());
        link.cancel(0, 1.0);
        link.cancel(1, 1.0);
        assert_eq!(link.arrived(2.51), [0, 2]);
    }
}

//! Twin of `wgsl/compact_requests.wgsl`.

use super::append;
use crate::types::{Counters, RequestRecord, View};

/// Page priorities to a dense list, by page number (the GPU's order is any).
pub fn compact_requests(
    view: &View,
    page_priority: &[u32],
    counters: &mut Counters,
    requests: &mut Vec<RequestRecord>,
) {
    for (page, &priority) in page_priority.iter().enumerate() {
        if priority != 0 {
            let request = RequestRecord {
                page: page as u32,
                priority_px: f32::from_bits(priority),
            };
            append(
                requests,
                request,
                &mut counters.request_count,
                view.request_capacity,
            );
        }
    }
}

//! Twin of `wgsl/compact_requests.wgsl`.

use super::append;
use super::error_metric::RequestWords;
use crate::types::{Counters, RequestRecord, View};

/// Page priorities to a dense list, by page number (the GPU's order is any).
pub fn compact_requests(
    view: &View,
    page_priority: &[RequestWords],
    counters: &mut Counters,
    requests: &mut Vec<RequestRecord>,
) {
    for (page, &[visible_bits, priority, hidden_bits]) in page_priority.iter().enumerate() {
        // A hidden page has no priority.
        let error_bits = match visible_bits {
            0 => hidden_bits,
            bits => bits,
        };
        if error_bits != 0 {
            let request = RequestRecord {
                page: page as u32,
                error_px: f32::from_bits(error_bits),
                priority,
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

// Page priorities to a dense list for the host, a thread a page.
#import view

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> page_priority: array<u32>;
@group(0) @binding(2) var<storage, read_write> counters: Counters;
@group(0) @binding(3) var<storage, read_write> requests: array<RequestRecord>;

@compute @workgroup_size(64)
fn compact_requests(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let page = thread_index(workgroup, local);
    if page >= view.page_count {
        return;
    }
    let visible_bits = page_priority[3u * page];
    let hidden_bits = page_priority[3u * page + 2u];
    if (visible_bits | hidden_bits) == 0u {
        return;
    }
    let place = atomicAdd(&counters.request_count, 1u);
    if place < view.request_capacity {
        // A hidden page has no priority.
        let error_px = bitcast<f32>(select(visible_bits, hidden_bits, visible_bits == 0u));
        requests[place] = RequestRecord(page, error_px, page_priority[3u * page + 1u]);
    }
}

// Points to the visbuffer, a thread a point. They lie at the end of the visible items, last first.
#import view
#import visbuffer

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> clusters: array<ClusterItem>;
@group(0) @binding(2) var<storage, read_write> counters: Counters;
@group(0) @binding(3) var<storage, read_write> visbuffer: array<VisbufferWord>;

@compute @workgroup_size(64)
fn raster_points(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let index = thread_index(workgroup, local);
    if index >= min(atomicLoad(&counters.point_count), view.cluster_capacity) {
        return;
    }
    let visible_index = view.cluster_capacity - 1u - index;
    let item = clusters[view.cluster_capacity + visible_index];
    store_visbuffer(item.page & 0x7fffffffu, item.page_word, visible_index << TRIANGLE_BITS);
}

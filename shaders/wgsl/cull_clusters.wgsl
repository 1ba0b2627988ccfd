// Candidates to visible clusters, a thread a candidate. Visible ones lie behind the candidates. The
// early pass marks the candidates that it decides about; the late one tests those that it rejected.
#import refine
#import cluster
#import occlusion
#import hzb
#import raster_choice

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> occluder: View;
@group(0) @binding(2) var<storage, read> scene: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> instances: array<InstanceRecord>;
@group(0) @binding(4) var<storage, read> page_table: array<u32>;
@group(0) @binding(5) var<storage, read> hzb: array<u32>;
@group(0) @binding(6) var<storage, read_write> counters: Counters;
@group(0) @binding(7) var<storage, read_write> clusters: array<ClusterItem>;
// Visible indices: those that the compute rasterizer draws, then the hardware's.
@group(0) @binding(8) var<storage, read_write> draw_lists: array<u32>;

// Drawn: its own group refines, the one below does not. One loop over both, so that the compiler makes one code of it.
fn in_cut(own: u32, below: u32, instance: InstanceRecord, asset: AssetRecord) -> bool {
    for (var step = 0u; step < 2u; step++) {
        let number = select(below, own, step == 0u);
        let exists = number != NO_GROUP;
        let wanted = exists && refine(load_group(asset.group_base + number), instance, asset.page_base);
        if wanted != (step == 0u) {
            return false;
        }
    }
    return true;
}

@compute @workgroup_size(64)
fn cull_clusters(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let index = thread_index(workgroup, local);
    if index >= counters.last_candidate - counters.first_candidate {
        return;
    }
    let candidate = counters.first_candidate + index;
    let item = clusters[candidate];
    if item.page_word == NOT_INSTALLED {
        return;
    }
    let is_early = tests_occlusion() && !is_late();
    if is_early {
        clusters[candidate].page_word = NOT_INSTALLED;
    }
    let instance = instances[item.instance];
    let asset = load_asset(instance.asset);
    let cluster = load_cluster(item.page_word, item.cluster);
    if !in_cut(cluster.group, cluster.child_group, instance, asset) {
        return;
    }
    let aabb_min = cluster_aabb_min(cluster, asset.position_step);
    let aabb_max = cluster_aabb_max(cluster, asset.position_step);
    if !is_reference(view) && !aabb_in_frustum(instance, view, aabb_min, aabb_max, CLUSTER_SLACK) {
        return;
    }
    if tests_occlusion() && is_hidden(instance, aabb_min, aabb_max) {
        if is_early {
            atomicAdd(&counters.rejected_clusters, 1u);
            clusters[candidate].page_word = item.page_word;
        } else {
            atomicAdd(&counters.hidden_clusters, 1u);
        }
        return;
    }
    atomicAdd(&counters.triangles_drawn, cluster_triangle_count(cluster));
    let place = atomicAdd(&counters.visible_count, 1u);
    // Points lie at the end.
    if place >= view.cluster_capacity - min(atomicLoad(&counters.point_count), view.cluster_capacity) {
        return;
    }
    clusters[view.cluster_capacity + place] = item;
    if draws_by_compute(instance, asset, cluster) {
        draw_lists[atomicAdd(&counters.compute_count, 1u)] = place;
    } else {
        draw_lists[view.cluster_capacity + atomicAdd(&counters.hardware_count, 1u)] = place;
    }
}

// Which rasterizer draws a cluster. Needs the bindings `view` and `scene`.
#import view
#import snap
#import scene
#import cluster
#import material

// Longest side of a cluster on the screen for the compute rasterizer, pixels: its edge functions
// then stay below 2^31.
const MOST_COMPUTE_PX: f32 = 64.0;
// Nearest depth for it, in near planes: it does not clip.
const LEAST_COMPUTE_NEARS: f32 = 2.0;

// Whether a material of the cluster may be masked. One with a table of materials counts as masked.
fn may_be_masked(cluster: Cluster, asset: AssetRecord) -> bool {
    if (view.flags & VIEW_FLAG_MASKED) == 0u {
        return false;
    }
    if (cluster.counts & MATERIAL_TABLE_FLAG) != 0u {
        return true;
    }
    for (var place = 0u; place < 3u; place++) {
        let slot = (cluster.materials >> (6u * place)) & 0x3fu;
        let material = load_material(load_material_slot(asset.material_base + slot));
        if (material.flags & MATERIAL_MASK) != 0u {
            return true;
        }
    }
    return false;
}

// Whether the compute rasterizer draws the cluster: small, in front of the near plane, not masked.
fn draws_by_compute(instance: InstanceRecord, asset: AssetRecord, cluster: Cluster) -> bool {
    if (view.flags & VIEW_FLAG_HARDWARE) != 0u {
        return false;
    }
    let aabb_min = cluster_aabb_min(cluster, asset.position_step);
    let half_size = (cluster_aabb_max(cluster, asset.position_step) - aabb_min) * 0.5;
    let center = view.clip_from_rel * vec4<f32>(rel_from_local(instance, view, aabb_min + half_size), 1.0);
    let edge_x = view.clip_from_rel * vec4<f32>(instance.linear_x * half_size.x, 0.0);
    let edge_y = view.clip_from_rel * vec4<f32>(instance.linear_y * half_size.y, 0.0);
    let edge_z = view.clip_from_rel * vec4<f32>(instance.linear_z * half_size.z, 0.0);
    let reach = abs(edge_x) + abs(edge_y) + abs(edge_z);
    let nearest = center.w - reach.w;
    if !(nearest > LEAST_COMPUTE_NEARS * view.near_metres) {
        return false;
    }
    // A corner's distance from the centre, in pixels: (x + dx) / (w + dw) - x / w.
    let size = vec2<f32>(view.size_px);
    let ndc = center.xy / center.w;
    let apart_px = (reach.xy + abs(ndc) * reach.w) / nearest * size;
    let far_px = abs(ndc) * size * 0.5;
    return max(apart_px.x, apart_px.y) < MOST_COMPUTE_PX
        && max(far_px.x, far_px.y) < MOST_SNAPPED_PX - MOST_COMPUTE_PX
        && !may_be_masked(cluster, asset);
}

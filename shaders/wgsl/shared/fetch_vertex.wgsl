// A visible cluster and a vertex index to clip space, for the vertex stages of the raster passes.
// Reads `view`, `scene`, `instances` and `clusters`, which each of them declares.
#import types
#import scene
#import snap
#import view
#import cluster

struct Corner {
    clip: vec4<f32>,
    id: u32,
    cluster: Cluster,
    triangle: u32,
    // Vertex inside the cluster.
    vertex: u32,
    // 0 for a corner of a triangle past the cluster's last.
    drawn: u32,
}

// Visible clusters lie behind the candidates.
fn visible_item(visible_index: u32) -> ClusterItem {
    return clusters[view.cluster_capacity + visible_index];
}

fn clip_from_local(instance: InstanceRecord, local: vec3<f32>) -> vec4<f32> {
    return view.clip_from_rel * vec4<f32>(rel_from_local(instance, view, local), 1.0);
}

// Every cluster is drawn with 384 vertices; the triangles that it lacks collapse into one point and cover nothing.
fn fetch_corner(visible_index: u32, vertex_index: u32) -> Corner {
    let item = visible_item(visible_index);
    var corner: Corner;
    corner.cluster = load_cluster(item.page_word, item.cluster);
    corner.triangle = vertex_index / 3u;
    corner.id = (visible_index << TRIANGLE_BITS) | corner.triangle;
    corner.clip = vec4<f32>(0.0, 0.0, 0.0, 1.0);
    if corner.triangle < cluster_triangle_count(corner.cluster) {
        let instance = instances[item.instance];
        corner.vertex = strip_corner(corner.cluster.strips, corner.triangle, vertex_index % 3u);
        let step = load_asset(instance.asset).position_step;
        let local = cluster_position_local(corner.cluster, corner.vertex, step);
        corner.clip = snapped_clip(clip_from_local(instance, local));
        corner.drawn = 1u;
    }
    return corner;
}

// Index of the pixel under a fragment in the visbuffer and its like.
fn pixel_index(position: vec4<f32>) -> u32 {
    return u32(position.y) * view.size_px.x + u32(position.x);
}

// The surface of a visbuffer id at a pixel. Reads `view`, `scene`, `instances`, `clusters`,
// `texels`.
#import types
#import fetch_vertex
#import material
#import sample_texture
#import barycentric
#import light

struct Surface {
    item: ClusterItem,
    cluster: Cluster,
    triangle: u32,
    material: u32,
    // Linear RGB, vertex colour and texture multiplied in.
    base_color: vec3<f32>,
    // Unit, world space, on the eye's side of the triangle.
    normal: vec3<f32>,
    // Unit, world space.
    to_eye: vec3<f32>,
}

fn load_surface(id: u32, pixel: vec2<u32>) -> Surface {
    var surface: Surface;
    surface.item = visible_item(id >> TRIANGLE_BITS);
    surface.triangle = id & ((1u << TRIANGLE_BITS) - 1u);
    surface.cluster = load_cluster(surface.item.page_word, surface.item.cluster);
    let instance = instances[surface.item.instance];
    let asset = load_asset(instance.asset);
    let corners = cluster_triangle(surface.cluster, surface.triangle);
    let a = cluster_position_local(surface.cluster, corners.x, asset.position_step);
    let b = cluster_position_local(surface.cluster, corners.y, asset.position_step);
    let c = cluster_position_local(surface.cluster, corners.z, asset.position_step);

    let size = vec2<f32>(view.size_px);
    let pixel_in_ndc = vec2<f32>(2.0, -2.0) / size;
    let ndc = vec2<f32>(-1.0, 1.0) + (vec2<f32>(pixel) + 0.5) * pixel_in_ndc;
    let place = barycentric(
        clip_from_local(instance, a),
        clip_from_local(instance, b),
        clip_from_local(instance, c),
        ndc,
        pixel_in_ndc,
    );

    let local = a + (b - a) * place.weights.y + (c - a) * place.weights.z;
    surface.to_eye = safe_normalize(-rel_from_local(instance, view, local), -view.forward);
    surface.normal = surface_normal(surface.cluster, corners, instance, place.weights, b - a, c - a, surface.to_eye);
    surface.material = material_of(asset, surface.cluster, surface.triangle);
    surface.base_color = surface_color(surface.cluster, corners, asset, place, surface.material);
    return surface;
}

fn world_from_local_direction(instance: InstanceRecord, direction: vec3<f32>) -> vec3<f32> {
    return instance.linear_x * direction.x + instance.linear_y * direction.y + instance.linear_z * direction.z;
}

// The interpolated normal, or the triangle's own. Vertex normals and winding may disagree, and a back face may be seen:
// the triangle's own normal is turned to the eye, and the vertex normals, as a triple, after it.
fn surface_normal(
    cluster: Cluster,
    corners: vec3<u32>,
    instance: InstanceRecord,
    weights: vec3<f32>,
    edge_ab: vec3<f32>,
    edge_ac: vec3<f32>,
    to_eye: vec3<f32>,
) -> vec3<f32> {
    let ab = safe_normalize(world_from_local_direction(instance, edge_ab), vec3<f32>(0.0));
    let ac = safe_normalize(world_from_local_direction(instance, edge_ac), vec3<f32>(0.0));
    let across = safe_normalize(cross(ab, ac), to_eye);
    let own = select(across, -across, dot(across, to_eye) < 0.0);
    if !cluster_has_normals(cluster) {
        return own;
    }
    let a = cluster_normal(cluster, corners.x);
    let b = cluster_normal(cluster, corners.y);
    let c = cluster_normal(cluster, corners.z);
    let mean = world_from_local_normal(instance, a + b + c);
    let smooth_normal = safe_normalize(
        world_from_local_normal(instance, a * weights.x + b * weights.y + c * weights.z),
        own,
    );
    return select(smooth_normal, -smooth_normal, dot(mean, own) < 0.0);
}

// Normals go by the cofactor matrix: the inverse transpose times the determinant, there for singular maps too. The sign
// that a mirroring map brings does not matter to `surface_normal`. Columns are scaled first: squares of small scales vanish.
fn world_from_local_normal(instance: InstanceRecord, normal: vec3<f32>) -> vec3<f32> {
    let scale = 1.0 / max(instance.max_scale, 1e-37);
    let x = instance.linear_x * scale;
    let y = instance.linear_y * scale;
    let z = instance.linear_z * scale;
    return cross(y, z) * normal.x + cross(z, x) * normal.y + cross(x, y) * normal.z;
}

fn surface_color(
    cluster: Cluster,
    corners: vec3<u32>,
    asset: AssetRecord,
    place: Barycentric,
    material_index: u32,
) -> vec3<f32> {
    let material = load_material(material_index);
    var color = material.base_color.rgb;
    if cluster_has_colors(cluster) {
        let a = cluster_color(cluster, corners.x).rgb;
        let b = cluster_color(cluster, corners.y).rgb;
        let c = cluster_color(cluster, corners.z).rgb;
        color *= a * place.weights.x + b * place.weights.y + c * place.weights.z;
    }
    if material.texture != NO_TEXTURE && cluster_has_uvs(cluster) {
        // Differences of the integers first: they stay exact however far from 0 the coordinates lie.
        let a = cluster_uv_q(cluster, corners.x);
        let ab = vec2<f32>(cluster_uv_q(cluster, corners.y) - a) * asset.uv_step;
        let ac = vec2<f32>(cluster_uv_q(cluster, corners.z) - a) * asset.uv_step;
        let uv = vec2<f32>(a) * asset.uv_step + ab * place.weights.y + ac * place.weights.z;
        let uv_dx = ab * place.weights_dx.y + ac * place.weights_dx.z;
        let uv_dy = ab * place.weights_dy.y + ac * place.weights_dy.z;
        color *= sample_texture(
            load_texture_record(material.texture),
            material.flags,
            transform_uv(material, vec3<f32>(uv, 1.0)),
            transform_uv(material, vec3<f32>(uv_dx, 0.0)),
            transform_uv(material, vec3<f32>(uv_dy, 0.0)),
        ).rgb;
    }
    return color;
}

// Perspective-correct weights of a triangle's corners at a pixel, and how they change over a pixel.
//
// Homogeneous edge functions (Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997), which
// hold for corners behind the eye too, about the pixel instead of the screen's centre: there the cross products do not
// cancel, so sub-pixel triangles keep their digits. Used as in Schied and Dachsbacher, "Deferred attribute interpolation", 2015.

struct Barycentric {
    weights: vec3<f32>,
    // Change over one pixel to the right and one pixel down.
    weights_dx: vec3<f32>,
    weights_dy: vec3<f32>,
}

// `ndc` is the pixel's centre, `pixel_in_ndc` the step to the next pixel to the right and down.
fn barycentric(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, ndc: vec2<f32>, pixel_in_ndc: vec2<f32>) -> Barycentric {
    let scale = 1.0 / max(max(abs(a.w), abs(b.w)), max(abs(c.w), 1e-37));
    let w = vec3<f32>(a.w, b.w, c.w) * scale;
    let x = vec3<f32>(a.x - ndc.x * a.w, b.x - ndc.x * b.w, c.x - ndc.x * c.w) * scale;
    let y = vec3<f32>(a.y - ndc.y * a.w, b.y - ndc.y * b.w, c.y - ndc.y * c.w) * scale;
    let edges = x.yzx * y.zxy - x.zxy * y.yzx;
    let edges_dx = (y.yzx * w.zxy - y.zxy * w.yzx) * pixel_in_ndc.x;
    let edges_dy = (x.zxy * w.yzx - x.yzx * w.zxy) * pixel_in_ndc.y;
    let sum = edges.x + edges.y + edges.z;
    // An edge-on or vanishing triangle: any inner point serves.
    if !(abs(sum) > 1e-30) {
        return Barycentric(vec3<f32>(1.0 / 3.0), vec3<f32>(0.0), vec3<f32>(0.0));
    }
    let exact = edges / sum;
    let dx = (edges_dx - exact * (edges_dx.x + edges_dx.y + edges_dx.z)) / sum;
    let dy = (edges_dy - exact * (edges_dy.x + edges_dy.y + edges_dy.z)) / sum;
    // The rasterizer snaps corners to 1/256 pixel, so a covered centre can lie outside, far outside of a sliver.
    let inside = max(exact, vec3<f32>(0.0));
    return Barycentric(inside / (inside.x + inside.y + inside.z), dx, dy);
}

// The error that a group's coarser replacement shows on the screen.
#import view

const ROOT_ERROR: f32 = 1e30;

// Rounding must not break monotony: a coarser group's projected error must never come out below a finer one's, or both
// would be drawn. So each level moves the sphere nearer, by this share of the largest coordinate it may reach; a group's
// replacements are members of groups of higher level. The radius counts twice, so that an enclosing sphere's largest
// coordinate is never the smaller one (|c|1 <= |C|1 + sqrt(3) (R - r)).
const LEVEL_SLACK: f32 = 9.5367431640625e-7;
// Above every level: hierarchy nodes, whose spheres enclose those of all groups below.
const NODE_LEVEL: f32 = 65.0;

// Bounds that keep a priority's bits ordered, positive and below the root groups'.
const SMALLEST_PRIORITY_PX: f32 = 1e-30;
const LARGEST_PRIORITY_PX: f32 = 1e29;
const ROOT_PRIORITY_PX: f32 = 1e30;

// Pixels that `error_metres` (local) covers at the nearest depth of the lod sphere (local metres).
fn projected_error_px(
    view: View,
    instance: InstanceRecord,
    lod_center: vec3<f32>,
    lod_radius: f32,
    error_metres: f32,
    level: f32,
) -> f32 {
    let center = rel_from_local(instance, view, lod_center);
    let radius = lod_radius * instance.max_scale;
    let slack = level * LEVEL_SLACK;
    let nearest = dot3(view.forward, center) - radius - slack * (sum3(abs(center)) + 2.0 * radius);
    let depth = max(nearest, view.near_metres);
    return error_metres * instance.max_scale * (1.0 + slack) * view.pixels_at_one_metre / depth;
}

// Whether the pixel error asks for more detail than a group's coarser replacement has. What nothing replaces is always
// wanted; where the projected error is not a number, nothing is.
fn error_wanted(view: View, error_metres: f32, projected_px: f32) -> bool {
    return is_reference(view) || error_metres >= ROOT_ERROR || projected_px > view.pixel_error_px;
}

// Bits of a streaming request's priority: they order as the priorities do and are never zero.
fn priority_bits(error_metres: f32, projected_px: f32) -> u32 {
    let px = select(
        min(max(projected_px, SMALLEST_PRIORITY_PX), LARGEST_PRIORITY_PX),
        ROOT_PRIORITY_PX,
        error_metres >= ROOT_ERROR,
    );
    return bitcast<u32>(px);
}

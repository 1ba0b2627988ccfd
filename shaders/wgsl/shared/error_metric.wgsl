// The error that a group's coarser replacement shows on the screen.
#import view

const ROOT_ERROR: f32 = 1e30;

// Rounding must not break monotony: a coarser group's projected error must never come out below a finer one's, or both
// would be drawn. So each level moves the sphere nearer, by this share of the largest coordinate it may reach; a group's
// replacements are members of groups of higher level. The radius counts twice, so that an enclosing sphere's largest
// coordinate is never the smaller one (|c|1 <= |C|1 + sqrt(3) (R - r)). The share outweighs, twice,
// the roundings of two divisions (2.5 units in the last place each) and two square roots (4.5) of
// the weakest GPU that WGSL allows.
const LEVEL_SLACK: f32 = 3.814697265625e-6;
// Above every level: hierarchy nodes, whose spheres enclose those of all groups below.
const NODE_LEVEL: f32 = 65.0;

// Bounds that keep a request's error bits ordered, positive and below the root groups'.
const SMALLEST_REQUEST_PX: f32 = 1e-30;
const LARGEST_REQUEST_PX: f32 = 1e29;
const ROOT_REQUEST_PX: f32 = 1e30;
// Units of a priority: its sums are integers, so that their order does not matter.
const PRIORITY_UNITS_A_PX: f32 = 64.0;
const MOST_PRIORITY: u32 = 0xffffffffu;

// Most pixels by which a visible surface in the lod sphere (local metres) moves when it moves by
// `error_metres` (local) in any direction.
//
// A point p at depth Z that moves by v to p', at depth Z', moves by F |v - v_z p / Z| / Z' on the
// screen, where F pixels show a metre at a metre's depth. That is at most F |v| / (Z' cos t) for p
// at the angle t off the axis (Cauchy and Schwarz), and Z' >= Z - |v|. Where p' alone is visible
// the same holds with p and p' exchanged. So the worst point is bounded by the least depth of the
// sphere and the least cosine, of the sphere or of the picture's corner, whichever is larger.
//
// The tangent of the sphere's worst angle is bounded by its largest distance from the axis over its
// least depth. Both bounds only get worse when a larger sphere encloses the sphere, the corner is
// the same for all, and errors grow towards the root: so the result grows from child to parent.
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
    let reach = radius + slack * (sum3(abs(center)) + 2.0 * radius);
    let nearest = dot3(view.forward, center) - reach;
    let depth = max(nearest, view.near_metres);
    // Divided first: squares of what is visible neither overflow nor vanish, whatever the scale.
    let across = cross3(view.forward, center) / depth;
    let tangent = sqrt(dot3(across, across)) + reach / depth;
    let secant = min(sqrt(1.0 + tangent * tangent), view.corner_secant);
    let moved = error_metres * instance.max_scale * (1.0 + slack);
    return moved * view.pixels_at_one_metre * secant / max(nearest - moved, view.near_metres);
}

// Whether the pixel error asks for more detail than a group's coarser replacement has. What nothing replaces is always
// wanted; where the projected error is not a number, nothing is.
fn error_wanted(view: View, error_metres: f32, projected_px: f32) -> bool {
    return is_reference(view) || error_metres >= ROOT_ERROR || projected_px > view.pixel_error_px;
}

// Bits of the error of a streaming request: they order as the errors do and are never zero.
fn request_bits(error_metres: f32, projected_px: f32) -> u32 {
    let px = select(
        min(max(projected_px, SMALLEST_REQUEST_PX), LARGEST_REQUEST_PX),
        ROOT_REQUEST_PX,
        error_metres >= ROOT_ERROR,
    );
    return bitcast<u32>(px);
}

// Share of one group of one instance in the priority of its pages: the error that they remove
// there, at most the picture's width and height, since beyond them a surface is just wrong; never
// zero.
fn priority_units(error_metres: f32, projected_px: f32, size_px: vec2<u32>) -> u32 {
    let most_px = f32(size_px.x + size_px.y);
    let px = select(min(max(projected_px, 0.0), most_px), most_px, error_metres >= ROOT_ERROR);
    return max(u32(px * PRIORITY_UNITS_A_PX), 1u);
}

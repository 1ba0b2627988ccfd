// From an asset's local space to space relative to the eye, the frustum test, and how 1D passes number their threads.
#import types

const NOT_INSTALLED: u32 = 0xffffffffu;
const TRIANGLE_BITS: u32 = 7u;
const VIEW_FLAG_REFERENCE: u32 = 1u;
const VIEW_FLAG_HARDWARE: u32 = 8u;
const VIEW_FLAG_MASKED: u32 = 16u;
const VIEW_FLAG_SECOND_ROUND: u32 = 256u;
const VIEW_FLAG_ORDERED: u32 = 512u;

// Threads of a workgroup of a 1D pass, and workgroups along x before y counts on.
const WORKGROUP_THREADS: u32 = 64u;
const MAX_WORKGROUPS_X: u32 = 65535u;

// Rounding that the frustum test allows for, as a share of the box's largest coordinate. A box around other boxes allows
// for twice as much, so that it never fails where one inside it passes.
const CLUSTER_SLACK: f32 = 9.5367431640625e-7;
const GROUP_SLACK: f32 = 1.9073486328125e-6;
const NODE_SLACK: f32 = 3.814697265625e-6;

// Number of the calling thread in a 1D pass.
fn thread_index(workgroup: vec3<u32>, local: u32) -> u32 {
    return (workgroup.y * MAX_WORKGROUPS_X + workgroup.x) * WORKGROUP_THREADS + local;
}

fn is_reference(view: View) -> bool {
    return (view.flags & VIEW_FLAG_REFERENCE) != 0u;
}

// A local point relative to the eye. High parts are near each other where it matters, so their difference is exact.
fn rel_from_local(instance: InstanceRecord, view: View, local: vec3<f32>) -> vec3<f32> {
    let origin = (instance.translation_high - view.eye_high) + (instance.translation_low - view.eye_low);
    return origin + instance.linear_x * local.x + instance.linear_y * local.y + instance.linear_z * local.z;
}

fn sum3(v: vec3<f32>) -> f32 {
    return v.x + v.y + v.z;
}

fn dot3(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

fn cross3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// Whether a local box touches the frustum: its support along each plane's normal, with `slack` for rounding. A box that is
// not finite passes.
fn aabb_in_frustum(
    instance: InstanceRecord,
    view: View,
    aabb_min: vec3<f32>,
    aabb_max: vec3<f32>,
    slack: f32,
) -> bool {
    let half_size = (aabb_max - aabb_min) * 0.5;
    let center = rel_from_local(instance, view, aabb_min + half_size);
    let edge_x = instance.linear_x * half_size.x;
    let edge_y = instance.linear_y * half_size.y;
    let edge_z = instance.linear_z * half_size.z;
    let allowed = sum3(abs(center) + (abs(edge_x) + abs(edge_y) + abs(edge_z))) * slack;
    for (var plane = 0u; plane < 5u; plane++) {
        let normal = view.planes_in_rel[plane].xyz;
        let reach = abs(dot3(normal, edge_x)) + abs(dot3(normal, edge_y)) + abs(dot3(normal, edge_z));
        let distance = dot3(normal, center) + view.planes_in_rel[plane].w;
        if distance + reach < -allowed {
            return false;
        }
    }
    return true;
}

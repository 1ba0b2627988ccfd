//! The camera, and the twin of `wgsl/shared/view.wgsl`.

use glam::{DVec3, Vec3};

use super::raster::needs_masked;
use crate::arrays::{SceneArrays, split};
use crate::types::{InstanceRecord, View, view_flag};

/// Rounding that the frustum test allows a cluster's box, as a share of its largest coordinate.
pub const CLUSTER_SLACK: f32 = 1.0 / (1 << 20) as f32;
/// The same for a group's box: twice as much, so that it never fails where a cluster's in it passes.
pub const GROUP_SLACK: f32 = 2.0 * CLUSTER_SLACK;
/// The same for boxes around groups' boxes.
pub const NODE_SLACK: f32 = 4.0 * CLUSTER_SLACK;
/// Threads of a workgroup of a 1D pass.
pub const WORKGROUP_THREADS: u32 = 64;
/// Threads of a workgroup of `restore`.
pub const RESTORE_THREADS: u32 = 256;
/// Most workgroups along x; y counts on.
pub const MAX_WORKGROUPS_X: u32 = 65_535;

/// Field of view of a camera that nobody set, degrees from bottom to top.
pub const DEFAULT_FOV_Y_DEGREES: f64 = 60.0;
const FOV_Y_DEGREES: std::ops::RangeInclusive<f64> = 0.001..=179.0;
/// Farthest near plane, metres.
const MAX_NEAR_METRES: f64 = 0.05;
/// Nearest near plane, metres: far inside the normal f32 numbers.
const MIN_NEAR_METRES: f64 = 1e-20;

/// A pinhole camera in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Where it stands, metres.
    pub eye: DVec3,
    /// The point that it looks at, metres.
    pub target: DVec3,
    /// Roughly upwards; any length.
    pub up: DVec3,
    /// Angle of view from the picture's bottom to its top, degrees.
    pub fov_y_degrees: f64,
    /// Width and height of the picture, pixels.
    pub size_px: [u32; 2],
}

/// A camera that shows nothing meaningful.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("camera {field}: expected {expected}, found {found}")]
pub struct CameraError {
    /// The camera's field.
    pub field: &'static str,
    /// What it may be.
    pub expected: &'static str,
    /// What it is.
    pub found: String,
}

/// Entries that the lists of a frame hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacities {
    /// Each node queue.
    pub nodes: u32,
    /// The candidate and the visible list, each.
    pub clusters: u32,
    /// The request list.
    pub requests: u32,
}

impl Capacities {
    /// No bound: for the twins, whose lists grow.
    pub const UNBOUNDED: Self = Self {
        nodes: u32::MAX,
        clusters: u32::MAX,
        requests: u32::MAX,
    };
}

impl Camera {
    /// Looks at the sphere from the front right, a little above, near enough that it fills the picture's smaller side.
    pub fn framing(center: DVec3, radius: f64, size_px: [u32; 2]) -> Self {
        let radius = if radius.is_finite() && radius > 0.0 {
            radius
        } else {
            1.0
        };
        let half_y = (0.5 * DEFAULT_FOV_Y_DEGREES).to_radians();
        let half_x = (half_y.tan() * aspect(size_px)).atan();
        let distance = 1.01 * radius / half_x.min(half_y).sin();
        Self {
            eye: center + DVec3::new(0.45, 0.35, 1.0).normalize() * distance,
            target: center,
            up: DVec3::Y,
            fov_y_degrees: DEFAULT_FOV_Y_DEGREES,
            size_px,
        }
    }

    /// The camera that a scene is shown with unless another is asked for: it frames the whole bounding sphere. A scene
    /// without instances gets the unit sphere at the origin.
    pub fn for_scene(arrays: &SceneArrays, size_px: [u32; 2]) -> Self {
        let (center, radius) = arrays.bounds_in_world().unwrap_or((DVec3::ZERO, 1.0));
        Self::framing(center, radius, size_px)
    }

    /// Names the first field that [`Camera::view`] would have to replace: for what a user typed.
    pub fn check(&self) -> Result<(), CameraError> {
        let fail = |field, expected, found: String| {
            Err(CameraError {
                field,
                expected,
                found,
            })
        };
        for (field, vector) in [("eye", self.eye), ("target", self.target), ("up", self.up)] {
            if !vector.is_finite() {
                return fail(field, "finite numbers", vector.to_string());
            }
        }
        let Some(forward) = direction(self.target - self.eye) else {
            return fail(
                "target",
                "a point other than the eye",
                self.target.to_string(),
            );
        };
        if direction(self.up)
            .and_then(|up| direction_across(forward, up))
            .is_none()
        {
            return fail("up", "a direction across the view", self.up.to_string());
        }
        if !FOV_Y_DEGREES.contains(&self.fov_y_degrees) {
            return fail("fov", "0.001..=179 degrees", self.fov_y_degrees.to_string());
        }
        if self.size_px.contains(&0) {
            return fail(
                "size",
                "at least one pixel a side",
                format!("{:?}", self.size_px),
            );
        }
        Ok(())
    }

    /// Right, up and forward: orthonormal whatever the fields hold. A camera whose target is its eye looks along -Z; one
    /// whose up lies along the view takes Y, or Z where Y does too.
    pub fn axes(&self) -> [DVec3; 3] {
        let forward = direction(self.target - self.eye).unwrap_or(DVec3::NEG_Z);
        let right = direction(self.up)
            .into_iter()
            .chain([DVec3::Y, DVec3::Z])
            .find_map(|up| direction_across(forward, up))
            .unwrap_or(DVec3::X);
        [right, right.cross(forward).normalize(), forward]
    }

    /// What the passes read. Counts and capacities are zero until [`View::with_scene`].
    pub fn view(&self, near_metres: f32, pixel_error_px: f32) -> View {
        let [right, up, forward] = self.axes();
        let fov_y = if self.fov_y_degrees.is_nan() {
            DEFAULT_FOV_Y_DEGREES
        } else {
            self.fov_y_degrees
                .clamp(*FOV_Y_DEGREES.start(), *FOV_Y_DEGREES.end())
        };
        let scale_y = 1.0 / (0.5 * fov_y).to_radians().tan();
        let scale_x = scale_y / aspect(self.size_px);
        let corner_secant = (1.0 + scale_x.powi(-2) + scale_y.powi(-2)).sqrt();
        let near_metres = near_metres.max(MIN_NEAR_METRES as f32);
        let column = |axis: usize| {
            [
                scale_x * right[axis],
                scale_y * up[axis],
                0.0,
                forward[axis],
            ]
            .map(|value| value as f32)
        };
        let plane = |normal: DVec3, offset: f32| {
            let normal = normal.normalize().as_vec3();
            [normal.x, normal.y, normal.z, offset]
        };
        let (eye_high, eye_low) = split(self.eye);
        View {
            clip_from_rel: [
                column(0),
                column(1),
                column(2),
                [0.0, 0.0, near_metres, 0.0],
            ],
            planes_in_rel: [
                plane(forward + right * scale_x, 0.0),
                plane(forward - right * scale_x, 0.0),
                plane(forward + up * scale_y, 0.0),
                plane(forward - up * scale_y, 0.0),
                plane(forward, -near_metres),
            ],
            eye_high,
            pixel_error_px,
            eye_low,
            pixels_at_one_metre: (self.size_px[1].max(1) as f64 * 0.5 * scale_y) as f32,
            forward: forward.as_vec3().into(),
            near_metres,
            size_px: self.size_px.map(|size| size.max(1)),
            instance_count: 0,
            page_count: 0,
            shade_mode: 0,
            flags: 0,
            node_capacity: 0,
            cluster_capacity: 0,
            request_capacity: 0,
            corner_secant: lodestream_format::bounds::round_up(corner_secant),
            node_row: 0,
            group_row: 0,
            part_row: 0,
            slot_row: 0,
            material_row: 0,
            texture_row: 0,
            proxy_row: 0,
            spare: [0; 3],
        }
    }
}

/// The near plane for a scene of a radius (metres): a ten-thousandth of it, at most five centimetres. Depth is reversed
/// and infinite, so a near plane close to the eye costs no precision far away; it only bounds how near detail is counted.
pub fn near_for_radius(radius_metres: f64) -> f32 {
    (1e-4 * radius_metres).clamp(MIN_NEAR_METRES, MAX_NEAR_METRES) as f32
}

fn aspect(size_px: [u32; 2]) -> f64 {
    size_px[0].max(1) as f64 / size_px[1].max(1) as f64
}

/// Unit vector along `vector` whatever its scale; `None` for zero and what is not finite.
fn direction(vector: DVec3) -> Option<DVec3> {
    let largest = vector.abs().max_element();
    (largest > 0.0 && vector.is_finite()).then(|| (vector / largest).normalize())
}

/// `forward x up`, unit, unless the two are parallel to within a millionth.
fn direction_across(forward: DVec3, up: DVec3) -> Option<DVec3> {
    let across = forward.cross(up);
    (across.length() > 1e-6).then(|| across.normalize())
}

impl View {
    /// Fills in the counts of a scene and the capacities of the frame's lists.
    pub fn with_scene(mut self, arrays: &SceneArrays, capacities: Capacities) -> Self {
        self.instance_count = arrays.instances.len() as u32;
        self.page_count = arrays.page_count;
        self.node_capacity = capacities.nodes;
        self.cluster_capacity = capacities.clusters;
        self.request_capacity = capacities.requests;
        if needs_masked(&arrays.materials) {
            self.flags |= view_flag::MASKED;
        }
        self
    }

    /// Whether everything is drawn in full detail.
    pub fn is_reference(&self) -> bool {
        self.flags & view_flag::REFERENCE != 0
    }
}

/// Workgroups along x, y and z of a 1D pass for `items`, where a workgroup takes `items_a_workgroup`.
pub fn workgroups(items: u32, items_a_workgroup: u32) -> [u32; 3] {
    let count = items.div_ceil(items_a_workgroup);
    [
        count.min(MAX_WORKGROUPS_X),
        count.div_ceil(MAX_WORKGROUPS_X),
        1,
    ]
}

/// A local point relative to the eye.
pub fn rel_from_local(instance: &InstanceRecord, view: &View, local: Vec3) -> Vec3 {
    let origin = (Vec3::from(instance.translation_high) - Vec3::from(view.eye_high))
        + (Vec3::from(instance.translation_low) - Vec3::from(view.eye_low));
    origin
        + Vec3::from(instance.linear_x) * local.x
        + Vec3::from(instance.linear_y) * local.y
        + Vec3::from(instance.linear_z) * local.z
}

pub(crate) fn sum3(v: Vec3) -> f32 {
    v.x + v.y + v.z
}

pub(crate) fn dot3(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

pub(crate) fn cross3(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(
        a.y * b.z - a.z * b.y,
        a.z * b.x - a.x * b.z,
        a.x * b.y - a.y * b.x,
    )
}

/// Whether a local box touches the frustum, with `slack` for rounding. A box that is not finite passes.
pub fn aabb_in_frustum(
    instance: &InstanceRecord,
    view: &View,
    aabb_min: [f32; 3],
    aabb_max: [f32; 3],
    slack: f32,
) -> bool {
    let aabb_min = Vec3::from(aabb_min);
    let half_size = (Vec3::from(aabb_max) - aabb_min) * 0.5;
    let center = rel_from_local(instance, view, aabb_min + half_size);
    let edge_x = Vec3::from(instance.linear_x) * half_size.x;
    let edge_y = Vec3::from(instance.linear_y) * half_size.y;
    let edge_z = Vec3::from(instance.linear_z) * half_size.z;
    let allowed = sum3(center.abs() + (edge_x.abs() + edge_y.abs() + edge_z.abs())) * slack;
    for plane in &view.planes_in_rel {
        let normal = Vec3::new(plane[0], plane[1], plane[2]);
        let reach =
            dot3(normal, edge_x).abs() + dot3(normal, edge_y).abs() + dot3(normal, edge_z).abs();
        let distance = dot3(normal, center) + plane[3];
        if distance + reach < -allowed {
            return false;
        }
    }
    true
}

#[cfg(test)]
#[path = "view_tests.rs"]
mod tests;

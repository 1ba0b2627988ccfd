//! What a visbuffer id shows at a pixel. Twin of `wgsl/shared/surface.wgsl`.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use lodestream_format::cluster_view::ClusterView;
use lodestream_format::octahedral;

use super::barycentric::Barycentric;
use super::fetch_vertex::{VisibleCluster, clip_from_local};
use super::light::safe_normalize;
use super::raster::pixel_center_in_ndc;
use super::sample_texture::sample_material;
use super::texture::Textures;
use super::view::rel_from_local;
use crate::SceneArrays;
use crate::types::{AssetRecord, InstanceRecord, MaterialRecord, View};

/// A triangle's point under a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Surface<'a> {
    /// The cluster.
    pub visible: VisibleCluster<'a>,
    /// Triangle in the cluster.
    pub triangle: u32,
    /// Index of the material.
    pub material_index: u32,
    /// The material itself.
    pub material: &'a MaterialRecord,
    /// Linear RGB, vertex colour and texture multiplied in.
    pub base_color: Vec3,
    /// Unit, world space, on the eye's side of the triangle.
    pub normal: Vec3,
    /// Unit, world space.
    pub to_eye: Vec3,
}

impl<'a> Surface<'a> {
    /// The point of triangle `triangle` of a visible cluster under the centre of `pixel`; `None` where the material index
    /// leaves its array, which no scene that was read has.
    pub fn new(
        visible: VisibleCluster<'a>,
        triangle: u32,
        pixel: [u32; 2],
        arrays: &'a SceneArrays,
        view: &View,
        textures: &Textures,
    ) -> Option<Self> {
        let VisibleCluster {
            instance,
            asset,
            cluster,
            ..
        } = visible;
        let corners = cluster.triangle(triangle);
        let [a, b, c] = corners.map(|vertex| visible.position_local(vertex));
        let (ndc, pixel_in_ndc) = pixel_center_in_ndc(view, pixel[0], pixel[1]);
        let clip = [a, b, c].map(|local| clip_from_local(view, instance, local));
        let place = Barycentric::at(clip, ndc, pixel_in_ndc);

        let local = a + (b - a) * place.weights.y + (c - a) * place.weights.z;
        let to_eye = safe_normalize(
            -rel_from_local(instance, view, local),
            -Vec3::from(view.forward),
        );
        let normal = surface_normal(
            &cluster,
            corners,
            instance,
            place.weights,
            b - a,
            c - a,
            to_eye,
        );
        let material_index = visible.material(arrays, triangle);
        let material = arrays.materials.get(material_index as usize)?;
        let base_color = surface_color(&cluster, corners, asset, &place, material, textures);
        Some(Self {
            visible,
            triangle,
            material_index,
            material,
            base_color,
            normal,
            to_eye,
        })
    }
}

fn world_from_local_direction(instance: &InstanceRecord, direction: Vec3) -> Vec3 {
    Vec3::from(instance.linear_x) * direction.x
        + Vec3::from(instance.linear_y) * direction.y
        + Vec3::from(instance.linear_z) * direction.z
}

fn surface_normal(
    cluster: &ClusterView<'_>,
    corners: [u32; 3],
    instance: &InstanceRecord,
    weights: Vec3,
    edge_ab: Vec3,
    edge_ac: Vec3,
    to_eye: Vec3,
) -> Vec3 {
    let ab = safe_normalize(world_from_local_direction(instance, edge_ab), Vec3::ZERO);
    let ac = safe_normalize(world_from_local_direction(instance, edge_ac), Vec3::ZERO);
    let across = safe_normalize(ab.cross(ac), to_eye);
    let own = if across.dot(to_eye) < 0.0 {
        -across
    } else {
        across
    };
    let [Some(a), Some(b), Some(c)] = corners.map(|vertex| cluster.normal(vertex)) else {
        return own;
    };
    let [a, b, c] = [a, b, c].map(|pair| Vec3::from(octahedral::decode(pair)));
    let mean = world_from_local_normal(instance, a + b + c);
    let smooth = safe_normalize(
        world_from_local_normal(instance, a * weights.x + b * weights.y + c * weights.z),
        own,
    );
    if mean.dot(own) < 0.0 { -smooth } else { smooth }
}

fn world_from_local_normal(instance: &InstanceRecord, normal: Vec3) -> Vec3 {
    let scale = 1.0 / instance.max_scale.max(1e-37);
    let [x, y, z] = [instance.linear_x, instance.linear_y, instance.linear_z]
        .map(|column| Vec3::from(column) * scale);
    y.cross(z) * normal.x + z.cross(x) * normal.y + x.cross(y) * normal.z
}

fn surface_color(
    cluster: &ClusterView<'_>,
    corners: [u32; 3],
    asset: &AssetRecord,
    place: &Barycentric,
    material: &MaterialRecord,
    textures: &Textures,
) -> Vec3 {
    let mut color = Vec4::from(material.base_color).xyz();
    if let [Some(a), Some(b), Some(c)] = corners.map(|vertex| cluster.color(vertex)) {
        let [a, b, c] =
            [a, b, c].map(|[r, g, b, _]| Vec3::from([r, g, b].map(|value| value as f32 / 255.0)));
        color *= a * place.weights.x + b * place.weights.y + c * place.weights.z;
    }
    if let [Some(a), Some(b), Some(c)] = corners.map(|vertex| cluster.uv(vertex)) {
        let scaled = |q: [i32; 2]| Vec2::from(q.map(|value| value as f32)) * asset.uv_step;
        let from_a = |q: [i32; 2]| scaled([q[0].wrapping_sub(a[0]), q[1].wrapping_sub(a[1])]);
        let (ab, ac) = (from_a(b), from_a(c));
        let change = |weights: Vec3| ab * weights.y + ac * weights.z;
        let uv = scaled(a) + ab * place.weights.y + ac * place.weights.z;
        color *= sample_material(
            textures,
            material,
            uv,
            change(place.weights_dx),
            change(place.weights_dy),
        )
        .xyz();
    }
    color
}

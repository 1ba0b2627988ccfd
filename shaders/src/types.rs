//! Structs that cross the bus to the GPU. `wgsl/shared/types.wgsl` declares the same names; a test compares sizes and
//! offsets by reflection.

use bytemuck::{Pod, Zeroable};

/// Entry of the page table for a page that culling must not use.
pub const NOT_INSTALLED: u32 = u32::MAX;
/// [`InstanceRecord::asset`] of a place without an instance, or of one that is hidden.
pub const NO_ASSET: u32 = u32::MAX;
/// [`MaterialRecord::mean_texel`] of a material without a texture.
pub const WHITE_TEXEL: u32 = u32::MAX;
/// Of [`ClusterItem::page`]: the item is a point, and the other bits are its pixel. Its `cluster`
/// is its colour, `page_word` the bits of its depth.
pub const POINT_FLAG: u32 = 1 << 31;
/// [`MaterialRecord::texture`] of a material without a base-colour texture.
pub const NO_TEXTURE: u32 = u32::MAX;
/// [`MaterialRecord::mask_cutoffs`] of a material without a table.
pub const NO_MASK_CUTOFFS: u32 = u32::MAX;
/// Bits of a visbuffer id that number the triangle inside its cluster.
pub const TRIANGLE_BITS: u32 = 7;

/// The camera and the frame's settings. Relative space ("rel") is world space with the eye at the origin: it keeps f32
/// exact near the eye however far the scene lies from the world's origin.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct View {
    /// Column-major; reversed depth: 1 at the near plane, towards 0 far away, no far plane.
    pub clip_from_rel: [[f32; 4]; 4],
    /// Left, right, bottom, top, near: a point is inside where `dot(n, p) + d >= 0` for all; unit normals.
    pub planes_in_rel: [[f32; 4]; 5],
    /// High part of the eye in world space, metres.
    pub eye_high: [f32; 3],
    /// Allowed projected error, pixels.
    pub pixel_error_px: f32,
    /// Low part of the eye: the eye is the sum.
    pub eye_low: [f32; 3],
    /// Pixels that one metre covers at one metre's depth: height / (2 tan(fov / 2)).
    pub pixels_at_one_metre: f32,
    /// Unit vector of view.
    pub forward: [f32; 3],
    /// Distance of the near plane, metres.
    pub near_metres: f32,
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// Instances in the scene.
    pub instance_count: u32,
    /// Pages in the scene.
    pub page_count: u32,
    /// What `shade` shows: a [`ShadeMode`] as a number.
    pub shade_mode: u32,
    /// Bits of [`view_flag`].
    pub flags: u32,
    /// Entries that each half of the node queues holds.
    pub node_capacity: u32,
    /// Entries that the candidate and visible lists hold, each.
    pub cluster_capacity: u32,
    /// Entries that the request list holds.
    pub request_capacity: u32,
    /// 1 / cos of the angle between the view axis and the picture's corner, rounded up.
    pub corner_secant: f32,
    /// First row of the hierarchy nodes in the scene's rows.
    pub node_row: u32,
    /// First row of the groups.
    pub group_row: u32,
    /// First row of the group parts.
    pub part_row: u32,
    /// First row of the material slots.
    pub slot_row: u32,
    /// First row of the materials.
    pub material_row: u32,
    /// First row of the texture records.
    pub texture_row: u32,
    /// First row of the proxies.
    pub proxy_row: u32,
    /// Zero.
    pub spare: [u32; 3],
}

/// Bits of [`View::flags`].
pub mod view_flag {
    /// Draw the finest level whole: no pixel-error test, no frustum test (`--reference`).
    pub const REFERENCE: u32 = 1;
    /// Of the occluder: its depths are tested.
    pub const OCCLUSION: u32 = 2;
    /// Of the occluder: its depths are this frame's, so hidden is hidden.
    pub const LATE: u32 = 4;
    /// Everything goes to the hardware rasterizer.
    pub const HARDWARE: u32 = 8;
    /// Some material of the scene can hide a fragment.
    pub const MASKED: u32 = 16;
    /// Of the second round of a visbuffer without 64-bit atomics: ids at the depths of the first.
    pub const SECOND_ROUND: u32 = 256;
    /// The hardware draws all visible clusters in the order of their indices.
    pub const ORDERED: u32 = 512;
}

/// What `shade` shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum ShadeMode {
    /// Materials and light.
    #[default]
    Shaded = 0,
    /// A colour a triangle.
    Triangles = 1,
    /// A colour a cluster.
    Clusters = 2,
    /// A colour a group.
    Groups = 3,
    /// A colour a level.
    Levels = 4,
    /// A colour a page.
    Pages = 5,
    /// View-space depth, logarithmic grey.
    Depth = 6,
    /// World-space normals.
    Normals = 7,
    /// Fragments a pixel.
    Overdraw = 8,
    /// Which rasterizer drew it.
    Raster = 9,
    /// A colour a material.
    Materials = 10,
    /// A colour an instance.
    Instances = 11,
}

/// An asset in the world. `world_from_local` has the asset's centre folded in.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct InstanceRecord {
    /// High part of the translation, metres.
    pub translation_high: [f32; 3],
    /// Index of the asset.
    pub asset: u32,
    /// Low part of the translation.
    pub translation_low: [f32; 3],
    /// Largest stretch of the linear part, rounded up.
    pub max_scale: f32,
    /// First column of the linear part.
    pub linear_x: [f32; 3],
    /// 1 where the linear part mirrors, else 0.
    pub mirrored: u32,
    /// Second column.
    pub linear_y: [f32; 3],
    /// Zero.
    pub spare_0: u32,
    /// Third column.
    pub linear_z: [f32; 3],
    /// Index of its proxy.
    pub proxy: u32,
}

/// Where an asset's arrays begin in the scene's.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct AssetRecord {
    /// First node; node references count from here.
    pub node_base: u32,
    /// First group.
    pub group_base: u32,
    /// First part.
    pub part_base: u32,
    /// First page: scene-wide page = base + page.
    pub page_base: u32,
    /// Smallest corner, local metres.
    pub aabb_min: [f32; 3],
    /// Metres a grid step.
    pub position_step: f32,
    /// Largest corner, local metres.
    pub aabb_max: [f32; 3],
    /// Texture widths a texture-grid step.
    pub uv_step: f32,
    /// `format::cluster::Attributes`.
    pub attributes: u32,
    /// First entry in the material slots.
    pub material_base: u32,
    /// Zero.
    pub spare: [u32; 2],
}

/// One hierarchy node of one instance, waiting for `cull_nodes`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
pub struct NodeItem {
    /// Index of the instance.
    pub instance: u32,
    /// Node, counted from the asset's first.
    pub node: u32,
}

/// One cluster of one instance: a candidate, or visible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
pub struct ClusterItem {
    /// Index of the instance.
    pub instance: u32,
    /// Scene-wide page.
    pub page: u32,
    /// Cluster in the page.
    pub cluster: u32,
    /// First word of the page in the pool.
    pub page_word: u32,
}

/// A page that culling wants, as the host reads it back.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RequestRecord {
    /// Scene-wide page.
    pub page: u32,
    /// Largest projected error of any group in it, of any instance, pixels.
    pub error_px: f32,
    /// Projected errors summed over groups and instances, in units of
    /// [`PRIORITY_UNITS_A_PX`](crate::cpu::error_metric::PRIORITY_UNITS_A_PX). Zero for a page
    /// whose groups are all hidden: then the error is theirs.
    pub priority: u32,
}

/// Counters of one frame; cleared to zero before it. Counts may pass the capacity: what did not fit was not written, and
/// the host sees by how much to grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Counters {
    /// Items in the node queue that `cull_nodes` reads.
    pub node_count: u32,
    /// Items that `cull_nodes` (or `cull_instances`) appended for the next level.
    pub next_node_count: u32,
    /// Candidate clusters.
    pub candidate_count: u32,
    /// Visible clusters.
    pub visible_count: u32,
    /// Requests.
    pub request_count: u32,
    /// Instances that passed.
    pub instances_drawn: u32,
    /// Hierarchy nodes visited.
    pub nodes_visited: u32,
    /// Triangles of the visible clusters.
    pub triangles_drawn: u32,
    /// Largest node queue of any level: what the capacity has to be.
    pub node_count_max: u32,
    /// Bits of the most pixels that the rounding of a visible surface to its grid may show, where
    /// they are more than the pixel error; else zero.
    pub rounding_px_bits: u32,
    /// Half of the node queues that `cull_nodes` reads, 0 or 1; it appends to the other.
    pub node_half: u32,
    /// Instances and children that the early pass rejected. Those past the capacity were not:
    /// they counted as visible.
    pub rejected_nodes: u32,
    /// Clusters that the early pass rejected.
    pub rejected_clusters: u32,
    /// Instances that both passes found hidden.
    pub hidden_instances: u32,
    /// Children of nodes that both found hidden.
    pub hidden_nodes: u32,
    /// Clusters that both found hidden.
    pub hidden_clusters: u32,
    /// First candidate of this pass; those that are decided about are skipped.
    pub first_candidate: u32,
    /// One past its last.
    pub last_candidate: u32,
    /// Visible clusters that were drawn or are about to be.
    pub drawn_count: u32,
    /// Those of them that the hardware draws.
    pub hardware_count: u32,
    /// Those that the compute rasterizer draws.
    pub compute_count: u32,
    /// Entries of the hardware's list that passes before drew.
    pub hardware_drawn: u32,
    /// Entries of the compute rasterizer's list that passes before drew.
    pub compute_drawn: u32,
    /// Draws of visible clusters: one a pass.
    pub draws: u32,
    /// Clusters of the first of them.
    pub early_count: u32,
    /// Instances drawn as points.
    pub point_count: u32,
}

/// Arguments of the indirect commands, in this order in one buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct IndirectArgs {
    /// `dispatch_workgroups_indirect` of `cull_nodes` and `cull_rejected`.
    pub nodes: [u32; 3],
    /// First entry of the draw in the hardware's list: WebGPU has no first instance in an indirect
    /// draw.
    pub first_hardware: u32,
    /// `dispatch_workgroups_indirect` of `cull_clusters`.
    pub clusters: [u32; 3],
    /// First entry of the dispatch in the compute rasterizer's list.
    pub first_compute: u32,
    /// `draw_indirect` of `raster`: vertices, instances, first vertex, first instance.
    pub raster: [u32; 4],
    /// `dispatch_workgroups_indirect` of `raster_compute`: a workgroup a cluster.
    pub compute: [u32; 3],
    /// Clusters of the dispatch.
    pub compute_count: u32,
}

/// Mean look of an asset with its materials: what a point shows.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ProxyRecord {
    /// Covered area along x, y and z, square metres.
    pub areas_m2: [f32; 3],
    /// 0 where areas add up as those of a sphere, 1 as those of a box.
    pub boxiness: f32,
    /// From +x, -x, +y, -y, +z, -z.
    pub sides: [ProxySideRecord; 6],
}

/// Mean look from one side, packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ProxySideRecord {
    /// Base colour r, g, b, then emissive r, g, b in parts of 16: halves of a word each, low half
    /// first. Then the normal x, y, z, a byte each, metallic and roughness, four bits each.
    pub words: [u32; 4],
}

/// One page to transcode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TranscodeJob {
    /// First word of the disk form in the staging buffer.
    pub disk_word: u32,
    /// First word of the cluster spans (`format::disk_form::ClusterSpan`) in the staging buffer.
    pub span_word: u32,
    /// First word of the page in the pool.
    pub pool_word: u32,
    /// First word of the material tables in the memory form.
    pub tables_word: u32,
    /// First of two words a parent in the staging buffer: its page's first word in the pool, its cluster there.
    pub parents_word: u32,
    /// First word of the page's vertices in the buffer of restored ones.
    pub restored_word: u32,
}

/// A material as `shade` reads it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MaterialRecord {
    /// Linear RGBA factor.
    pub base_color: [f32; 4],
    /// Linear RGB.
    pub emissive: [f32; 3],
    /// Smallest visible alpha; 0 unless masked.
    pub alpha_cutoff: f32,
    /// First row of the map from stored to looked-up texture coordinates.
    pub uv_row_u: [f32; 3],
    /// Index into the texture records, or [`NO_TEXTURE`].
    pub texture: u32,
    /// Second row.
    pub uv_row_v: [f32; 3],
    /// Bits of [`material_flag`].
    pub flags: u32,
    /// 0..=1.
    pub metallic: f32,
    /// 0..=1.
    pub roughness: f32,
    /// First word of its table of cutoffs in the texel buffer, or [`NO_MASK_CUTOFFS`].
    pub mask_cutoffs: u32,
    /// Mean of the texture, sRGB bytes; the alpha is the share that the cutoff leaves.
    pub mean_texel: u32,
}

/// Bits of [`MaterialRecord::flags`].
pub mod material_flag {
    /// Back faces are lit as fronts.
    pub const DOUBLE_SIDED: u32 = 1;
    /// The base colour is shown without light.
    pub const UNLIT: u32 = 2;
    /// Alpha below the cutoff is invisible.
    pub const MASK: u32 = 4;
    /// Magnification takes the nearest texel.
    pub const NEAREST: u32 = 8;
    /// u is clamped.
    pub const CLAMP_U: u32 = 16;
    /// v is clamped.
    pub const CLAMP_V: u32 = 32;
    /// u is mirrored.
    pub const MIRROR_U: u32 = 64;
    /// v is mirrored.
    pub const MIRROR_V: u32 = 128;
}

/// A texture in the texel buffer: RGBA, sRGB bytes a word, mip after mip, each half the last rounded down, down to 1 x 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TextureRecord {
    /// First word of mip 0.
    pub first_word: u32,
    /// Width of mip 0, texels.
    pub width: u32,
    /// Height of mip 0, texels.
    pub height: u32,
    /// Mips.
    pub mip_count: u32,
}

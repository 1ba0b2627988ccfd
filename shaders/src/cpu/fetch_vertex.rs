//! Visible items to triangles in clip space. Twin of `wgsl/shared/fetch_vertex.wgsl`.

use glam::{Vec3, Vec4};
use lodestream_format::cluster_view::ClusterView;

use super::snap::snapped_clip;
use super::view::rel_from_local;
use crate::SceneArrays;
use crate::types::{AssetRecord, ClusterItem, InstanceRecord, TRIANGLE_BITS, View};

/// A visible cluster with everything that its triangles are read through.
#[derive(Debug, Clone, Copy)]
pub struct VisibleCluster<'a> {
    /// The item itself.
    pub item: ClusterItem,
    /// Its instance.
    pub instance: &'a InstanceRecord,
    /// The instance's asset.
    pub asset: &'a AssetRecord,
    /// Its words in the pool.
    pub cluster: ClusterView<'a>,
}

impl<'a> VisibleCluster<'a> {
    /// Looks an item up; `None` where an index leaves its array, which no item of a cull pass does.
    pub fn new(item: ClusterItem, arrays: &'a SceneArrays, pool: &'a [u32]) -> Option<Self> {
        let instance = arrays.instances.get(item.instance as usize)?;
        let asset = arrays.assets.get(instance.asset as usize)?;
        let page = pool.get(item.page_word as usize..)?;
        let cluster = ClusterView::new(page, item.cluster)?;
        Some(Self {
            item,
            instance,
            asset,
            cluster,
        })
    }

    /// Local position of a vertex, metres, exact.
    pub fn position_local(&self, vertex: u32) -> Vec3 {
        let q = self.cluster.position_q(vertex);
        Vec3::from(q.map(|q| q as f32)) * self.asset.position_step
    }

    /// The corners of a triangle in clip space.
    pub fn triangle_clip(&self, view: &View, triangle: u32) -> [Vec4; 3] {
        self.cluster
            .triangle(triangle)
            .map(|vertex| clip_from_local(view, self.instance, self.position_local(vertex)))
            .map(|clip| snapped_clip(view, clip))
    }

    /// Index of the material of a triangle.
    pub fn material(&self, arrays: &SceneArrays, triangle: u32) -> u32 {
        let slot = self.asset.material_base + self.cluster.material_slot(triangle);
        arrays
            .material_slots
            .get(slot as usize)
            .copied()
            .unwrap_or(0)
    }
}

/// The visbuffer's word: nearer depths are larger, so the maximum is the front.
pub fn visbuffer_word(depth: f32, visible_index: u32, triangle: u32) -> u64 {
    (depth.to_bits() as u64) << 32 | (visible_index << TRIANGLE_BITS | triangle) as u64
}

/// A local point in clip space.
pub fn clip_from_local(view: &View, instance: &InstanceRecord, local: Vec3) -> Vec4 {
    let rel = rel_from_local(instance, view, local);
    let column = |index: usize| Vec4::from(view.clip_from_rel[index]);
    column(0) * rel.x + column(1) * rel.y + column(2) * rel.z + column(3)
}

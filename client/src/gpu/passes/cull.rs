//! Instances, then one dispatch a level of the hierarchy, then clusters: no forward progress between workgroups is assumed.

use std::mem::offset_of;

use lodestream_shaders::SceneArrays;
use lodestream_shaders::passes;
use lodestream_shaders::types::IndirectArgs;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::{Recorder, workgroups};

/// Culling down to streaming requests, and the part that only a picture needs.
#[derive(Debug)]
pub struct Cull {
    cull_instances: Bound,
    prepare_nodes: Bound,
    cull_nodes: Bound,
    clusters: Option<Clusters>,
    instance_count: u32,
    depth: u32,
    args: wgpu::Buffer,
}

#[derive(Debug)]
struct Clusters {
    prepare_clusters: Bound,
    cull_clusters: Bound,
    prepare_raster: Bound,
}

impl Cull {
    /// Binds the passes; `draws` adds those between the nodes and the rasterizer.
    pub fn new(parts: &mut Parts<'_>, arrays: &SceneArrays, draws: bool) -> Result<Self, GpuError> {
        let clusters = match draws {
            true => Some(Clusters {
                prepare_clusters: parts.bind(&passes::PREPARE_CLUSTERS)?,
                cull_clusters: parts.bind(&passes::CULL_CLUSTERS)?,
                prepare_raster: parts.bind(&passes::PREPARE_RASTER)?,
            }),
            false => None,
        };
        Ok(Self {
            cull_instances: parts.bind(&passes::CULL_INSTANCES)?,
            prepare_nodes: parts.bind(&passes::PREPARE_NODES)?,
            cull_nodes: parts.bind(&passes::CULL_NODES)?,
            clusters,
            instance_count: arrays.instances.len() as u32,
            depth: arrays.depth,
            args: parts.buffers.get("args").clone(),
        })
    }

    /// From all instances to candidates and page priorities.
    pub fn record_nodes(&self, recorder: &mut Recorder<'_>) {
        recorder.compute("cull_instances", |dispatches| {
            dispatches.run(&self.cull_instances, workgroups(self.instance_count));
        });
        recorder.compute("cull_nodes", |dispatches| {
            for _ in 0..self.depth {
                dispatches.run(&self.prepare_nodes, [1, 1, 1]);
                let offset = offset_of!(IndirectArgs, nodes);
                dispatches.run_indirect(&self.cull_nodes, &self.args, offset);
            }
        });
    }

    /// From candidates to visible clusters and the arguments of their draw.
    pub fn record_clusters(&self, recorder: &mut Recorder<'_>) {
        let Some(clusters) = &self.clusters else {
            return;
        };
        recorder.compute("cull_clusters", |dispatches| {
            dispatches.run(&clusters.prepare_clusters, [1, 1, 1]);
            let offset = offset_of!(IndirectArgs, clusters);
            dispatches.run_indirect(&clusters.cull_clusters, &self.args, offset);
            dispatches.run(&clusters.prepare_raster, [1, 1, 1]);
        });
    }
}

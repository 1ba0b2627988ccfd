//! Instances, then one dispatch a level of the hierarchy, then clusters: no forward progress between workgroups is assumed.
//! The late pass does the same from the rejects of the early one.

use std::mem::offset_of;

use lodestream_shaders::SceneArrays;
use lodestream_shaders::passes;
use lodestream_shaders::types::IndirectArgs;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::{Dispatches, Recorder, workgroups};

/// Culling down to streaming requests, and the parts that only a picture needs.
#[derive(Debug)]
pub struct Cull {
    cull_instances: Bound,
    prepare_nodes: Bound,
    cull_nodes: Bound,
    clusters: Option<Clusters>,
    late: Option<Late>,
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

#[derive(Debug)]
struct Late {
    prepare_rejected: Bound,
    cull_rejected: Bound,
    cull_nodes: Bound,
    cull_clusters: Bound,
}

impl Cull {
    /// Binds the passes; `draws` adds those between the nodes and the rasterizer.
    pub fn new(
        parts: &mut Parts<'_>,
        arrays: &SceneArrays,
        instance_count: u32,
        draws: bool,
    ) -> Result<Self, GpuError> {
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
            late: None,
            instance_count,
            depth: arrays.depth,
            args: parts.buffers.get("args").clone(),
        })
    }

    /// Binds the late pass, where it is not yet.
    pub fn add_late(&mut self, parts: &mut Parts<'_>) -> Result<(), GpuError> {
        if self.late.is_none() {
            self.late = Some(Late {
                prepare_rejected: parts.bind(&passes::PREPARE_REJECTED)?,
                cull_rejected: parts.bind_late(&passes::CULL_REJECTED)?,
                cull_nodes: parts.bind_late(&passes::CULL_NODES)?,
                cull_clusters: parts.bind_late(&passes::CULL_CLUSTERS)?,
            });
        }
        Ok(())
    }

    /// From all instances to candidates and page priorities.
    pub fn record_nodes(&self, recorder: &mut Recorder<'_>) {
        recorder.compute("cull_instances", |dispatches| {
            dispatches.run(&self.cull_instances, workgroups(self.instance_count));
        });
        recorder.compute("cull_nodes", |dispatches| {
            self.run_levels(dispatches, &self.cull_nodes);
        });
    }

    /// From candidates to visible clusters and the arguments of their draw.
    pub fn record_clusters(&self, recorder: &mut Recorder<'_>) {
        if let Some(clusters) = &self.clusters {
            recorder.compute("cull_clusters", |dispatches| {
                self.run_clusters(dispatches, clusters, &clusters.cull_clusters);
            });
        }
    }

    /// From the rejects of the early pass to the visible clusters among them.
    pub fn record_late(&self, recorder: &mut Recorder<'_>) {
        let (Some(clusters), Some(late)) = (&self.clusters, &self.late) else {
            return;
        };
        recorder.compute("late_cull_nodes", |dispatches| {
            dispatches.run(&late.prepare_rejected, [1, 1, 1]);
            let offset = offset_of!(IndirectArgs, nodes);
            dispatches.run_indirect(&late.cull_rejected, &self.args, offset);
            self.run_levels(dispatches, &late.cull_nodes);
        });
        recorder.compute("late_cull_clusters", |dispatches| {
            self.run_clusters(dispatches, clusters, &late.cull_clusters);
        });
    }

    fn run_levels(&self, dispatches: &mut Dispatches<'_>, cull_nodes: &Bound) {
        for _ in 0..self.depth {
            dispatches.run(&self.prepare_nodes, [1, 1, 1]);
            let offset = offset_of!(IndirectArgs, nodes);
            dispatches.run_indirect(cull_nodes, &self.args, offset);
        }
    }

    fn run_clusters(
        &self,
        dispatches: &mut Dispatches<'_>,
        clusters: &Clusters,
        cull_clusters: &Bound,
    ) {
        dispatches.run(&clusters.prepare_clusters, [1, 1, 1]);
        let offset = offset_of!(IndirectArgs, clusters);
        dispatches.run_indirect(cull_clusters, &self.args, offset);
        dispatches.run(&clusters.prepare_raster, [1, 1, 1]);
    }
}

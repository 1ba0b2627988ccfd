//! Every culling pass in frame order.

use super::compact_requests::compact_requests;
use super::cull_clusters::cull_clusters;
use super::cull_instances::cull_instances;
use super::cull_nodes::{cull_nodes, cull_rejected};
use super::occlusion::Occluder;
use super::prepare::{prepare_clusters, prepare_nodes, prepare_raster, prepare_rejected};
use super::visit::{CullInput, CullOutput};
use crate::arrays::SceneArrays;
use crate::types::{ClusterItem, Counters, IndirectArgs, RequestRecord, View};

/// What culling gives for one frame.
#[derive(Debug, Clone, Default)]
pub struct Culled {
    /// Clusters to draw, instance by instance in the hierarchy's order (the GPU's order is any).
    pub visible: Vec<ClusterItem>,
    /// Instances below a pixel, in the order of the instances.
    pub points: Vec<ClusterItem>,
    /// Clusters that `cull_clusters` looked at.
    pub candidates: Vec<ClusterItem>,
    /// Pages wanted, installed or not, by page number. The pixel error that is shown is the largest
    /// error among pages that are not installed, or the one asked for where there are none.
    pub requests: Vec<RequestRecord>,
    /// As the GPU leaves them after [`SceneArrays::depth`] rounds of nodes.
    pub counters: Counters,
    /// As the GPU leaves them.
    pub args: IndirectArgs,
}

/// Culls a frame without occlusion. `page_table` has a word a page of the scene: where its memory
/// form begins in `pool`, or [`NOT_INSTALLED`](crate::types::NOT_INSTALLED).
pub fn cut(arrays: &SceneArrays, view: &View, page_table: &[u32], pool: &[u32]) -> Culled {
    let input = CullInput {
        arrays,
        view,
        page_table,
        occluder: None,
    };
    cut_early(&input, pool).into_culled(view)
}

/// The early pass of a frame, or the only one: `input.occluder` has the last frame's depths.
pub fn cut_early(input: &CullInput<'_>, pool: &[u32]) -> Frame {
    let mut frame = cull_hierarchy(input);
    frame.cull_clusters(input, pool);
    frame
}

/// The late pass: `input.occluder` has the depths of the clusters that the early pass drew.
/// Items that both passes reject are hidden.
pub fn cut_late(input: &CullInput<'_>, occluder: &Occluder<'_>, frame: &mut Frame, pool: &[u32]) {
    let rejected = std::mem::take(&mut frame.output.rejected_nodes);
    let output = &mut frame.output;
    prepare_rejected(input.view, &output.counters, &mut frame.args);
    cull_rejected(input, occluder, &rejected, output);
    frame.cull_levels(input);
    frame.cull_clusters(input, pool);
}

/// The streaming requests of a frame, for whoever has no pages: they depend on the hierarchy alone.
pub fn requests_only(arrays: &SceneArrays, view: &View) -> (Vec<RequestRecord>, Counters) {
    let input = CullInput {
        arrays,
        view,
        page_table: &arrays.empty_page_table(),
        occluder: None,
    };
    let culled = cull_hierarchy(&input).into_culled(view);
    (culled.requests, culled.counters)
}

/// A frame on its way through the passes.
#[derive(Debug, Default)]
pub struct Frame {
    output: CullOutput,
    visible: Vec<ClusterItem>,
    args: IndirectArgs,
}

fn cull_hierarchy(input: &CullInput<'_>) -> Frame {
    let mut frame = Frame::default();
    frame.output.page_priority = vec![[0; 3]; input.arrays.page_count as usize];
    cull_instances(input, &mut frame.output);
    frame.cull_levels(input);
    frame
}

impl Frame {
    /// The clusters that are drawn so far.
    pub fn visible(&self) -> &[ClusterItem] {
        &self.visible
    }

    /// The counters so far.
    pub fn counters(&self) -> &Counters {
        &self.output.counters
    }

    fn cull_levels(&mut self, input: &CullInput<'_>) {
        let output = &mut self.output;
        for _ in 0..input.arrays.depth {
            prepare_nodes(input.view, &mut output.counters, &mut self.args);
            let node_queue_in = std::mem::take(&mut output.node_queue_out);
            cull_nodes(input, &node_queue_in, output);
        }
    }

    fn cull_clusters(&mut self, input: &CullInput<'_>, pool: &[u32]) {
        let output = &mut self.output;
        let counters = &mut output.counters;
        prepare_clusters(input.view, counters, &mut self.args);
        let tested = counters.first_candidate as usize..counters.last_candidate as usize;
        let candidates = &mut output.candidates[tested];
        cull_clusters(input, pool, candidates, counters, &mut self.visible);
        prepare_raster(input.view, counters, &mut self.args);
    }

    /// Ends the frame: the requests of all passes.
    pub fn into_culled(self, view: &View) -> Culled {
        let mut culled = Culled {
            visible: self.visible,
            points: self.output.points,
            candidates: self.output.candidates,
            requests: Vec::new(),
            counters: self.output.counters,
            args: self.args,
        };
        compact_requests(
            view,
            &self.output.page_priority,
            &mut culled.counters,
            &mut culled.requests,
        );
        culled
    }
}

//! Every culling pass in frame order.

use super::compact_requests::compact_requests;
use super::cull_clusters::cull_clusters;
use super::cull_instances::cull_instances;
use super::cull_nodes::{NodeOutput, cull_nodes};
use super::prepare::{prepare_clusters, prepare_nodes, prepare_raster};
use crate::arrays::SceneArrays;
use crate::types::{ClusterItem, Counters, IndirectArgs, RequestRecord, View};

/// What culling gives for one frame.
#[derive(Debug, Clone, Default)]
pub struct Culled {
    /// Clusters to draw, instance by instance in the hierarchy's order (the GPU's order is any).
    pub visible: Vec<ClusterItem>,
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

/// Culls a frame. `page_table` has a word a page of the scene: where its memory form begins in `pool`, or
/// [`NOT_INSTALLED`](crate::types::NOT_INSTALLED).
pub fn cut(arrays: &SceneArrays, view: &View, page_table: &[u32], pool: &[u32]) -> Culled {
    let mut culled = cull_hierarchy(arrays, view, page_table);
    let (counters, args) = (&mut culled.counters, &mut culled.args);
    prepare_clusters(view, counters, args);
    cull_clusters(
        arrays,
        view,
        page_table,
        pool,
        &culled.candidates,
        counters,
        &mut culled.visible,
    );
    prepare_raster(view, counters, args);
    culled
}

/// The streaming requests of a frame, for whoever has no pages: they depend on the hierarchy alone.
pub fn requests_only(arrays: &SceneArrays, view: &View) -> (Vec<RequestRecord>, Counters) {
    let culled = cull_hierarchy(arrays, view, &arrays.empty_page_table());
    (culled.requests, culled.counters)
}

fn cull_hierarchy(arrays: &SceneArrays, view: &View, page_table: &[u32]) -> Culled {
    let mut culled = Culled::default();
    let mut page_priority = vec![[0; 2]; arrays.page_count as usize];
    let (mut node_queue_in, mut node_queue_out) = (Vec::new(), Vec::new());
    cull_instances(arrays, view, &mut culled.counters, &mut node_queue_out);
    for _ in 0..arrays.depth {
        prepare_nodes(view, &mut culled.counters, &mut culled.args);
        std::mem::swap(&mut node_queue_in, &mut node_queue_out);
        node_queue_out.clear();
        let mut output = NodeOutput {
            node_queue_out: &mut node_queue_out,
            candidates: &mut culled.candidates,
            page_priority: &mut page_priority,
            counters: &mut culled.counters,
        };
        cull_nodes(arrays, view, page_table, &node_queue_in, &mut output);
    }
    compact_requests(
        view,
        &page_priority,
        &mut culled.counters,
        &mut culled.requests,
    );
    culled
}

//! The pass table. `assembly.rs` puts the sources together.
//!
//! A pass's bindings are all in group 0, numbered in the order of [`Pass::bindings`]. The page pool
//! comes last, as one or several bindings, because adapters bound the size of one. No stage binds
//! more than [`MAX_STORAGE_BUFFERS`] of them. `tests/reflection.rs` compares the table with the
//! WGSL.

/// Storage buffers that every WebGPU adapter binds in one stage.
pub const MAX_STORAGE_BUFFERS: u32 = 8;
/// Workgroup memory that every WebGPU adapter has, bytes.
pub const MAX_WORKGROUP_BYTES: u32 = 16_384;
/// Threads of a workgroup that every WebGPU adapter runs.
pub const MAX_WORKGROUP_THREADS: u32 = 256;

/// One entry point with what it reads and writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pass {
    /// Name of the pass, of its file and of its twin.
    pub name: &'static str,
    /// Entry points: one compute, or vertex and fragment.
    pub entry_points: &'static [&'static str],
    /// Variables bound in group 0 from binding 0 on, without the pool.
    pub bindings: &'static [Binding],
    /// Whether and how the pass uses the page pool.
    pub pool: PoolAccess,
    /// Its WGSL, imports not yet expanded.
    pub(crate) file: &'static str,
}

/// A variable of a pass and its buffer's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// Name of the variable and of the buffer.
    pub name: &'static str,
    /// How the pass uses it.
    pub access: Access,
}

/// How a pass uses a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// `var<uniform>`.
    Uniform,
    /// `var<storage, read>`.
    Read,
    /// `var<storage, read_write>`.
    Write,
}

/// How a pass uses the page pool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoolAccess {
    /// Not at all.
    None,
    /// `load_pool(word) -> u32`.
    Read,
    /// `store_pool(word, value)`.
    Write,
}

/// How the pool is cut into bindings of `1 << words_log2` words each (the last may be shorter).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PoolBindings {
    /// Bindings, at least one.
    pub count: u32,
    /// Base-two logarithm of the words of each.
    pub words_log2: u32,
}

const fn pass(
    name: &'static str,
    file: &'static str,
    entry_points: &'static [&'static str],
    bindings: &'static [Binding],
    pool: PoolAccess,
) -> Pass {
    Pass {
        name,
        entry_points,
        bindings,
        pool,
        file,
    }
}

const fn uniform(name: &'static str) -> Binding {
    let access = Access::Uniform;
    Binding { name, access }
}

const fn read(name: &'static str) -> Binding {
    let access = Access::Read;
    Binding { name, access }
}

const fn write(name: &'static str) -> Binding {
    let access = Access::Write;
    Binding { name, access }
}

const PREPARE_BINDINGS: &[Binding] = &[uniform("view"), write("counters"), write("args")];

const NODE_BINDINGS: &[Binding] = &[
    uniform("view"),
    uniform("occluder"),
    read("scene"),
    read("instances"),
    read("page_table"),
    read("hzb"),
    write("page_priority"),
    write("counters"),
    write("node_queues"),
    write("clusters"),
];

const RASTER_BINDINGS: &[Binding] = &[
    uniform("view"),
    read("scene"),
    read("instances"),
    read("clusters"),
    read("args"),
    read("draw_lists"),
    write("visbuffer"),
];

const HZB_BINDINGS: &[Binding] = &[uniform("view"), read("visbuffer"), write("hzb")];

/// Vertices of pages from differences, other clusters and parents, a workgroup a page.
pub const RESTORE: Pass = pass(
    "restore",
    include_str!("../wgsl/restore.wgsl"),
    &["restore"],
    &[read("transcode_jobs"), read("staging"), write("restored")],
    PoolAccess::Read,
);
/// Their normals, a workgroup a cluster.
pub const RESTORE_NORMALS: Pass = pass(
    "restore_normals",
    include_str!("../wgsl/restore_normals.wgsl"),
    &["restore_normals"],
    &[read("transcode_jobs"), read("staging"), write("restored")],
    PoolAccess::None,
);
/// Restored pages to memory form, a workgroup a cluster, one more a page for its header and tables.
pub const TRANSCODE: Pass = pass(
    "transcode",
    include_str!("../wgsl/transcode.wgsl"),
    &["transcode"],
    &[read("transcode_jobs"), read("staging"), read("restored")],
    PoolAccess::Write,
);
/// Instances in the frustum to root nodes, a thread an instance.
pub const CULL_INSTANCES: Pass = pass(
    "cull_instances",
    include_str!("../wgsl/cull_instances.wgsl"),
    &["cull_instances"],
    &[
        uniform("view"),
        uniform("occluder"),
        read("scene"),
        read("instances"),
        read("hzb"),
        write("counters"),
        write("node_queues"),
        write("clusters"),
    ],
    PoolAccess::None,
);
/// Turns the next level's count into this level's and into arguments, one thread.
pub const PREPARE_NODES: Pass = pass(
    "prepare_nodes",
    include_str!("../wgsl/prepare.wgsl"),
    &["prepare_nodes"],
    PREPARE_BINDINGS,
    PoolAccess::None,
);
/// One level of hierarchy nodes to nodes, candidates and requests, a thread a child.
pub const CULL_NODES: Pass = pass(
    "cull_nodes",
    include_str!("../wgsl/cull_nodes.wgsl"),
    &["cull_nodes"],
    NODE_BINDINGS,
    PoolAccess::None,
);
/// Arguments of `cull_rejected`, one thread.
pub const PREPARE_REJECTED: Pass = pass(
    "prepare_rejected",
    include_str!("../wgsl/prepare.wgsl"),
    &["prepare_rejected"],
    PREPARE_BINDINGS,
    PoolAccess::None,
);
/// Instances and children that the early pass rejected, tested once more, a thread an item.
pub const CULL_REJECTED: Pass = pass(
    "cull_rejected",
    include_str!("../wgsl/cull_nodes.wgsl"),
    &["cull_rejected"],
    NODE_BINDINGS,
    PoolAccess::None,
);
/// Arguments of `cull_clusters`, one thread.
pub const PREPARE_CLUSTERS: Pass = pass(
    "prepare_clusters",
    include_str!("../wgsl/prepare.wgsl"),
    &["prepare_clusters"],
    PREPARE_BINDINGS,
    PoolAccess::None,
);
/// Candidates to visible clusters, a thread a candidate.
pub const CULL_CLUSTERS: Pass = pass(
    "cull_clusters",
    include_str!("../wgsl/cull_clusters.wgsl"),
    &["cull_clusters"],
    &[
        uniform("view"),
        uniform("occluder"),
        read("scene"),
        read("instances"),
        read("page_table"),
        read("hzb"),
        write("counters"),
        write("clusters"),
        write("draw_lists"),
    ],
    PoolAccess::Read,
);
/// Arguments of `raster`, one thread.
pub const PREPARE_RASTER: Pass = pass(
    "prepare_raster",
    include_str!("../wgsl/prepare.wgsl"),
    &["prepare_raster"],
    PREPARE_BINDINGS,
    PoolAccess::None,
);
/// Visible clusters to the visbuffer, by the hardware rasterizer.
pub const RASTER: Pass = pass(
    "raster",
    include_str!("../wgsl/raster.wgsl"),
    &["raster_vertex", "raster_fragment"],
    RASTER_BINDINGS,
    PoolAccess::Read,
);
/// Small visible clusters to the visbuffer, a workgroup a cluster.
pub const RASTER_COMPUTE: Pass = pass(
    "raster_compute",
    include_str!("../wgsl/raster_compute.wgsl"),
    &["raster_compute"],
    RASTER_BINDINGS,
    PoolAccess::Read,
);
/// Points to the visbuffer, a thread a point.
pub const RASTER_POINTS: Pass = pass(
    "raster_points",
    include_str!("../wgsl/raster_points.wgsl"),
    &["raster_points"],
    &[
        uniform("view"),
        read("clusters"),
        write("counters"),
        write("visbuffer"),
    ],
    PoolAccess::None,
);
/// `raster` for scenes with masked materials: the fragment looks up alpha.
pub const RASTER_MASKED: Pass = pass(
    "raster_masked",
    include_str!("../wgsl/raster_masked.wgsl"),
    &["raster_vertex", "raster_fragment"],
    &[
        uniform("view"),
        read("scene"),
        read("instances"),
        read("clusters"),
        read("args"),
        read("draw_lists"),
        write("visbuffer"),
        read("texels"),
    ],
    PoolAccess::Read,
);
/// Fragments a pixel, for the overdraw picture alone.
pub const RASTER_OVERDRAW: Pass = pass(
    "raster_overdraw",
    include_str!("../wgsl/raster_overdraw.wgsl"),
    &["raster_vertex", "raster_fragment"],
    &[
        uniform("view"),
        read("scene"),
        read("instances"),
        read("clusters"),
        read("args"),
        read("draw_lists"),
        write("color"),
    ],
    PoolAccess::Read,
);
/// Ids and depths of the attachments into the visbuffer, a thread a pixel.
pub const RESOLVE: Pass = pass(
    "resolve",
    include_str!("../wgsl/resolve.wgsl"),
    &["resolve"],
    &[
        uniform("view"),
        read("attached_ids"),
        read("attached_depths"),
        write("visbuffer"),
    ],
    PoolAccess::None,
);
/// The visbuffer's depths to the pyramid of farthest depths, 64 x 64 pixels a workgroup.
pub const BUILD_HZB: Pass = pass(
    "build_hzb",
    include_str!("../wgsl/build_hzb.wgsl"),
    &["build_hzb"],
    HZB_BINDINGS,
    PoolAccess::None,
);
/// The pyramid's levels above the tiles', one workgroup.
pub const BUILD_HZB_TOP: Pass = pass(
    "build_hzb_top",
    include_str!("../wgsl/build_hzb.wgsl"),
    &["build_hzb_top"],
    HZB_BINDINGS,
    PoolAccess::None,
);
/// Visbuffer to colours, a thread a pixel.
pub const SHADE: Pass = pass(
    "shade",
    include_str!("../wgsl/shade.wgsl"),
    &["shade"],
    &[
        uniform("view"),
        read("scene"),
        read("instances"),
        read("clusters"),
        read("visbuffer"),
        read("texels"),
        write("color"),
        write("counters"),
    ],
    PoolAccess::Read,
);
/// Page priorities to a dense list for the host, a thread a page.
pub const COMPACT_REQUESTS: Pass = pass(
    "compact_requests",
    include_str!("../wgsl/compact_requests.wgsl"),
    &["compact_requests"],
    &[
        uniform("view"),
        read("page_priority"),
        write("counters"),
        write("requests"),
    ],
    PoolAccess::None,
);
/// Colours to the window's surface.
pub const PRESENT: Pass = pass(
    "present",
    include_str!("../wgsl/present.wgsl"),
    &["present_vertex", "present_fragment"],
    &[uniform("view"), read("color")],
    PoolAccess::None,
);

/// Every pass in frame order.
pub const ALL: [Pass; 22] = [
    RESTORE,
    RESTORE_NORMALS,
    TRANSCODE,
    CULL_INSTANCES,
    PREPARE_NODES,
    CULL_NODES,
    PREPARE_REJECTED,
    CULL_REJECTED,
    PREPARE_CLUSTERS,
    CULL_CLUSTERS,
    PREPARE_RASTER,
    RASTER,
    RASTER_COMPUTE,
    RASTER_POINTS,
    RASTER_MASKED,
    RASTER_OVERDRAW,
    RESOLVE,
    BUILD_HZB,
    BUILD_HZB_TOP,
    SHADE,
    COMPACT_REQUESTS,
    PRESENT,
];

impl Pass {
    /// Whether it is a rasterizer of the visbuffer: its WGSL depends on the target.
    pub fn has_target(&self) -> bool {
        self.file.lines().any(|line| line == "#import visbuffer")
    }

    /// The storage buffers that one stage binds, without the pool.
    pub fn storage_buffers(&self) -> u32 {
        let stored = |binding: &&Binding| binding.access != Access::Uniform;
        self.bindings.iter().filter(stored).count() as u32
    }
}

//! The numbers that bound every structure. Readers reject what exceeds them.

/// Bytes of a slot in the page pool, and the most that a page's memory form may take.
pub const PAGE_BYTES: usize = 128 * 1024;
/// Words (4 bytes) of [`PAGE_BYTES`].
pub const PAGE_WORDS: usize = PAGE_BYTES / 4;
/// Bytes that a builder aims at for the first root page of an asset that does not fit one root page whole.
pub const ROOT_PAGE_TARGET_BYTES: usize = 32 * 1024;
/// Granularity of places in the root arena, bytes.
pub const ROOT_ARENA_GRANULE_BYTES: usize = 256;
/// Most triangles of a cluster.
pub const MAX_CLUSTER_TRIANGLES: usize = 128;
/// Most vertices of a cluster.
pub const MAX_CLUSTER_VERTICES: usize = 256;
/// Most clusters of a page; bounds the tables that a reader builds.
pub const MAX_PAGE_CLUSTERS: usize = 2048;
/// Most bytes of a page's disk form before compression.
pub const MAX_DISK_FORM_BYTES: usize = 512 * 1024;
/// Most bits of one quantized coordinate inside a cluster, also of a texture coordinate.
pub const MAX_COORDINATE_BITS: u32 = 24;
/// An asset's extent is at most 2^23 grid steps an axis, so that local coordinates are exact in f32.
pub const MAX_EXTENT_STEPS: i64 = 1 << 23;
/// Most group parts (= pages) that one group may be split over.
pub const MAX_GROUP_PARTS: usize = 64;
/// Most levels of a DAG.
pub const MAX_LEVELS: usize = 63;
/// Material slots of one asset (u16 in the table; six bits each inline).
pub const MAX_MATERIAL_SLOTS: usize = 65_535;
/// Children of a hierarchy node.
pub const HIERARCHY_WIDTH: usize = 8;
/// Most levels of a hierarchy's nodes: culling takes a round a level, and eight-wide trees need
/// few.
pub const MAX_HIERARCHY_DEPTH: u32 = 64;
/// Most pages that one page may depend on.
pub const MAX_PAGE_DEPENDENCIES: usize = 65_535;
/// Most instances of a scene: a list takes 104 bytes for each.
pub const MAX_INSTANCES: usize = 1 << 24;
/// Most bytes of a decoded asset, scene or wire message (bincode's limit).
pub const MAX_MESSAGE_BYTES: usize = 1 << 30;
/// Most pages named by one `POST /v1/pages`.
pub const MAX_PAGES_A_REQUEST: usize = 65_536;
/// Most bytes of a scene's name.
pub const MAX_SCENE_NAME_BYTES: usize = 200;

//! An asset: one mesh's DAG. The object lists its pages and names its pack and hierarchy; its own hash is the asset's name.

use crate::bounds::Aabb;
use crate::cluster::Attributes;
use crate::error::{FormatError, ensure};
use crate::grid::Grid;
use crate::hash::ContentHash;
use crate::limits::{MAX_DISK_FORM_BYTES, MAX_MATERIAL_SLOTS, MAX_PAGE_DEPENDENCIES, PAGE_WORDS};
use crate::message;
use crate::proxy::Proxy;

const MAGIC: [u8; 4] = *b"LSA2";

/// Where a page lies in the pack, and what must be installed before it.
#[derive(Debug, Clone, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct PageEntry {
    /// First byte of the page's frame in the pack.
    pub offset: u64,
    /// Bytes of the frame.
    pub bytes: u32,
    /// Words of the memory form.
    pub memory_words: u32,
    /// Hash of the frame.
    pub hash: ContentHash,
    /// Pages of the groups that this page's groups refine, ascending, all smaller than the page itself.
    pub dependencies: Vec<u32>,
}

/// One mesh's DAG: pages coarse to fine, root pages first.
#[derive(Debug, Clone, PartialEq, bincode::Encode, bincode::Decode)]
pub struct Asset {
    /// Vertex attributes of every cluster.
    pub attributes: Attributes,
    /// Grid of the positions.
    pub position_grid: Grid,
    /// Grid of the texture coordinates.
    pub uv_grid: Grid,
    /// Grid index of the asset's centre in object space; clusters store positions relative to it.
    pub center_q: [i64; 3],
    /// Bounds of everything, local space (metres from the centre).
    pub aabb: Aabb,
    /// Material slots that the clusters name; a scene maps each to a material.
    pub material_slots: u32,
    /// Triangles of the source mesh.
    pub source_triangles: u64,
    /// Triangles of all clusters.
    pub dag_triangles: u64,
    /// Clusters of all pages.
    pub clusters: u64,
    /// Levels of the DAG, the source included.
    pub levels: u32,
    /// The object that holds the frames of all pages, in order, without gaps.
    pub pack: ContentHash,
    /// The [`crate::Hierarchy`] object.
    pub hierarchy: ContentHash,
    /// The look of the whole from afar.
    pub proxy: Proxy,
    /// The first pages, always resident.
    pub root_page_count: u32,
    /// Every page.
    pub pages: Vec<PageEntry>,
}

impl Asset {
    /// The object's bytes; hash them for the asset's name.
    pub fn encode(&self) -> Result<Vec<u8>, FormatError> {
        message::encode(MAGIC, self)
    }

    /// Reads and checks an asset object.
    pub fn decode(bytes: &[u8]) -> Result<Self, FormatError> {
        Self::decode_within(bytes, u64::MAX)
    }

    /// Reads and checks an asset object that may take `memory_bytes` with its message.
    pub fn decode_within(bytes: &[u8], memory_bytes: u64) -> Result<Self, FormatError> {
        let asset: Self = message::decode(MAGIC, bytes, memory_bytes)?;
        asset.check()?;
        Ok(asset)
    }

    /// Bytes that it takes in memory.
    pub fn memory_bytes(&self) -> u64 {
        let dependencies = self.pages.iter().map(|page| page.dependencies.len());
        let pages = size_of_val(&self.pages[..]) + 4 * dependencies.sum::<usize>();
        (pages + self.proxy.heap_bytes()) as u64
    }

    fn check(&self) -> Result<(), FormatError> {
        Grid::new(self.position_grid.step_exponent)?;
        Grid::new(self.uv_grid.step_exponent)?;
        ensure(
            self.attributes.0 & !Attributes::ALL == 0,
            "asset attributes",
            "at most 7",
            self.attributes.0,
        )?;
        let finite = self
            .aabb
            .min
            .iter()
            .chain(&self.aabb.max)
            .all(|value| value.is_finite());
        let ordered = (0..3).all(|axis| self.aabb.min[axis] <= self.aabb.max[axis]);
        ensure(
            finite && ordered,
            "asset bounds",
            "finite, min below max",
            format_args!("{:?}", self.aabb),
        )?;
        let slots = self.material_slots as usize;
        ensure(
            (1..=MAX_MATERIAL_SLOTS).contains(&slots),
            "asset material slots",
            "1..=65535",
            slots,
        )?;
        self.proxy.check(self.material_slots)?;
        let count = self.pages.len();
        ensure(
            count > 0 && count < u32::MAX as usize,
            "asset pages",
            "at least one",
            count,
        )?;
        let roots = self.root_page_count as usize;
        ensure(
            (1..=count).contains(&roots),
            "asset root pages",
            format_args!("1..={count}"),
            roots,
        )?;
        let mut offset = 0u64;
        for (page, entry) in self.pages.iter().enumerate() {
            let at = |field: &str| format!("asset page {page} {field}");
            ensure(entry.offset == offset, at("offset"), offset, entry.offset)?;
            let bytes = entry.bytes as usize;
            ensure(
                (1..=MAX_DISK_FORM_BYTES + 8).contains(&bytes),
                at("bytes"),
                "1..=524296",
                bytes,
            )?;
            let words = entry.memory_words as usize;
            ensure(
                (1..=PAGE_WORDS).contains(&words),
                at("memory words"),
                "1..=32768",
                words,
            )?;
            let ascending = entry.dependencies.is_sorted_by(|a, b| a < b)
                && entry.dependencies.len() <= MAX_PAGE_DEPENDENCIES;
            let earlier = entry
                .dependencies
                .last()
                .is_none_or(|&last| (last as usize) < page);
            ensure(
                ascending && earlier,
                at("dependencies"),
                format_args!("ascending, below {page}"),
                format_args!("{:?}", entry.dependencies),
            )?;
            offset += entry.bytes as u64;
        }
        Ok(())
    }

    /// Bytes of the whole pack.
    pub fn pack_bytes(&self) -> u64 {
        self.pages
            .last()
            .map_or(0, |entry| entry.offset + entry.bytes as u64)
    }

    /// The asset's centre in object space, metres, exact.
    pub fn center_in_object(&self) -> [f64; 3] {
        self.center_q.map(|q| self.position_grid.dequantize(q))
    }
}

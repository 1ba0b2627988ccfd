//! A page in disk form that passed every check: what it holds.

use super::{ClusterSpan, Layout, header_word};
use crate::cluster::Attributes;
use crate::memory_form::ClusterHeader;

/// A page in disk form that passed every check.
#[derive(Debug, Clone)]
pub struct DiskForm {
    pub(super) words: Vec<u32>,
    pub(super) layout: Layout,
    pub(super) headers: Vec<ClusterHeader>,
    pub(super) spans: Vec<ClusterSpan>,
    pub(super) parents: Vec<[u32; 2]>,
    pub(super) tables_word: u32,
}

impl DiskForm {
    /// The words of the staged form.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Where the sections lie.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Cluster headers; payload offsets and extents are zero, table offsets count from the first table, and the counts have the
    /// round from bit [`super::ROUND_SHIFT`].
    pub fn headers(&self) -> &[ClusterHeader] {
        &self.headers
    }

    /// Where each cluster's data begins.
    pub fn spans(&self) -> &[ClusterSpan] {
        &self.spans
    }

    /// Parents of all groups where any vertex is inherited: the page, smaller than this one's number, and the cluster in it.
    pub fn parents(&self) -> &[[u32; 2]] {
        &self.parents
    }

    /// Pages that must be in memory form before this one can be, ascending.
    pub fn parent_pages(&self) -> Vec<u32> {
        let mut pages: Vec<u32> = self.parents.iter().map(|parent| parent[0]).collect();
        pages.sort_unstable();
        pages.dedup();
        pages
    }

    /// Where every vertex of the page comes from, as `sources` words it.
    pub(super) fn sources(&self) -> &[u32] {
        &self.words[self.layout.sources..self.layout.vertex_planes]
    }

    /// Which vertex attributes the page has.
    pub fn attributes(&self) -> Attributes {
        Attributes(self.words[header_word::ATTRIBUTES])
    }

    /// The page's number in its asset.
    pub fn page(&self) -> u32 {
        self.words[header_word::PAGE]
    }

    /// Words of the memory form.
    pub fn memory_words(&self) -> usize {
        self.words[header_word::MEMORY_WORDS] as usize
    }

    /// First word of the material tables in the memory form.
    pub fn memory_tables_word(&self) -> u32 {
        self.tables_word
    }
}

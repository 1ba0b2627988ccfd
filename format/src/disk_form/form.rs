//! A page in disk form that passed every check: what it holds.

use super::{ClusterSpan, Layout, header_word};
use crate::cluster::{Attributes, Cluster};
use crate::memory_form::ClusterHeader;

/// A page in disk form that passed every check.
#[derive(Debug, Clone)]
pub struct DiskForm {
    pub(super) words: Vec<u32>,
    pub(super) layout: Layout,
    pub(super) headers: Vec<ClusterHeader>,
    pub(super) spans: Vec<ClusterSpan>,
    pub(super) tables_word: u32,
}

impl DiskForm {
    fn byte(&self, plane: usize, index: usize) -> u32 {
        self.words[plane + index / 4] >> (8 * (index % 4)) & 0xff
    }

    /// Vertex indices of a triangle of a cluster.
    pub fn triangle(&self, cluster: usize, triangle: u32) -> [u8; 3] {
        let index = (self.spans[cluster].first_triangle + triangle) as usize;
        std::array::from_fn(|corner| {
            self.byte(
                self.layout.index_planes + corner * self.layout.index_plane_words,
                index,
            ) as u8
        })
    }

    /// A vertex field ([`Layout::field_bytes`] order) less the cluster's smallest value.
    pub fn offset(&self, cluster: usize, field: usize, vertex: u32) -> u32 {
        let index = (self.spans[cluster].first_vertex + vertex) as usize;
        let plane = self.layout.field_plane(field);
        (0..self.layout.field_bytes[field]).fold(0, |value, byte| {
            value | self.byte(plane + byte * self.layout.vertex_plane_words, index) << (8 * byte)
        })
    }

    /// The words of the staged form, which `transcode` gathers from.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Where the sections lie.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Cluster headers; payload offsets are zero, table offsets count from the first table.
    pub fn headers(&self) -> &[ClusterHeader] {
        &self.headers
    }

    /// Where each cluster's data begins.
    pub fn spans(&self) -> &[ClusterSpan] {
        &self.spans
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

    /// Unpacks every cluster.
    pub fn clusters(&self) -> Vec<Cluster> {
        (0..self.headers.len())
            .map(|cluster| self.cluster(cluster))
            .collect()
    }

    fn cluster(&self, cluster: usize) -> Cluster {
        let header = &self.headers[cluster];
        let vertices = 0..header.vertex_count();
        let (origin, uv_min, color_min) = (header.origin(), header.uv_min(), header.color_min());
        let when = |flag| {
            if self.attributes().has(flag) {
                vertices.clone()
            } else {
                0..0
            }
        };
        Cluster {
            positions: vertices
                .clone()
                .map(|vertex| {
                    std::array::from_fn(|axis| {
                        origin[axis] + self.offset(cluster, axis, vertex) as i32
                    })
                })
                .collect(),
            normals: when(Attributes::NORMAL)
                .map(|vertex| {
                    std::array::from_fn(|axis| self.offset(cluster, 3 + axis, vertex) as u16)
                })
                .collect(),
            uvs: when(Attributes::UV)
                .map(|vertex| {
                    std::array::from_fn(|axis| {
                        uv_min[axis] + self.offset(cluster, 5 + axis, vertex) as i32
                    })
                })
                .collect(),
            colors: when(Attributes::COLOR)
                .map(|vertex| {
                    std::array::from_fn(|c| {
                        color_min[c] + self.offset(cluster, 7 + c, vertex) as u8
                    })
                })
                .collect(),
            triangles: (0..header.triangle_count())
                .map(|triangle| self.triangle(cluster, triangle))
                .collect(),
            materials: self.materials(cluster).unwrap_or_default(),
            level: header.level() as u8,
            group: header.group(),
            child_group: header.child_group(),
        }
    }
}

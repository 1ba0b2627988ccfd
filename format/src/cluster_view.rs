//! Random access into a memory form, and back to clusters.

use crate::bits::read_bits;
use crate::cluster::{Attributes, Cluster, MaterialRange};
use crate::memory_form::{
    CLUSTER_HEADER_WORDS, ClusterHeader, PAGE_HEADER_WORDS, cluster_word, page_word,
};
use crate::octahedral::NORMAL_BITS;
use crate::strips::Strips;

/// Random access into one cluster of a memory form that this program wrote (by [`crate::memory_form::encode`] or from a checked disk form).
/// Reads past the words give zeros.
#[derive(Debug, Clone, Copy)]
pub struct ClusterView<'a> {
    page: &'a [u32],
    /// The cluster's header.
    pub header: ClusterHeader,
    attributes: Attributes,
}

impl<'a> ClusterView<'a> {
    /// Cluster `index` of `page`; `None` past the page's clusters.
    pub fn new(page: &'a [u32], index: u32) -> Option<Self> {
        if index >= *page.get(page_word::CLUSTER_COUNT)? {
            return None;
        }
        let first = PAGE_HEADER_WORDS + index as usize * CLUSTER_HEADER_WORDS;
        let words = page.get(first..first + CLUSTER_HEADER_WORDS)?;
        let header = ClusterHeader(words.try_into().ok()?);
        Some(Self {
            page,
            header,
            attributes: Attributes(page[page_word::ATTRIBUTES]),
        })
    }

    fn payload(&self) -> &'a [u32] {
        self.page
            .get(self.header.0[cluster_word::PAYLOAD] as usize..)
            .unwrap_or(&[])
    }

    fn strips(&self) -> Strips<'a> {
        let header = &self.header;
        Strips::new(self.payload(), header.triangle_count(), header.index_bits())
    }

    /// Vertex indices of a triangle.
    pub fn triangle(&self, triangle: u32) -> [u32; 3] {
        self.strips().triangle(triangle)
    }

    fn field(&self, vertex: u32, before: u32, bits: u32) -> u32 {
        let first = self.header.strip_words() * 32
            + (vertex * self.header.vertex_bits(self.attributes) + before) as usize;
        read_bits(self.payload(), first, bits)
    }

    /// Grid indices of a vertex, relative to the asset's centre.
    pub fn position_q(&self, vertex: u32) -> [i32; 3] {
        let (widths, origin) = (self.header.widths(), self.header.origin());
        let mut before = 0;
        std::array::from_fn(|axis| {
            let value = self.field(vertex, before, widths[axis]);
            before += widths[axis];
            origin[axis] + value as i32
        })
    }

    /// Octahedral pair of a vertex, where the asset has normals.
    pub fn normal(&self, vertex: u32) -> Option<[u16; 2]> {
        let [x, y, z, ..] = self.header.widths();
        self.attributes.has(Attributes::NORMAL).then(|| {
            std::array::from_fn(|c| {
                self.field(vertex, x + y + z + c as u32 * NORMAL_BITS, NORMAL_BITS) as u16
            })
        })
    }

    /// Texture coordinates of a vertex on the texture grid, where the asset has them.
    pub fn uv(&self, vertex: u32) -> Option<[i32; 2]> {
        let [x, y, z, u, v] = self.header.widths();
        let before = x
            + y
            + z
            + if self.attributes.has(Attributes::NORMAL) {
                2 * NORMAL_BITS
            } else {
                0
            };
        let min = self.header.uv_min();
        self.attributes.has(Attributes::UV).then(|| {
            [
                min[0].wrapping_add(self.field(vertex, before, u) as i32),
                min[1].wrapping_add(self.field(vertex, before + u, v) as i32),
            ]
        })
    }

    /// RGBA of a vertex, where the asset has colours.
    pub fn color(&self, vertex: u32) -> Option<[u8; 4]> {
        let (widths, min) = (self.header.color_widths(), self.header.color_min());
        let mut before = self.header.vertex_bits(self.attributes)
            - widths
                .iter()
                .sum::<u32>()
                .min(self.header.vertex_bits(self.attributes));
        self.attributes.has(Attributes::COLOR).then(|| {
            std::array::from_fn(|c| {
                let value = self.field(vertex, before, widths[c]);
                before += widths[c];
                min[c].wrapping_add(value as u8)
            })
        })
    }

    /// Material slot of a triangle.
    pub fn material_slot(&self, triangle: u32) -> u32 {
        let word = self.header.0[cluster_word::MATERIALS];
        if self.header.has_material_table() {
            let table = self.page.get(word as usize..).unwrap_or(&[]);
            let mut last = 0;
            for range in table
                .iter()
                .skip(1)
                .take(table.first().copied().unwrap_or(0) as usize)
            {
                last += range >> 16;
                if triangle < last {
                    return range & 0xffff;
                }
            }
            return 0;
        }
        let first = (word >> 18 & 0x7f) + 1;
        let second = first + (word >> 25);
        let shift = if triangle < first {
            0
        } else if triangle < second {
            6
        } else {
            12
        };
        word >> shift & 0x3f
    }

    /// The cluster unpacked.
    pub fn cluster(&self) -> Cluster {
        let vertices = 0..self.header.vertex_count();
        let slots = (0..self.header.triangle_count()).map(|it| self.material_slot(it));
        let mut materials: Vec<MaterialRange> = Vec::new();
        for slot in slots {
            match materials.last_mut() {
                Some(last) if u32::from(last.slot) == slot => last.triangle_count += 1,
                _ => materials.push(MaterialRange {
                    slot: slot as u16,
                    triangle_count: 1,
                }),
            }
        }
        Cluster {
            positions: vertices.clone().map(|it| self.position_q(it)).collect(),
            normals: vertices.clone().filter_map(|it| self.normal(it)).collect(),
            uvs: vertices.clone().filter_map(|it| self.uv(it)).collect(),
            colors: vertices.filter_map(|it| self.color(it)).collect(),
            triangles: self.strips().triangles().collect(),
            materials,
            level: self.header.level() as u8,
            group: self.header.group(),
            child_group: self.header.child_group(),
        }
    }
}

/// The clusters of a page in memory form.
pub fn clusters(page: &[u32]) -> impl Iterator<Item = Cluster> + '_ {
    (0..)
        .map_while(|index| ClusterView::new(page, index))
        .map(|view| view.cluster())
}

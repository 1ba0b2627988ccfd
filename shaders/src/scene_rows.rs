//! The scene's records that never change, laid out for one buffer: rows of four words, as
//! `wgsl/shared/scene.wgsl` reads them.

use bytemuck::{Pod, cast_slice};

use crate::arrays::SceneArrays;
use crate::types::{MaterialRecord, TextureRecord, View};

/// Bytes of a row.
pub const ROW_BYTES: usize = 16;

/// Rows of a scene, and where each kind of record begins. Assets begin at row 0.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SceneRows {
    /// The rows.
    pub rows: Vec<[u32; 4]>,
    /// First rows of the records.
    pub first: FirstRows,
}

/// First row of each kind of record behind the assets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FirstRows {
    /// Hierarchy nodes.
    pub nodes: u32,
    /// Groups.
    pub groups: u32,
    /// Group parts, two a row.
    pub parts: u32,
    /// Material slots, four a row.
    pub slots: u32,
    /// Materials.
    pub materials: u32,
    /// Texture records.
    pub textures: u32,
    /// Proxies.
    pub proxies: u32,
}

impl SceneRows {
    /// The records of `arrays`, with `materials` instead of its own, and `textures`.
    pub fn new(
        arrays: &SceneArrays,
        materials: &[MaterialRecord],
        textures: &[TextureRecord],
    ) -> Self {
        let mut rows = Self::default();
        rows.append(&arrays.assets);
        rows.first = FirstRows {
            nodes: rows.append(&arrays.nodes),
            groups: rows.append(&arrays.groups),
            parts: rows.append(&arrays.parts),
            slots: rows.append(&arrays.material_slots),
            materials: rows.append(materials),
            textures: rows.append(textures),
            proxies: rows.append(&arrays.proxy_records(materials)),
        };
        rows
    }

    /// Appends records from a new row on and returns its index. A record that does not fill whole
    /// rows shares them with its neighbours.
    fn append<T: Pod>(&mut self, records: &[T]) -> u32 {
        const {
            let record = size_of::<T>();
            assert!(record.is_multiple_of(ROW_BYTES) || ROW_BYTES.is_multiple_of(record));
        }
        let first = self.rows.len();
        let bytes: &[u8] = cast_slice(records);
        self.rows
            .resize(first + bytes.len().div_ceil(ROW_BYTES), [0; 4]);
        let target: &mut [u8] = bytemuck::cast_slice_mut(&mut self.rows[first..]);
        target[..bytes.len()].copy_from_slice(bytes);
        first as u32
    }
}

impl View {
    /// The view of a scene whose records lie at `first`.
    pub fn with_rows(self, first: FirstRows) -> Self {
        Self {
            node_row: first.nodes,
            group_row: first.groups,
            part_row: first.parts,
            slot_row: first.slots,
            material_row: first.materials,
            texture_row: first.textures,
            proxy_row: first.proxies,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_begin_at_whole_rows() {
        let arrays = SceneArrays {
            material_slots: vec![7, 8, 9, 10, 11],
            ..SceneArrays::default()
        };
        let texture = TextureRecord {
            first_word: 1,
            width: 2,
            height: 3,
            mip_count: 4,
        };
        let rows = SceneRows::new(&arrays, &[], &[texture]);
        assert_eq!(rows.first.slots, 0);
        assert_eq!(rows.first.textures, 2);
        let expected = [[7, 8, 9, 10], [11, 0, 0, 0], [1, 2, 3, 4]];
        assert_eq!(rows.rows, expected);
        assert_eq!(
            bytemuck::bytes_of(&texture),
            cast_slice::<_, u8>(&rows.rows[2..])
        );
    }
}

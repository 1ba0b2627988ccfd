//! The checks of one cluster before its vertices are known: header, materials.

use super::{DiskForm, ROUND_SHIFT};
use crate::bits::bits_for;
use crate::cluster::{Attributes, MaterialRange};
use crate::error::{FormatError, ensure};
use crate::limits::{MAX_COORDINATE_BITS, MAX_EXTENT_STEPS};
use crate::memory_form::{ClusterHeader, MATERIAL_TABLE_FLAG, cluster_word};

impl DiskForm {
    pub(super) fn check_cluster(
        &self,
        cluster: usize,
        attributes: Attributes,
    ) -> Result<(), FormatError> {
        let header = &self.headers[cluster];
        let within = |error| within(error, cluster);
        for (axis, low) in header.origin().into_iter().enumerate() {
            // The largest offset has the highest of its bits: how far it reaches at least. What it is shows when values are known.
            let bits = header.widths()[axis];
            let high = i64::from(low) + (1i64 << bits >> 1);
            ensure(
                i64::from(low) >= -MAX_EXTENT_STEPS && high <= MAX_EXTENT_STEPS,
                "position",
                "within 2^23 steps of the centre",
                format_args!("{low} and {bits} bits on axis {axis}"),
            )
            .map_err(within)?;
        }
        for (channel, low) in header.color_min().into_iter().enumerate() {
            let high = u32::from(low) + (1 << header.color_widths()[channel] >> 1);
            ensure(high <= 255, "colour", "at most 255", high).map_err(within)?;
        }
        if attributes.has(Attributes::UV) {
            for min in header.uv_min() {
                let most = i32::MAX - (1 << MAX_COORDINATE_BITS);
                ensure(
                    (-most..=most).contains(&min),
                    "texture coordinate",
                    format_args!("-{most}..={most}"),
                    min,
                )
                .map_err(within)?;
            }
        }
        self.check_materials(cluster).map_err(within)
    }

    /// Material ranges of a cluster.
    pub fn materials(&self, cluster: usize) -> Vec<MaterialRange> {
        // They were read when the form was checked.
        self.read_materials(cluster).unwrap_or_default()
    }

    fn check_materials(&self, cluster: usize) -> Result<(), FormatError> {
        let header = &self.headers[cluster];
        let ranges = self.read_materials(cluster)?;
        let sum: u32 = ranges.iter().map(|range| range.triangle_count as u32).sum();
        ensure(
            sum == header.triangle_count(),
            "triangles in material ranges",
            header.triangle_count(),
            sum,
        )?;
        let empty = ranges
            .iter()
            .filter(|range| range.triangle_count == 0)
            .count();
        ensure(empty == 0, "empty material ranges", 0, empty)
    }

    fn read_materials(&self, cluster: usize) -> Result<Vec<MaterialRange>, FormatError> {
        let header = &self.headers[cluster];
        let word = header.0[cluster_word::MATERIALS];
        if header.has_material_table() {
            let tables = &self.words[self.layout.tables..];
            let count = *tables.get(word as usize).ok_or_else(|| {
                FormatError::new(
                    "material table",
                    format!("an offset below {}", tables.len()),
                    word,
                )
            })?;
            let first = word as usize + 1;
            let ranges = tables
                .get(first..first.saturating_add(count as usize))
                .filter(|_| count <= 128)
                .ok_or_else(|| {
                    FormatError::new(
                        "material table ranges",
                        "at most 128, inside the tables",
                        count,
                    )
                })?;
            return Ok(ranges
                .iter()
                .map(|&range| MaterialRange {
                    slot: range as u16,
                    triangle_count: (range >> 16) as u16,
                })
                .collect());
        }
        let total = header.triangle_count() as u16;
        let first = ((word >> 18 & 0x7f) + 1) as u16;
        let second = (word >> 25) as u16;
        ensure(
            first + second <= total,
            "inline material runs",
            format_args!("at most {total}"),
            first + second,
        )?;
        let third = total - first - second;
        let slot = |index: u32| (word >> (6 * index) & 0x3f) as u16;
        Ok([(0, first), (1, second), (2, third)]
            .into_iter()
            .filter(|&(_, run)| run > 0)
            .map(|(index, run)| MaterialRange {
                slot: slot(index),
                triangle_count: run,
            })
            .collect())
    }
}

pub(super) fn check_header(
    header: &ClusterHeader,
    attributes: Attributes,
) -> Result<(), FormatError> {
    let triangles = header.triangle_count();
    ensure(
        (1..=128).contains(&triangles),
        "triangles",
        "1..=128",
        triangles,
    )?;
    let vertices = header.vertex_count();
    ensure(
        (1..=256).contains(&vertices),
        "vertices",
        "1..=256",
        vertices,
    )?;
    let counts = triangles | vertices << 8 | header.level() << 17 | header.index_bits() << 24;
    let spare = header.0[cluster_word::COUNTS] & !MATERIAL_TABLE_FLAG & ((1 << ROUND_SHIFT) - 1);
    ensure(
        spare == counts,
        "spare bits of the counts",
        hex(counts),
        hex(spare),
    )?;
    let index_bits = bits_for(vertices - 1);
    ensure(
        header.index_bits() == index_bits,
        "index bits",
        index_bits,
        header.index_bits(),
    )?;
    header.check_coordinate_bits()?;
    for axis in 3..5 {
        let bits = header.widths()[axis];
        let most = if attributes.has(Attributes::UV) {
            MAX_COORDINATE_BITS
        } else {
            0
        };
        ensure(
            bits <= most,
            "bits of a texture coordinate",
            format_args!("at most {most}"),
            bits,
        )?;
    }
    let most = if attributes.has(Attributes::COLOR) {
        8
    } else {
        0
    };
    let widest = header.color_widths().into_iter().max().unwrap_or(0);
    ensure(
        widest <= most,
        "bits of a colour",
        format_args!("at most {most}"),
        widest,
    )?;
    for (word, used) in [(cluster_word::WIDTHS, 25), (cluster_word::COLOR_WIDTHS, 16)] {
        ensure(
            header.0[word] >> used == 0,
            "spare bits of the widths",
            0,
            header.0[word] >> used,
        )?;
    }
    Ok(())
}

pub(super) fn within(error: FormatError, cluster: usize) -> FormatError {
    FormatError {
        at: format!("cluster {cluster}: {}", error.at),
        ..error
    }
}

pub(super) fn hex(word: u32) -> String {
    format!("{word:#010x}")
}

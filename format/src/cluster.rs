//! A cluster as the builder makes it and a page gives it back: quantized, unpacked.

use crate::bounds::Aabb;
use crate::error::{FormatError, ensure};
use crate::grid::Grid;
use crate::limits::{MAX_CLUSTER_TRIANGLES, MAX_CLUSTER_VERTICES, MAX_EXTENT_STEPS};

/// [`Cluster::child_group`] of a cluster that holds source triangles.
pub const NO_GROUP: u32 = u32::MAX;

/// Which optional vertex attributes an asset has; an absent one costs no byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bincode::Encode, bincode::Decode)]
pub struct Attributes(pub u32);

impl Attributes {
    /// Octahedral normals.
    pub const NORMAL: u32 = 1;
    /// One set of texture coordinates.
    pub const UV: u32 = 2;
    /// RGBA colours, eight bits a channel.
    pub const COLOR: u32 = 4;
    /// Every known flag.
    pub const ALL: u32 = Self::NORMAL | Self::UV | Self::COLOR;

    /// Whether `flag` is set.
    pub fn has(self, flag: u32) -> bool {
        self.0 & flag != 0
    }
}

/// A run of a cluster's triangles with one material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaterialRange {
    /// The asset's material slot; the scene maps slots to materials.
    pub slot: u16,
    /// Triangles in the run, 1..=128.
    pub triangle_count: u16,
}

/// At most 128 triangles over at most 256 vertices.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Cluster {
    /// Grid indices relative to the asset's centre, one a vertex.
    pub positions: Vec<[i32; 3]>,
    /// Octahedral pairs ([`crate::octahedral`]), one a vertex, or empty.
    pub normals: Vec<[u16; 2]>,
    /// Texture coordinates on the asset's texture grid, one a vertex, or empty.
    pub uvs: Vec<[i32; 2]>,
    /// RGBA, one a vertex, or empty.
    pub colors: Vec<[u8; 4]>,
    /// Vertex indices of each triangle, counter-clockwise from outside.
    pub triangles: Vec<[u8; 3]>,
    /// Materials of the triangles in order; the counts sum to the triangles.
    pub materials: Vec<MaterialRange>,
    /// Distance from the source: 0 holds source triangles.
    pub level: u8,
    /// The group that this cluster is a member of.
    pub group: u32,
    /// The finer group whose simplification made this cluster, or [`NO_GROUP`].
    pub child_group: u32,
}

impl Cluster {
    /// Smallest and largest grid index a coordinate.
    pub fn extent_q(&self) -> ([i32; 3], [i32; 3]) {
        let mut extent = ([i32::MAX; 3], [i32::MIN; 3]);
        for position in &self.positions {
            for axis in 0..3 {
                extent.0[axis] = extent.0[axis].min(position[axis]);
                extent.1[axis] = extent.1[axis].max(position[axis]);
            }
        }
        extent
    }

    /// Bounding box in local space, metres; exact, since local coordinates are exact in f32.
    pub fn aabb(&self, grid: Grid) -> Aabb {
        let (min, max) = self.extent_q();
        let local = |q: i32| grid.dequantize(q as i64) as f32;
        Aabb {
            min: min.map(local),
            max: max.map(local),
        }
    }

    /// Checks every limit and that the arrays agree with each other and with `attributes`.
    pub fn check(&self, attributes: Attributes) -> Result<(), FormatError> {
        let vertices = self.positions.len();
        ensure(
            (1..=MAX_CLUSTER_VERTICES).contains(&vertices),
            "cluster vertices",
            "1..=256",
            vertices,
        )?;
        let triangles = self.triangles.len();
        ensure(
            (1..=MAX_CLUSTER_TRIANGLES).contains(&triangles),
            "cluster triangles",
            "1..=128",
            triangles,
        )?;
        for (name, flag, length) in [
            ("cluster normals", Attributes::NORMAL, self.normals.len()),
            (
                "cluster texture coordinates",
                Attributes::UV,
                self.uvs.len(),
            ),
            ("cluster colours", Attributes::COLOR, self.colors.len()),
        ] {
            let expected = if attributes.has(flag) { vertices } else { 0 };
            ensure(length == expected, name, expected, length)?;
        }
        let largest = self.triangles.iter().flatten().copied().max().unwrap_or(0) as usize;
        ensure(
            largest < vertices,
            "cluster triangle index",
            format_args!("below {vertices}"),
            largest,
        )?;
        let ranged: usize = self
            .materials
            .iter()
            .map(|range| range.triangle_count as usize)
            .sum();
        ensure(
            ranged == triangles,
            "triangles in material ranges",
            triangles,
            ranged,
        )?;
        let empty = self
            .materials
            .iter()
            .filter(|range| range.triangle_count == 0)
            .count();
        ensure(empty == 0, "empty material ranges", 0, empty)?;
        ensure(self.level < 64, "cluster level", "below 64", self.level)?;
        let local = MAX_EXTENT_STEPS as i32;
        let inside = |position: &&[i32; 3]| position.iter().all(|q| (-local..=local).contains(q));
        match self.positions.iter().find(|position| !inside(position)) {
            None => Ok(()),
            Some(position) => Err(FormatError::new(
                "cluster position",
                "within 2^23 steps of the centre",
                format!("{position:?}"),
            )),
        }
    }
}

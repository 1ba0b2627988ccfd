//! Instances in the order and on the steps in which a scene stores them.
//!
//! ```text
//! instances -> along a Morton curve (`order`) -> onto steps, where they may move (`rounding`)
//! ```

mod order;
mod rounding;

use std::collections::{BTreeSet, HashMap};

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::instances::InstanceSteps;
use lodestream_format::{Asset, ContentHash, Scene};
use tokio::runtime::Handle;

use crate::library::{Library, LibraryError};

pub(super) use order::BLOCK_INSTANCES;

/// Assets read at once.
const READS_AT_ONCE: usize = 16;

/// Instances of a mesh that may be moved by less than a quarter of its rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Freedom {
    /// None: some touch others without a gap.
    None,
    /// Those whose linear part no other has. Not all were compared with others; tiles that could
    /// meet repeat their turns.
    Own,
    /// All: none touches another.
    All,
}

impl Freedom {
    /// As the outline of a scene says it: a step of 1 stands for one to choose.
    pub(super) fn steps(self) -> InstanceSteps {
        let chosen = |may: bool| if may { 1.0 } else { 0.0 };
        InstanceSteps {
            turn: chosen(self != Self::None),
            offset: chosen(self == Self::All),
            ..InstanceSteps::default()
        }
    }

    fn of(steps: &InstanceSteps) -> Self {
        match (steps.turn > 0.0, steps.offset > 0.0) {
            (false, _) => Self::None,
            (true, false) => Self::Own,
            (true, true) => Self::All,
        }
    }
}

/// The box of an asset and what its grid moves.
#[derive(Debug, Clone, Copy)]
struct AssetBox {
    /// Corners, object space.
    corners: [[f64; 3]; 8],
    /// Centre, object space.
    center: [f32; 3],
    /// Most metres between a point and its place on the grid.
    rounding: f64,
}

impl AssetBox {
    fn new(asset: &Asset) -> Self {
        let origin = asset
            .center_q
            .map(|q| q as f64 * asset.position_grid.step());
        let side = |axis: usize, high: bool| {
            let bound = if high { asset.aabb.max } else { asset.aabb.min };
            origin[axis] + f64::from(bound[axis])
        };
        let corner = |index: usize| [0, 1, 2].map(|axis| side(axis, index >> axis & 1 == 1));
        let middle = |axis: usize| 0.5 * (side(axis, false) + side(axis, true));
        Self {
            corners: [0, 1, 2, 3, 4, 5, 6, 7].map(corner),
            center: [0, 1, 2].map(|axis| middle(axis) as f32),
            rounding: asset.position_grid.rounding(),
        }
    }
}

/// Orders the instances of a scene that is filled, and moves onto steps which may move. Scenes of
/// one block keep their order and every bit.
///
/// # Errors
/// Those of reading an asset.
pub(super) fn arrange(
    runtime: &Handle,
    library: &Library,
    scene: &mut Scene,
) -> Result<(), LibraryError> {
    let freedoms = scene.assets.iter_mut().map(|used| {
        let steps = std::mem::take(&mut used.steps);
        Freedom::of(&steps)
    });
    let freedoms: Vec<Freedom> = freedoms.collect();
    if scene.instances.len() <= BLOCK_INSTANCES {
        return Ok(());
    }
    let read = runtime.block_on(boxes(library, scene))?;
    let boxes: Vec<AssetBox> = scene.assets.iter().map(|used| read[&used.asset]).collect();
    order::sort(&mut scene.instances, &boxes);
    rounding::round(scene, &boxes, &freedoms);
    Ok(())
}

async fn boxes(
    library: &Library,
    scene: &Scene,
) -> Result<HashMap<ContentHash, AssetBox>, LibraryError> {
    let hashes: BTreeSet<_> = scene.assets.iter().map(|used| used.asset).collect();
    stream::iter(hashes)
        .map(|hash| async move { Ok((hash, AssetBox::new(&library.asset(&hash).await?))) })
        .buffered(READS_AT_ONCE)
        .try_collect()
        .await
}

#[cfg(test)]
mod tests;

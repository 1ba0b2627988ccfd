//! The cut of one world-space error: a group is refined where its parent error, scaled to the world, is larger.
//!
//! A cluster of group H made from group G is in the cut when H is refined and G is not; since errors grow toward the root
//! this is one crack-free cut for every error.

use bytes::Bytes;
use glam::DMat3;
use lodestream_format::cluster::NO_GROUP;
use lodestream_format::disk_form::DiskForm;
use lodestream_format::hierarchy::Group;
use lodestream_format::library::object_path;
use lodestream_format::{Asset, ContentHash, FormatError, Hierarchy, Scene, frame};
use tokio::runtime::Handle;

use crate::library::{Library, LibraryError};

/// The error that refines every group, also those that simplify without error.
pub(super) const SOURCE: f64 = f64::NEG_INFINITY;

/// An asset as one entry of the scene uses it.
#[derive(Debug)]
pub(super) struct SceneAssetCut {
    pub hash: ContentHash,
    pub asset: Asset,
    pub hierarchy: Hierarchy,
    /// Instances of this entry.
    pub instances: u64,
    /// Largest stretch of any instance: world metres of an object-space metre.
    pub world_scale: f64,
}

/// Assets and hierarchies of a scene, with how large its instances draw them.
pub(super) fn scene_assets(
    runtime: &Handle,
    library: &Library,
    scene: &Scene,
) -> Result<Vec<SceneAssetCut>, LibraryError> {
    let mut cuts = Vec::with_capacity(scene.assets.len());
    for used in &scene.assets {
        let asset = runtime.block_on(library.asset(&used.asset))?;
        let hierarchy = runtime.block_on(library.hierarchy(&asset))?;
        cuts.push(SceneAssetCut {
            hash: used.asset,
            asset,
            hierarchy,
            instances: 0,
            world_scale: 0.0,
        });
    }
    for instance in &scene.instances {
        let cut = &mut cuts[instance.asset as usize];
        cut.instances += 1;
        let stretch = largest_stretch(&instance.world_from_object);
        cut.world_scale = cut.world_scale.max(stretch);
    }
    Ok(cuts)
}

impl SceneAssetCut {
    /// World-space error of the finest clusters: the source was rounded to the position grid.
    pub(super) fn rounding_in_world(&self) -> f64 {
        match self.instances {
            0 => 0.0,
            _ => self.asset.position_grid.rounding() * self.world_scale,
        }
    }

    fn parent_error_in_world(&self, group: &Group) -> f64 {
        match group.is_root() {
            true => f64::INFINITY,
            false => group.parent_error_metres as f64 * self.world_scale,
        }
    }

    /// Whether the clusters of the group, or finer ones, are drawn.
    pub(super) fn refines(&self, group: u32, error_metres: f64) -> bool {
        let group = &self.hierarchy.groups[group as usize];
        self.parent_error_in_world(group) > error_metres
    }

    /// Pages that hold clusters of refined groups, and those that they inherit from, ascending.
    pub(super) fn pages(&self, error_metres: f64) -> Vec<u32> {
        let mut needed = vec![false; self.asset.pages.len()];
        for group in &self.hierarchy.groups {
            if self.parent_error_in_world(group) > error_metres {
                needed[group.first_page as usize..][..group.part_count as usize].fill(true);
            }
        }
        // Pages depend on smaller ones: from the last one down nothing is missed.
        for page in (0..needed.len()).rev() {
            if needed[page] {
                for &dependency in &self.asset.pages[page].dependencies {
                    needed[dependency as usize] = true;
                }
            }
        }
        (0..needed.len() as u32)
            .filter(|&page| needed[page as usize])
            .collect()
    }

    /// Reads and checks one page.
    pub(super) fn page(
        &self,
        runtime: &Handle,
        library: &Library,
        page: u32,
    ) -> Result<DiskForm, LibraryError> {
        let entry = &self.asset.pages[page as usize];
        let range = entry.offset..entry.offset + entry.bytes as u64;
        let bytes: Bytes = runtime.block_on(library.object_range(&self.asset.pack, range))?;
        self.parse(page, &bytes).map_err(|error| {
            let place = format!("{} page {page}", object_path(&self.asset.pack));
            library.damaged(place, error)
        })
    }

    fn parse(&self, page: u32, bytes: &[u8]) -> Result<DiskForm, FormatError> {
        let expected = self.asset.pages[page as usize].hash;
        let found = ContentHash::of(bytes);
        if found != expected {
            return Err(FormatError::new("frame hash", expected, found));
        }
        let form = DiskForm::parse(frame::decode(bytes)?)?;
        self.hierarchy.check_page(&form)?;
        Ok(form)
    }
}

/// The smallest error whose cut has at most `limit` triangles over all instances, or the triangles of the coarsest cut.
pub(super) fn error_of_triangles(
    runtime: &Handle,
    library: &Library,
    cuts: &[SceneAssetCut],
    limit: u64,
) -> Result<Result<f64, u64>, LibraryError> {
    // A cluster is drawn for every error from its child group's up to, not including, its own group's.
    let mut changes: Vec<(f64, i64)> = vec![];
    for cut in cuts {
        for page in 0..cut.asset.pages.len() as u32 {
            let form = cut.page(runtime, library, page)?;
            for header in form.headers() {
                let error =
                    |group: u32| cut.parent_error_in_world(&cut.hierarchy.groups[group as usize]);
                let from = match header.child_group() {
                    NO_GROUP => SOURCE,
                    group => error(group),
                };
                let to = error(header.group());
                if from < to {
                    let triangles = (header.triangle_count() as u64 * cut.instances) as i64;
                    changes.push((from, triangles));
                    changes.push((to, -triangles));
                }
            }
        }
    }
    changes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let (mut triangles, mut coarsest) = (0i64, 0);
    for same in changes.chunk_by(|a, b| a.0 == b.0) {
        triangles += same.iter().map(|change| change.1).sum::<i64>();
        let error = same[0].0;
        if error == f64::INFINITY {
            break;
        }
        if triangles as u64 <= limit {
            return Ok(Ok(error));
        }
        coarsest = triangles as u64;
    }
    Ok(Err(coarsest))
}

/// Largest singular value of the linear part: the square root of the largest eigenvalue of `MᵀM`, by the trigonometric form for
/// symmetric 3 x 3 matrices (Smith, "Eigenvalues of a symmetric 3 × 3 matrix", 1961).
fn largest_stretch(world_from_object: &[[f64; 4]; 3]) -> f64 {
    let row = |row: usize| {
        let [x, y, z, _] = world_from_object[row];
        [x, y, z]
    };
    let largest = (0..3)
        .flat_map(row)
        .fold(0.0f64, |most, value| most.max(value.abs()));
    if largest == 0.0 {
        return 0.0;
    }
    // Scaled to about 1, so that squares neither overflow nor vanish.
    let rows = [row(0), row(1), row(2)].map(|row| row.map(|value| value / largest));
    let linear = DMat3::from_cols_array_2d(&rows).transpose();
    let square = linear.transpose() * linear;
    let mean = (square.x_axis.x + square.y_axis.y + square.z_axis.z) / 3.0;
    let centred = square - DMat3::from_diagonal(glam::DVec3::splat(mean));
    let spread_squared = centred
        .to_cols_array()
        .iter()
        .map(|value| value * value)
        .sum::<f64>()
        / 6.0;
    let spread = spread_squared.sqrt();
    if spread <= 1e-15 * mean {
        return mean.sqrt() * largest;
    }
    let half = ((centred * (1.0 / spread)).determinant() / 2.0).clamp(-1.0, 1.0);
    (mean + 2.0 * spread * (half.acos() / 3.0).cos()).sqrt() * largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn stretch_is_the_largest_singular_value(
            turn in prop::array::uniform4(-1f64..1.0),
            other in prop::array::uniform4(-1f64..1.0),
            scale in prop::array::uniform3(-5f64..5.0),
            power in -12i32..12,
        ) {
            prop_assume!(DQuat::from_array(turn).length() > 0.1 && DQuat::from_array(other).length() > 0.1);
            let factor = 10f64.powi(power);
            let scale = DVec3::from(scale) * factor;
            let matrix = DMat3::from_quat(DQuat::from_array(turn).normalize())
                * DMat3::from_diagonal(scale)
                * DMat3::from_quat(DQuat::from_array(other).normalize());
            let rows: [[f64; 4]; 3] = std::array::from_fn(|row| {
                let row = matrix.row(row);
                [row.x, row.y, row.z, 7.0]
            });
            let expected = scale.abs().max_element();
            let found = largest_stretch(&rows);
            prop_assert!((found - expected).abs() <= 1e-7 * expected, "{found} {expected}");
        }
    }
}

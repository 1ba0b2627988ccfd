//! Instances as a scene stores them: columns of small integers instead of twelve numbers each.
//!
//! ```text
//! instances -> forms and integers (`placing`) -> columns (`columns`) -> bytes, planes of columns
//! ```
//!
//! Nothing is rounded here: an instance that lies on the steps of its asset ([`InstanceSteps`]) is
//! stored as integers, any other bit by bit. The builder chooses the steps and moves instances onto
//! them ([`Placing::nearest`]).

mod columns;
mod placing;
mod shared;

use crate::error::{FormatError, ensure};
use crate::limits::MAX_INSTANCES;
use crate::scene::{Instance, SceneAsset};
use columns::Columns;

pub use placing::{InstanceSteps, Placing, largest_column};
pub use shared::SharedParts;

/// Linear part, row by row.
pub type Linear = [[f64; 3]; 3];

/// The packed list: how many, and the bytes of its columns.
#[derive(Debug, Default, bincode::Encode, bincode::Decode)]
pub(crate) struct PackedInstances {
    count: u32,
    columns: Vec<u8>,
}

impl PackedInstances {
    /// Packs `instances` of `assets`, in their order.
    pub fn new(assets: &[SceneAsset], instances: &[Instance]) -> Result<Self, FormatError> {
        ensure(
            instances.len() <= MAX_INSTANCES,
            "scene instances",
            format_args!("at most {MAX_INSTANCES}"),
            instances.len(),
        )?;
        let shared = SharedParts::new(instances);
        let mut columns = Columns::with_shared(&shared);
        let mut placing = Placing::default();
        for (index, instance) in instances.iter().enumerate() {
            let asset = assets.get(instance.asset as usize).ok_or_else(|| {
                let expected = format!("below {}", assets.len());
                FormatError::new(
                    format!("scene instance {index} asset"),
                    expected,
                    instance.asset,
                )
            })?;
            let number = shared.number(&linear_of(instance));
            let integers = placing.integers(&asset.steps, instance, number);
            columns.push(instance.asset, &integers);
        }
        Ok(Self {
            count: instances.len() as u32,
            columns: columns.into_bytes(),
        })
    }

    /// Bytes of the columns.
    pub fn memory_bytes(&self) -> u64 {
        self.columns.len() as u64
    }

    /// Unpacks into a list that may take `memory_bytes`.
    pub fn unpack(
        &self,
        assets: &[SceneAsset],
        memory_bytes: u64,
    ) -> Result<Vec<Instance>, FormatError> {
        let count = self.count as usize;
        ensure(
            count <= MAX_INSTANCES,
            "scene instances",
            format_args!("at most {MAX_INSTANCES}"),
            count,
        )?;
        let needed_bytes = (count * size_of::<Instance>()) as u64;
        ensure(
            needed_bytes <= memory_bytes,
            "scene instances",
            format_args!("at most {memory_bytes} bytes"),
            needed_bytes,
        )?;
        let (mut columns, parts) = columns::Reading::new(&self.columns, count)?;
        let mut placing = Placing::default();
        let mut instances = Vec::with_capacity(count);
        for index in 0..count {
            let (asset, integers) = columns.next(index)?;
            let at = || format!("scene instance {index}");
            let used = assets.get(asset as usize).ok_or_else(|| {
                FormatError::new(at() + " asset", format!("below {}", assets.len()), asset)
            })?;
            let instance = placing
                .instance(&used.steps, asset, &integers, &parts)
                .ok_or_else(|| {
                    FormatError::new(at() + " transform", "finite numbers", "another")
                })?;
            instances.push(instance);
        }
        columns.finish()?;
        Ok(instances)
    }
}

/// The linear part of an instance.
pub fn linear_of(instance: &Instance) -> Linear {
    instance.world_from_object.map(|[x, y, z, _]| [x, y, z])
}

/// The last column of an instance.
pub fn offset_of(instance: &Instance) -> [f64; 3] {
    instance.world_from_object.map(|row| row[3])
}

fn instance_of(asset: u32, linear: &Linear, offset: [f64; 3]) -> Instance {
    let row = |row: usize| {
        let [x, y, z] = linear[row];
        [x, y, z, offset[row]]
    };
    Instance {
        asset,
        world_from_object: [row(0), row(1), row(2)],
    }
}

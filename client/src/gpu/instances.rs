//! Instances that change after a scene is open: moved, hidden, added and removed by ranges.
//!
//! Nothing else changes with them. Hidden geometry stays hidden only where the late pass of the
//! same frame found it so, whatever moved since the depths of the early test.

use std::mem::offset_of;
use std::ops::Range;

use lodestream_format::scene::Instance;
use lodestream_shaders::SceneArrays;
use lodestream_shaders::types::{InstanceRecord, NO_ASSET};

use super::buffers::create;
use super::error::GpuError;
use super::renderer::Renderer;

const RECORD_BYTES: u64 = size_of::<InstanceRecord>() as u64;

/// Instances of a scene as they are now.
#[derive(Debug, Default)]
pub(super) struct Instances {
    /// Places in the buffer, empty ones included.
    pub count: u32,
    /// Changes so far.
    pub edits: u64,
    /// Of each place: its asset, or none where it is empty, and whether it is hidden. Empty before
    /// the first change.
    places: Vec<(u32, bool)>,
}

impl Instances {
    /// Those of a scene that was opened.
    pub fn new(count: u32) -> Self {
        Self {
            count,
            ..Self::default()
        }
    }

    /// Notes a change.
    fn edit(&mut self, arrays: &SceneArrays) -> &mut Vec<(u32, bool)> {
        if self.edits == 0 {
            let assets = arrays.instances.iter().map(|record| (record.asset, false));
            self.places = assets.collect();
        }
        self.edits += 1;
        &mut self.places
    }
}

impl Renderer {
    /// Places of instances, empty ones included.
    pub fn instance_count(&self) -> u32 {
        self.instances.count
    }

    /// Puts `instances` at the places from `first` on: moves them, gives them other assets, or
    /// fills empty places. Hidden places stay hidden.
    ///
    /// # Errors
    /// A place past the last one, an asset that the scene lacks, a transform that is not finite.
    pub fn set_instances(&mut self, first: u32, instances: &[Instance]) -> Result<(), GpuError> {
        let range = self.places(first..first.saturating_add(instances.len() as u32))?;
        let mut records = self.records(instances)?;
        let places = &mut self.instances.edit(&self.arrays)[range];
        for ((asset, hidden), record) in places.iter_mut().zip(&mut records) {
            *asset = record.asset;
            if *hidden {
                record.asset = NO_ASSET;
            }
        }
        self.write_instances(first, &records);
        Ok(())
    }

    /// Hides instances, or shows them again.
    ///
    /// # Errors
    /// A place past the last one.
    pub fn hide_instances(&mut self, range: Range<u32>, hide: bool) -> Result<(), GpuError> {
        let first = range.start;
        let range = self.places(range)?;
        let places = &mut self.instances.edit(&self.arrays)[range];
        let changed: Vec<(u32, u32)> = (first..)
            .zip(places)
            .filter(|(_, (_, hidden))| *hidden != hide)
            .map(|(place, (asset, hidden))| {
                *hidden = hide;
                (place, if hide { NO_ASSET } else { *asset })
            })
            .collect();
        for (place, asset) in changed {
            self.write_asset(place, asset);
        }
        Ok(())
    }

    /// Takes instances away. Their places stay empty until [`Renderer::set_instances`] fills them.
    ///
    /// # Errors
    /// A place past the last one.
    pub fn remove_instances(&mut self, range: Range<u32>) -> Result<(), GpuError> {
        let removed = self.places(range.clone())?;
        self.instances.edit(&self.arrays)[removed].fill((NO_ASSET, false));
        for place in range {
            self.write_asset(place, NO_ASSET);
        }
        Ok(())
    }

    /// Adds instances of assets that the scene has; returns their places.
    ///
    /// # Errors
    /// An asset that the scene lacks, a transform that is not finite, more instances than the
    /// adapter binds.
    pub fn add_instances(&mut self, instances: &[Instance]) -> Result<Range<u32>, GpuError> {
        let records = self.records(instances)?;
        let first = self.instances.count;
        let count = u32::try_from(first as usize + instances.len()).unwrap_or(u32::MAX);
        self.grow_instances(count)?;
        let places = self.instances.edit(&self.arrays);
        places.extend(records.iter().map(|record| (record.asset, false)));
        self.instances.count = count;
        self.write_instances(first, &records);
        Ok(first..count)
    }

    fn records(&self, instances: &[Instance]) -> Result<Vec<InstanceRecord>, GpuError> {
        let record = |instance: &Instance| {
            let rows = instance.world_from_object;
            let is_finite = rows.iter().flatten().all(|value| value.is_finite());
            let record = self.arrays.instance_record(instance);
            record.filter(|_| is_finite).ok_or_else(|| {
                let assets = self.arrays.assets.len();
                GpuError::Instance {
                    expected: format!("an asset below {assets} and finite numbers"),
                    found: format!("asset {} at {rows:?}", instance.asset),
                }
            })
        };
        instances.iter().map(record).collect()
    }

    fn places(&self, range: Range<u32>) -> Result<Range<usize>, GpuError> {
        let count = self.instances.count;
        match range.start <= range.end && range.end <= count {
            true => Ok(range.start as usize..range.end as usize),
            false => Err(GpuError::Instance {
                expected: format!("places below {count}"),
                found: format!("{range:?}"),
            }),
        }
    }

    /// Makes room for `count` instances, a half more than asked for where there was none.
    fn grow_instances(&mut self, count: u32) -> Result<(), GpuError> {
        self.unbind();
        let old = self.buffers.get("instances");
        if count as u64 * RECORD_BYTES > old.size() {
            let most = self.gpu.max_binding_bytes();
            let wanted = count as u64 * RECORD_BYTES;
            let bytes = (wanted + wanted / 2).min(most).max(wanted);
            let new = create(&self.gpu, "instances", bytes, old.usage())?;
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(old, 0, &new, 0, old.size());
            self.gpu.queue.submit([encoder.finish()]);
            self.buffers.replace("instances", new);
        }
        // Every instance's root node finds room.
        let mut capacities = self.buffers.capacities();
        capacities.nodes = capacities.nodes.max(count.next_power_of_two());
        self.buffers.set_capacities(&self.gpu, capacities)
    }

    fn write_instances(&self, first: u32, records: &[InstanceRecord]) {
        let bytes = bytemuck::cast_slice(records);
        self.write_at("instances", u64::from(first) * RECORD_BYTES, bytes);
    }

    fn write_asset(&self, place: u32, asset: u32) {
        let at = u64::from(place) * RECORD_BYTES + offset_of!(InstanceRecord, asset) as u64;
        self.write_at("instances", at, bytemuck::bytes_of(&asset));
    }

    fn write_at(&self, name: &str, byte: u64, bytes: &[u8]) {
        let queue = &self.gpu.queue;
        queue.write_buffer(self.buffers.get(name), byte, bytes);
    }
}

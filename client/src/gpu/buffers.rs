//! Every buffer by the name that the passes bind it under: the scene's arrays, which never change, and the frame's
//! queues, which grow when a frame says that they were too small.

use std::collections::BTreeMap;

use bytemuck::Pod;
use lodestream_shaders::cpu::error_metric::RequestWords;
use lodestream_shaders::cpu::hzb::hzb_texels;
use lodestream_shaders::scene_rows::FirstRows;
use lodestream_shaders::types::{
    ClusterItem, Counters, IndirectArgs, NodeItem, RequestRecord, TRIANGLE_BITS, View,
};
use lodestream_shaders::{SceneArrays, SceneRows};
use wgpu::BufferUsages;

use super::device::Gpu;
use super::error::GpuError;

/// Both halves of the node queues and the rejected items, an item of capacity.
const NODE_ITEM_BYTES: usize = 3 * size_of::<NodeItem>();
/// Candidates and visible clusters, an item of capacity.
const CLUSTER_ITEM_BYTES: usize = 2 * size_of::<ClusterItem>();

/// No buffer is smaller: a binding must hold at least one element of what it is declared as.
const SMALLEST_BYTES: u64 = 256;

/// Makes one buffer; fails where the adapter cannot bind it or the memory does not suffice.
pub fn create(
    gpu: &Gpu,
    name: &str,
    bytes: u64,
    usage: BufferUsages,
) -> Result<wgpu::Buffer, GpuError> {
    let bytes = bytes.max(SMALLEST_BYTES).next_multiple_of(16);
    if bytes > gpu.max_binding_bytes() {
        return Err(GpuError::Limit {
            adapter: gpu.name.clone(),
            expected: format!("a buffer {name} of {bytes} bytes"),
            found: format!("at most {} bytes", gpu.max_binding_bytes()),
        });
    }
    let descriptor = wgpu::BufferDescriptor {
        label: Some(name),
        size: bytes,
        usage,
        mapped_at_creation: false,
    };
    gpu.checked(|| gpu.device.create_buffer(&descriptor))
        .map_err(|reason| GpuError::Allocation {
            name: name.to_owned(),
            bytes,
            reason,
        })
}

/// Makes a storage buffer that holds `values`.
pub fn upload<T: Pod>(gpu: &Gpu, name: &str, values: &[T]) -> Result<wgpu::Buffer, GpuError> {
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    let buffer = create(gpu, name, size_of_val(values) as u64, usage)?;
    gpu.queue
        .write_buffer(&buffer, 0, bytemuck::cast_slice(values));
    Ok(buffer)
}

/// Bytes of a row of 32-bit texels in a copy of an attachment.
pub fn row_bytes(width_px: u32) -> u32 {
    (4 * width_px).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

/// How large the frame's queues are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacities {
    /// Items of each half of the node queues.
    pub nodes: u32,
    /// Candidates, and visible clusters, each.
    pub clusters: u32,
}

impl Default for Capacities {
    fn default() -> Self {
        Self {
            nodes: 1 << 16,
            clusters: 1 << 17,
        }
    }
}

impl Capacities {
    /// The smallest doubling of `self` that holds the counts, at most the largest that the adapter
    /// binds, or the reason why there is none.
    /// Returns `self` where everything fitted.
    pub fn grown(self, gpu: &Gpu, counters: &Counters) -> Result<Self, GpuError> {
        let visible = counters.visible_count.saturating_add(counters.point_count);
        let clusters = counters.candidate_count.max(visible);
        let double = |capacity: u32, wanted: u32, most: u64, name: &str| {
            let mut grown = capacity as u64;
            while grown < wanted as u64 {
                grown *= 2;
            }
            if wanted as u64 > most.max(capacity as u64) {
                return Err(GpuError::Limit {
                    adapter: gpu.name.clone(),
                    expected: format!("room for {wanted} {name}"),
                    found: format!("at most {most}"),
                });
            }
            Ok(grown.min(most.max(capacity as u64)) as u32)
        };
        let bindable = |bytes: usize| gpu.max_binding_bytes() / bytes as u64;
        // A visbuffer id has 32 bits for the visible cluster and its triangle.
        let numbered = 1u64 << (32 - TRIANGLE_BITS);
        let most_clusters = bindable(CLUSTER_ITEM_BYTES).min(numbered);
        Ok(Self {
            nodes: double(
                self.nodes,
                counters.node_count_max,
                bindable(NODE_ITEM_BYTES),
                "hierarchy nodes a level",
            )?,
            clusters: double(self.clusters, clusters, most_clusters, "clusters a frame")?,
        })
    }
}

/// All buffers but the pool's.
#[derive(Debug)]
pub struct Buffers {
    by_name: BTreeMap<&'static str, wgpu::Buffer>,
    rows: FirstRows,
    capacities: Capacities,
    size_px: [u32; 2],
    has_attached: bool,
}

/// The buffers under the names that the passes bind, the pool's among them.
#[derive(Debug)]
pub struct Named<'a> {
    buffers: &'a Buffers,
    pool: &'a [wgpu::Buffer],
    is_late: bool,
    is_second: bool,
}

impl<'a> Named<'a> {
    /// The buffer bound as `name`.
    pub fn get(&self, name: &str) -> Option<&'a wgpu::Buffer> {
        let name = match name {
            "occluder" if self.is_late => "late_occluder",
            "view" if self.is_second => "second_view",
            name => name,
        };
        match name.strip_prefix("pool_").map(str::parse::<usize>) {
            Some(Ok(index)) => self.pool.get(index),
            _ => self.buffers.by_name.get(name),
        }
    }
}

impl Buffers {
    /// Uploads the scene and makes the frame's buffers for pictures of `size_px`.
    pub fn new(gpu: &Gpu, arrays: &SceneArrays, size_px: [u32; 2]) -> Result<Self, GpuError> {
        let mut by_name = BTreeMap::new();
        by_name.insert("instances", upload(gpu, "instances", &arrays.instances)?);
        let rows = SceneRows::new(arrays, &arrays.materials, &[]);
        by_name.insert("scene", upload(gpu, "scene", &rows.rows)?);
        by_name.insert(
            "page_table",
            upload(gpu, "page_table", &arrays.empty_page_table())?,
        );
        let pages = arrays.page_count as usize;
        let mut frame = |name: &'static str, bytes: usize, usage| {
            let always = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            create(gpu, name, bytes as u64, always | usage)
                .map(|buffer| by_name.insert(name, buffer))
        };
        let none = BufferUsages::empty();
        frame("page_priority", pages * size_of::<RequestWords>(), none)?;
        frame("requests", pages * size_of::<RequestRecord>(), none)?;
        for view in ["view", "second_view", "occluder", "late_occluder"] {
            frame(view, size_of::<View>(), BufferUsages::UNIFORM)?;
        }
        frame("counters", size_of::<Counters>(), none)?;
        frame("args", size_of::<IndirectArgs>(), BufferUsages::INDIRECT)?;
        frame("texels", 0, none)?;
        let mut buffers = Self {
            by_name,
            rows: rows.first,
            capacities: Capacities {
                nodes: 0,
                clusters: 0,
            },
            size_px: [0; 2],
            has_attached: false,
        };
        // Whatever happens later, every instance's root node finds room.
        let mut capacities = Capacities::default();
        let instances = arrays.instances.len() as u32;
        capacities.nodes = capacities.nodes.max(instances.next_power_of_two());
        buffers.set_capacities(gpu, capacities)?;
        buffers.set_size(gpu, size_px)?;
        Ok(buffers)
    }

    /// These buffers and the pool's, for the early pass.
    pub fn named<'a>(&'a self, pool: &'a [wgpu::Buffer]) -> Named<'a> {
        Named {
            buffers: self,
            pool,
            is_late: false,
            is_second: false,
        }
    }

    /// These buffers and the pool's, for the second round of a visbuffer without 64-bit atomics.
    pub fn named_second<'a>(&'a self, pool: &'a [wgpu::Buffer]) -> Named<'a> {
        Named {
            is_second: true,
            ..self.named(pool)
        }
    }

    /// These buffers and the pool's, for the late pass.
    pub fn named_late<'a>(&'a self, pool: &'a [wgpu::Buffer]) -> Named<'a> {
        Named {
            is_late: true,
            ..self.named(pool)
        }
    }

    /// Replaces the scene's rows.
    pub fn set_rows(&mut self, gpu: &Gpu, rows: &SceneRows) -> Result<(), GpuError> {
        self.rows = rows.first;
        self.replace("scene", upload(gpu, "scene", &rows.rows)?);
        Ok(())
    }

    /// First row of each kind of record in the scene's rows.
    pub fn first_rows(&self) -> FirstRows {
        self.rows
    }

    /// The buffer of that name.
    ///
    /// # Panics
    /// Where `name` is none of the names that [`Buffers::new`] makes: names are literals of this crate.
    pub fn get(&self, name: &str) -> &wgpu::Buffer {
        &self.by_name[name]
    }

    /// Replaces a buffer by one made elsewhere.
    pub fn replace(&mut self, name: &'static str, buffer: wgpu::Buffer) {
        self.by_name.insert(name, buffer);
    }

    /// Items that the queues hold.
    pub fn capacities(&self) -> Capacities {
        self.capacities
    }

    /// First byte of the visible clusters in `clusters`: they lie behind the candidates.
    pub fn visible_offset(&self) -> u64 {
        self.capacities.clusters as u64 * size_of::<ClusterItem>() as u64
    }

    /// Width and height of the picture.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Makes the queues anew where `capacities` differ; what they held is lost.
    pub fn set_capacities(&mut self, gpu: &Gpu, capacities: Capacities) -> Result<(), GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        if capacities.nodes != self.capacities.nodes {
            let bytes = NODE_ITEM_BYTES as u64 * capacities.nodes as u64;
            let queues = create(gpu, "node_queues", bytes, usage)?;
            self.by_name.insert("node_queues", queues);
        }
        if capacities.clusters != self.capacities.clusters {
            let bytes = CLUSTER_ITEM_BYTES as u64 * capacities.clusters as u64;
            let clusters = create(gpu, "clusters", bytes, usage)?;
            self.by_name.insert("clusters", clusters);
            // An index a cluster for each rasterizer.
            let bytes = 8 * capacities.clusters as u64;
            let draw_lists = create(gpu, "draw_lists", bytes, usage)?;
            self.by_name.insert("draw_lists", draw_lists);
        }
        self.capacities = capacities;
        Ok(())
    }

    /// Makes the picture's buffers anew where the size differs.
    pub fn set_size(&mut self, gpu: &Gpu, size_px: [u32; 2]) -> Result<(), GpuError> {
        if size_px == self.size_px {
            return Ok(());
        }
        let pixels = size_px[0] as u64 * size_px[1] as u64;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let hzb_bytes = hzb_texels(size_px) as u64 * 4;
        for (name, bytes) in [
            ("visbuffer", pixels * 8),
            ("color", pixels * 4),
            ("hzb", hzb_bytes),
        ] {
            self.by_name.insert(name, create(gpu, name, bytes, usage)?);
        }
        self.size_px = size_px;
        self.set_attached(gpu, self.has_attached)
    }

    /// Makes the copies of the attachments of ids and depths, or drops them.
    pub fn set_attached(&mut self, gpu: &Gpu, on: bool) -> Result<(), GpuError> {
        self.has_attached = on;
        for name in ["attached_ids", "attached_depths"] {
            if on {
                let bytes = row_bytes(self.size_px[0]) as u64 * self.size_px[1] as u64;
                let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
                self.by_name.insert(name, create(gpu, name, bytes, usage)?);
            } else {
                self.by_name.remove(name);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;

    #[test]
    fn queues_double_until_a_frame_fits_and_say_what_the_adapter_lacks() {
        let gpu = Gpu::noop();
        let start = Capacities {
            nodes: 16,
            clusters: 100,
        };
        let counters = Counters {
            node_count_max: 17,
            candidate_count: 100,
            visible_count: 350,
            ..Counters::default()
        };
        let grown = start.grown(&gpu, &counters).unwrap();
        assert_eq!((grown.nodes, grown.clusters), (32, 400));
        assert_eq!(grown.grown(&gpu, &counters).unwrap(), grown);
        let counters = Counters {
            candidate_count: 1 << 30,
            ..Counters::default()
        };
        let error = start.grown(&gpu, &counters).unwrap_err().to_string();
        assert!(error.contains("room for 1073741824 clusters"), "{error}");
    }

    #[test]
    fn a_buffer_that_cannot_be_bound_names_both_numbers() {
        let gpu = Gpu::noop();
        let most = gpu.max_binding_bytes();
        let error = create(&gpu, "texels", most + 1, BufferUsages::STORAGE).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("texels") && text.contains(&most.to_string()),
            "{text}"
        );
    }
}

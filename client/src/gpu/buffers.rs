//! Every buffer by the name that the passes bind it under: the scene's arrays, which never change, and the frame's
//! queues, which grow when a frame says that they were too small.

use std::collections::BTreeMap;

use bytemuck::Pod;
use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::error_metric::RequestWords;
use lodestream_shaders::types::{
    ClusterItem, Counters, IndirectArgs, NodeItem, RequestRecord, TRIANGLE_BITS, View,
};
use wgpu::BufferUsages;

use super::device::Gpu;
use super::error::GpuError;

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

/// How large the frame's queues are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacities {
    /// Items of each node queue.
    pub nodes: u32,
    /// Candidates, and visible clusters.
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
    /// The smallest doubling of `self` that holds what `counters` asked for, or the reason why there is none.
    /// Returns `self` where everything fitted.
    pub fn grown(self, gpu: &Gpu, counters: &Counters) -> Result<Self, GpuError> {
        let clusters = counters.candidate_count.max(counters.visible_count);
        let double = |capacity: u32, wanted: u32, most: u64, name: &str| {
            let mut grown = capacity as u64;
            while grown < wanted as u64 {
                grown *= 2;
            }
            match grown <= most || grown == capacity as u64 {
                true => Ok(grown as u32),
                false => Err(GpuError::Limit {
                    adapter: gpu.name.clone(),
                    expected: format!("room for {wanted} {name}"),
                    found: format!("at most {most}"),
                }),
            }
        };
        let bindable = |bytes: usize| gpu.max_binding_bytes() / bytes as u64;
        // A visbuffer id has 32 bits for the visible cluster and its triangle.
        let numbered = 1u64 << (32 - TRIANGLE_BITS);
        let most_clusters = bindable(size_of::<ClusterItem>()).min(numbered);
        Ok(Self {
            nodes: double(
                self.nodes,
                counters.node_count_max,
                bindable(size_of::<NodeItem>()),
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
    capacities: Capacities,
    size_px: [u32; 2],
    counts_fragments: bool,
}

/// The buffers under the names of one pass: aliases first, then the pool, then the rest.
#[derive(Debug)]
pub struct Named<'a> {
    buffers: &'a Buffers,
    pool: &'a [wgpu::Buffer],
    aliases: &'a [(&'a str, &'a str)],
}

impl<'a> Named<'a> {
    /// The buffer bound as `name`.
    pub fn get(&self, name: &str) -> Option<&'a wgpu::Buffer> {
        let alias = self.aliases.iter().find(|(from, _)| *from == name);
        let name = alias.map_or(name, |(_, to)| to);
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
        by_name.insert("assets", upload(gpu, "assets", &arrays.assets)?);
        by_name.insert("nodes", upload(gpu, "nodes", &arrays.nodes)?);
        by_name.insert("groups", upload(gpu, "groups", &arrays.groups)?);
        by_name.insert("parts", upload(gpu, "parts", &arrays.parts)?);
        by_name.insert(
            "material_slots",
            upload(gpu, "material_slots", &arrays.material_slots)?,
        );
        by_name.insert("materials", upload(gpu, "materials", &arrays.materials)?);
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
        frame("view", size_of::<View>(), none)?;
        frame("counters", size_of::<Counters>(), none)?;
        frame("args", size_of::<IndirectArgs>(), BufferUsages::INDIRECT)?;
        frame("texture_records", 0, none)?;
        frame("texels", 0, none)?;
        frame("fragment_counts", 0, none)?;
        let mut buffers = Self {
            by_name,
            capacities: Capacities {
                nodes: 0,
                clusters: 0,
            },
            size_px: [0; 2],
            counts_fragments: false,
        };
        // Whatever happens later, every instance's root node finds room.
        let mut capacities = Capacities::default();
        let instances = arrays.instances.len() as u32;
        capacities.nodes = capacities.nodes.max(instances.next_power_of_two());
        buffers.set_capacities(gpu, capacities)?;
        buffers.set_size(gpu, size_px)?;
        Ok(buffers)
    }

    /// The buffers as a pass names them; `aliases` maps a pass's name to a buffer's.
    pub fn named<'a>(
        &'a self,
        pool: &'a [wgpu::Buffer],
        aliases: &'a [(&'a str, &'a str)],
    ) -> Named<'a> {
        Named {
            buffers: self,
            pool,
            aliases,
        }
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

    /// Width and height of the picture.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Makes the queues anew where `capacities` differ; what they held is lost.
    pub fn set_capacities(&mut self, gpu: &Gpu, capacities: Capacities) -> Result<(), GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        if capacities.nodes != self.capacities.nodes {
            let bytes = capacities.nodes as u64 * size_of::<NodeItem>() as u64;
            for name in ["node_queue_0", "node_queue_1"] {
                self.by_name.insert(name, create(gpu, name, bytes, usage)?);
            }
        }
        if capacities.clusters != self.capacities.clusters {
            let bytes = capacities.clusters as u64 * size_of::<ClusterItem>() as u64;
            for name in ["candidates", "visible"] {
                self.by_name.insert(name, create(gpu, name, bytes, usage)?);
            }
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
        for (name, bytes) in [("visbuffer", 8), ("color", 4)] {
            self.by_name
                .insert(name, create(gpu, name, pixels * bytes, usage)?);
        }
        self.size_px = size_px;
        let counted = std::mem::take(&mut self.counts_fragments);
        if counted {
            self.count_fragments(gpu)
        } else {
            Ok(())
        }
    }

    /// Makes room for the fragment counts, which only the overdraw picture needs.
    pub fn count_fragments(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if !self.counts_fragments {
            let bytes = self.size_px[0] as u64 * self.size_px[1] as u64 * 4;
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            let buffer = create(gpu, "fragment_counts", bytes, usage)?;
            self.by_name.insert("fragment_counts", buffer);
            self.counts_fragments = true;
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

//! Bind group layouts from the pass table, and the buffers' names in binding order.

use lodestream_shaders::passes::{Access, Pass, PoolAccess, PoolBindings};

use super::device::Gpu;
use super::error::GpuError;

/// A pass's layout and the buffers' names in binding order.
#[derive(Debug)]
pub struct Layout {
    /// Layout of group 0.
    pub group: wgpu::BindGroupLayout,
    /// Name of the buffer of each binding; the pool's are `pool_0`, `pool_1`…
    pub names: Vec<String>,
}

/// Makes the layout of `pass`. `shaders/tests/reflection.rs` compares the table with the WGSL.
pub fn layout(gpu: &Gpu, pass: &Pass, pool: PoolBindings) -> Result<Layout, GpuError> {
    let stages = pass.stages();
    let fixed = pass.bindings.iter();
    let mut bindings: Vec<_> = fixed
        .map(|binding| (binding.name.to_owned(), binding.access))
        .collect();
    let pool_access = match pass.pool {
        PoolAccess::None => None,
        PoolAccess::Read => Some(Access::Read),
        PoolAccess::Write => Some(Access::Write),
    };
    if let Some(access) = pool_access {
        bindings.extend((0..pool.count).map(|index| (format!("pool_{index}"), access)));
    }
    let entries: Vec<_> = (0..)
        .zip(&bindings)
        .map(|(binding, &(_, access))| wgpu::BindGroupLayoutEntry {
            binding,
            // A vertex stage that could write would need one more feature; none of ours does.
            visibility: match access {
                Access::Write => stages.difference(wgpu::ShaderStages::VERTEX),
                Access::Uniform | Access::Read => stages,
            },
            ty: wgpu::BindingType::Buffer {
                ty: match access {
                    Access::Uniform => wgpu::BufferBindingType::Uniform,
                    Access::Read => wgpu::BufferBindingType::Storage { read_only: true },
                    Access::Write => wgpu::BufferBindingType::Storage { read_only: false },
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    let descriptor = wgpu::BindGroupLayoutDescriptor {
        label: Some(pass.name),
        entries: &entries,
    };
    let group = gpu
        .checked(|| gpu.device.create_bind_group_layout(&descriptor))
        .map_err(|reason| GpuError::Pass {
            pass: pass.name,
            reason,
        })?;
    let names = bindings.into_iter().map(|(name, _)| name).collect();
    Ok(Layout { group, names })
}

/// The stages of a pass.
pub trait Stages {
    /// Compute, or vertex and fragment.
    fn stages(&self) -> wgpu::ShaderStages;
}

impl Stages for Pass {
    fn stages(&self) -> wgpu::ShaderStages {
        if self.entry_points.len() == 2 {
            wgpu::ShaderStages::VERTEX_FRAGMENT
        } else {
            wgpu::ShaderStages::COMPUTE
        }
    }
}

#[cfg(test)]
mod tests {
    use lodestream_shaders::passes::{ALL, MAX_STORAGE_BUFFERS};

    use super::*;

    /// The noop device has the limits that every WebGPU adapter has, so a pass past them fails
    /// here.
    #[test]
    fn a_pass_with_too_many_storage_buffers_is_refused() {
        let gpu = Gpu::noop();
        let words_log2 = 25;
        for pass in ALL {
            let room = MAX_STORAGE_BUFFERS - pass.storage_buffers();
            let fits = PoolBindings {
                count: room,
                words_log2,
            };
            let over = PoolBindings {
                count: room + 1,
                words_log2,
            };
            assert!(layout(&gpu, &pass, fits).is_ok(), "{}", pass.name);
            if pass.pool != PoolAccess::None {
                let error = layout(&gpu, &pass, over).expect_err("one binding too many");
                assert!(error.to_string().contains(pass.name), "{error}");
            }
        }
    }
}

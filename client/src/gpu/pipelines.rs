//! Pipelines by pass, built when first asked for: what a scene or a mode does not need is never built.

use std::collections::BTreeMap;
use std::sync::Arc;

use lodestream_shaders::VisbufferTarget;
use lodestream_shaders::passes::{ALL, Pass, PoolBindings};

use super::bindings::{Layout, Stages, layout};
use super::buffers::Named;
use super::device::Gpu;
use super::error::GpuError;
use super::target::ForDevice as _;

/// Format of the rasterizers' attachment of ids. Most targets never write it, but WebGPU has no
/// attachment-free passes.
pub const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// Format of the attachment of depths.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A pass ready to be bound.
#[derive(Debug)]
pub struct BuiltPass {
    name: &'static str,
    layout: Layout,
    pipeline: Pipeline,
}

#[derive(Debug)]
enum Pipeline {
    Compute(wgpu::ComputePipeline),
    Render(wgpu::RenderPipeline),
}

/// A pass with its buffers.
#[derive(Debug)]
pub struct Bound {
    /// The pass.
    pub pass: Arc<BuiltPass>,
    group: wgpu::BindGroup,
}

/// Every pipeline built so far.
#[derive(Debug)]
pub struct Pipelines {
    gpu: Gpu,
    pool: PoolBindings,
    target: VisbufferTarget,
    built: BTreeMap<&'static str, Arc<BuiltPass>>,
}

impl Pipelines {
    /// Nothing built yet; the pool's bindings are part of the sources.
    pub fn new(gpu: &Gpu, pool: PoolBindings) -> Self {
        Self {
            gpu: gpu.clone(),
            pool,
            target: VisbufferTarget::for_device(gpu),
            built: BTreeMap::new(),
        }
    }

    /// The way to the visbuffer.
    pub fn target(&self) -> VisbufferTarget {
        self.target
    }

    /// Another way to the visbuffer; the rasterizers are built anew.
    pub fn set_target(&mut self, target: VisbufferTarget) {
        if target != self.target {
            self.target = target;
            let varied = |name: &str| {
                ALL.iter()
                    .any(|pass| pass.name == name && pass.has_target())
            };
            self.built.retain(|name, _| !varied(name));
        }
    }

    /// Names of what was built.
    pub fn names(&self) -> Vec<&'static str> {
        self.built.keys().copied().collect()
    }

    /// The pass, built if it is not yet. `target` is the format that its fragments write, where it writes one.
    pub fn get(
        &mut self,
        pass: &Pass,
        target: Option<wgpu::TextureFormat>,
    ) -> Result<Arc<BuiltPass>, GpuError> {
        if let Some(built) = self.built.get(pass.name) {
            return Ok(built.clone());
        }
        let built = Arc::new(self.build(pass, target)?);
        self.built.insert(pass.name, built.clone());
        Ok(built)
    }

    /// The pass with the buffers that it names.
    pub fn bind(&mut self, pass: &Pass, buffers: &Named<'_>) -> Result<Bound, GpuError> {
        self.bind_to(pass, None, buffers)
    }

    /// [`Pipelines::bind`] for a pass whose fragments write colours of `target`.
    pub fn bind_to(
        &mut self,
        pass: &Pass,
        target: Option<wgpu::TextureFormat>,
        buffers: &Named<'_>,
    ) -> Result<Bound, GpuError> {
        let built = self.get(pass, target)?;
        let mut entries = Vec::new();
        for (binding, name) in built.layout.names.iter().enumerate() {
            let buffer = buffers.get(name).ok_or_else(|| GpuError::Pass {
                pass: pass.name,
                reason: format!("no buffer named {name}"),
            })?;
            entries.push(wgpu::BindGroupEntry {
                binding: binding as u32,
                resource: buffer.as_entire_binding(),
            });
        }
        let device = &self.gpu.device;
        let group = self
            .gpu
            .checked(|| {
                device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some(pass.name),
                    layout: &built.layout.group,
                    entries: &entries,
                })
            })
            .map_err(|reason| GpuError::Pass {
                pass: pass.name,
                reason,
            })?;
        Ok(Bound { pass: built, group })
    }

    fn build(
        &self,
        pass: &Pass,
        target: Option<wgpu::TextureFormat>,
    ) -> Result<BuiltPass, GpuError> {
        let source = pass.source_for(self.pool, self.target);
        let draws = pass.stages() == wgpu::ShaderStages::VERTEX_FRAGMENT;
        let layout = layout(&self.gpu, pass, self.pool)?;
        let wrong = |reason| GpuError::Pass {
            pass: pass.name,
            reason,
        };
        let pipeline = self
            .gpu
            .checked(|| match draws {
                true => Pipeline::Render(self.render_pipeline(pass, &layout, source, target)),
                false => Pipeline::Compute(self.compute_pipeline(pass, &layout, source)),
            })
            .map_err(wrong)?;
        Ok(BuiltPass {
            name: pass.name,
            layout,
            pipeline,
        })
    }

    fn module(&self, pass: &Pass, source: String) -> wgpu::ShaderModule {
        self.gpu
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(pass.name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            })
    }

    fn pipeline_layout(&self, pass: &Pass, layout: &Layout) -> wgpu::PipelineLayout {
        self.gpu
            .device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(pass.name),
                bind_group_layouts: &[Some(&layout.group)],
                immediate_size: 0,
            })
    }

    fn compute_pipeline(
        &self,
        pass: &Pass,
        layout: &Layout,
        source: String,
    ) -> wgpu::ComputePipeline {
        let module = self.module(pass, source);
        self.gpu
            .device
            .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(pass.name),
                layout: Some(&self.pipeline_layout(pass, layout)),
                module: &module,
                entry_point: Some(pass.entry_points[0]),
                compilation_options: Default::default(),
                cache: None,
            })
    }

    fn render_pipeline(
        &self,
        pass: &Pass,
        layout: &Layout,
        source: String,
        target: Option<wgpu::TextureFormat>,
    ) -> wgpu::RenderPipeline {
        let module = self.module(pass, source);
        let attaches = pass.has_target() && self.target == VisbufferTarget::Attachment;
        let color = wgpu::ColorTargetState {
            format: target.unwrap_or(ID_FORMAT),
            blend: None,
            write_mask: match target.is_some() || attaches {
                true => wgpu::ColorWrites::ALL,
                false => wgpu::ColorWrites::empty(),
            },
        };
        // Clusters come in the order of their ids, so the last of equal depths has the largest id.
        let depth = wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: Default::default(),
            bias: Default::default(),
        };
        self.gpu
            .device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(pass.name),
                layout: Some(&self.pipeline_layout(pass, layout)),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(pass.entry_points[0]),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                // Back faces are drawn too: the nearest surface wins, and shading knows which side it sees.
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: attaches.then_some(depth),
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(pass.entry_points[1]),
                    compilation_options: Default::default(),
                    targets: &[Some(color)],
                }),
                multiview_mask: None,
                cache: None,
            })
    }
}

impl Bound {
    /// Name of the pass.
    pub fn name(&self) -> &'static str {
        self.pass.name
    }

    /// Sets pipeline and buffers of a compute pass.
    pub fn set_compute(&self, encoder: &mut wgpu::ComputePass<'_>) {
        if let Pipeline::Compute(pipeline) = &self.pass.pipeline {
            encoder.set_pipeline(pipeline);
            encoder.set_bind_group(0, &self.group, &[]);
        }
    }

    /// Sets pipeline and buffers of a pass that draws.
    pub fn set_render(&self, encoder: &mut wgpu::RenderPass<'_>) {
        if let Pipeline::Render(pipeline) = &self.pass.pipeline {
            encoder.set_pipeline(pipeline);
            encoder.set_bind_group(0, &self.group, &[]);
        }
    }
}

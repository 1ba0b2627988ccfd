//! Records one frame's commands: every pass by name, timed where the adapter can.

use lodestream_shaders::cpu::view;

use super::pipelines::Bound;
use super::timestamps::Timestamps;

/// The commands of a frame in the making.
#[derive(Debug)]
pub struct Recorder<'a> {
    /// Where copies and clears go.
    pub encoder: wgpu::CommandEncoder,
    timestamps: Option<&'a Timestamps>,
    /// Name of each timed span so far.
    pub spans: Vec<&'static str>,
    /// Name of each pass so far; a pass that runs several times stands once.
    pub passes: Vec<&'static str>,
}

/// Workgroups for `items` of a pass with a thread an item.
pub fn workgroups(items: u32) -> [u32; 3] {
    view::workgroups(items, view::WORKGROUP_THREADS)
}

/// The dispatches of one compute span.
#[derive(Debug)]
pub struct Dispatches<'a> {
    pass: wgpu::ComputePass<'a>,
    passes: &'a mut Vec<&'static str>,
}

impl Dispatches<'_> {
    /// Runs `bound` with as many workgroups.
    pub fn run(&mut self, bound: &Bound, workgroups: [u32; 3]) {
        note(self.passes, bound);
        bound.set_compute(&mut self.pass);
        let [x, y, z] = workgroups;
        self.pass.dispatch_workgroups(x, y, z);
    }

    /// Runs `bound` with as many workgroups as `args` says at `offset` bytes.
    pub fn run_indirect(&mut self, bound: &Bound, args: &wgpu::Buffer, offset: usize) {
        note(self.passes, bound);
        bound.set_compute(&mut self.pass);
        self.pass.dispatch_workgroups_indirect(args, offset as u64);
    }
}

fn note(passes: &mut Vec<&'static str>, bound: &Bound) {
    if !passes.contains(&bound.name()) {
        passes.push(bound.name());
    }
}

impl<'a> Recorder<'a> {
    /// Nothing recorded yet.
    pub fn new(device: &wgpu::Device, timestamps: Option<&'a Timestamps>) -> Self {
        Self {
            encoder: device.create_command_encoder(&Default::default()),
            timestamps,
            spans: Vec::new(),
            passes: Vec::new(),
        }
    }

    /// A compute span named `name`.
    pub fn compute(&mut self, name: &'static str, record: impl FnOnce(&mut Dispatches<'_>)) {
        let span = self.timestamps.and_then(|all| all.span(self.spans.len()));
        let timestamp_writes = span.map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        });
        self.spans.push(name);
        let pass = self
            .encoder
            .begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(name),
                timestamp_writes,
            });
        record(&mut Dispatches {
            pass,
            passes: &mut self.passes,
        });
    }

    /// A span named `name` that draws `bound` with the arguments at `offset` bytes of `args`. The
    /// ids are kept where there is an attachment of depths.
    pub fn draw_indirect(
        &mut self,
        name: &'static str,
        bound: &Bound,
        ids: &wgpu::TextureView,
        depths: Option<&wgpu::TextureView>,
        args: &wgpu::Buffer,
        offset: usize,
    ) {
        let span = self.timestamps.and_then(|all| all.span(self.spans.len()));
        let timestamp_writes = span.map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        });
        self.spans.push(name);
        note(&mut self.passes, bound);
        let store = match depths {
            Some(_) => wgpu::StoreOp::Store,
            None => wgpu::StoreOp::Discard,
        };
        let mut pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(bound.name()),
            color_attachments: &[Some(attachment(ids, store))],
            depth_stencil_attachment: depths.map(|view| wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        bound.set_render(&mut pass);
        pass.draw_indirect(args, offset as u64);
    }

    /// A span that covers `target` with one triangle of `bound`.
    pub fn cover(&mut self, bound: &Bound, target: &wgpu::TextureView) {
        note(&mut self.passes, bound);
        let mut pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(bound.name()),
            color_attachments: &[Some(attachment(target, wgpu::StoreOp::Store))],
            ..Default::default()
        });
        bound.set_render(&mut pass);
        pass.draw(0..3, 0..1);
    }
}

fn attachment(
    view: &wgpu::TextureView,
    store: wgpu::StoreOp,
) -> wgpu::RenderPassColorAttachment<'_> {
    wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations {
            load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
            store,
        },
    }
}

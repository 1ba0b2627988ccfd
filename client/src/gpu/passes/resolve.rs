//! Attachments of the hardware rasterizer, and their way to the visbuffer.

use lodestream_shaders::{VisbufferTarget, passes};

use super::Parts;
use crate::gpu::buffers::row_bytes;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::{Bound, DEPTH_FORMAT, ID_FORMAT};
use crate::gpu::recorder::Recorder;

/// Ids, which most targets leave unwritten, and depths where the target keeps both.
#[derive(Debug)]
pub struct Attachments {
    /// Results of the fragment stages.
    pub ids: wgpu::TextureView,
    kept: Option<Kept>,
    size: wgpu::Extent3d,
}

#[derive(Debug)]
struct Kept {
    depths: wgpu::TextureView,
    /// Of ids and depths.
    copies: [(wgpu::Texture, wgpu::Buffer); 2],
    resolve: Bound,
}

impl Attachments {
    /// Makes them in the picture's size.
    pub fn new(parts: &mut Parts<'_>) -> Result<Self, GpuError> {
        let [width, height] = parts.buffers.size_px();
        let largest = parts.gpu.limits.max_texture_dimension_2d;
        if width > largest || height > largest {
            return Err(GpuError::Limit {
                adapter: parts.gpu.name.clone(),
                expected: format!("a picture of {width}x{height} pixels"),
                found: format!("at most {largest} pixels an axis"),
            });
        }
        let size = wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        };
        let keeps = parts.pipelines.target() == VisbufferTarget::Attachment;
        let copied = match keeps {
            true => wgpu::TextureUsages::COPY_SRC,
            false => wgpu::TextureUsages::empty(),
        };
        let device = &parts.gpu.device;
        let texture = |label, format| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | copied,
                view_formats: &[],
            })
        };
        let ids = texture("ids", ID_FORMAT);
        let kept = match keeps {
            true => {
                let depths = texture("depths", DEPTH_FORMAT);
                let buffer = |name| parts.buffers.get(name).clone();
                Some(Kept {
                    depths: depths.create_view(&Default::default()),
                    copies: [
                        (ids.clone(), buffer("attached_ids")),
                        (depths, buffer("attached_depths")),
                    ],
                    resolve: parts.bind(&passes::RESOLVE)?,
                })
            }
            false => None,
        };
        Ok(Self {
            ids: ids.create_view(&Default::default()),
            kept,
            size,
        })
    }

    /// The depths, where they are kept.
    pub fn depths(&self) -> Option<&wgpu::TextureView> {
        self.kept.as_ref().map(|kept| &kept.depths)
    }

    /// Brings what was drawn to the visbuffer.
    pub fn record(&self, recorder: &mut Recorder<'_>, span: &'static str) {
        let Some(kept) = &self.kept else { return };
        for (texture, buffer) in &kept.copies {
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row_bytes(self.size.width)),
                rows_per_image: None,
            };
            let copy = wgpu::TexelCopyBufferInfo { buffer, layout };
            let encoder = &mut recorder.encoder;
            encoder.copy_texture_to_buffer(texture.as_image_copy(), copy, self.size);
        }
        let workgroups = [self.size.width.div_ceil(8), self.size.height.div_ceil(8), 1];
        recorder.compute(span, |dispatches| {
            dispatches.run(&kept.resolve, workgroups);
        });
    }
}

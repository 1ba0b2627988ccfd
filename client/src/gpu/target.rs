//! The way from the rasterizers to the visbuffer.

use lodestream_shaders::VisbufferTarget;

use super::device::Gpu;
use super::error::GpuError;
use super::renderer::Renderer;

/// The target of a device.
pub trait ForDevice {
    /// 64-bit atomics where the device has them, else two rounds.
    fn for_device(gpu: &Gpu) -> Self;
}

impl ForDevice for VisbufferTarget {
    fn for_device(gpu: &Gpu) -> Self {
        match gpu.has_wide_atomics {
            true => Self::U64,
            false => Self::TwoRound,
        }
    }
}

impl Renderer {
    /// How the rasterizers write the visbuffer.
    pub fn target(&self) -> VisbufferTarget {
        self.pipelines.target()
    }

    /// Another way to the visbuffer; `None` takes the best that the device has.
    pub fn set_target(&mut self, target: Option<VisbufferTarget>) -> Result<(), GpuError> {
        let target = target.unwrap_or_else(|| VisbufferTarget::for_device(&self.gpu));
        if target == VisbufferTarget::U64 && !self.gpu.has_wide_atomics {
            return Err(GpuError::Limit {
                adapter: self.gpu.name.clone(),
                expected: "64-bit atomics for --visbuffer u64".to_owned(),
                found: "none; two-round and attachment do without".to_owned(),
            });
        }
        if target != self.target() {
            self.unbind();
            self.pipelines.set_target(target);
            let attaches = target == VisbufferTarget::Attachment;
            self.buffers.set_attached(&self.gpu, attaches)?;
        }
        Ok(())
    }
}

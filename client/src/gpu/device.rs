//! The adapter and the device: Vulkan first, real before software, with 64-bit atomics where the
//! adapter has them.

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use wgpu::{Backend, DeviceType, Features};

use super::error::GpuError;

/// 64-bit atomic maximum: the cheapest way to the visbuffer. Adapters without it take two rounds of
/// 32 bits.
pub const WIDE_ATOMICS: Features =
    Features::SHADER_INT64.union(Features::SHADER_INT64_ATOMIC_MIN_MAX);

/// Device, queue and what is known of the adapter.
#[derive(Debug, Clone)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// The adapter's own limits, all granted.
    pub limits: wgpu::Limits,
    /// Name and backend, for reports and errors.
    pub name: String,
    /// Whether `gpu_ms` can be measured.
    pub has_timestamps: bool,
    /// Whether the visbuffer can be written by 64-bit atomics.
    pub has_wide_atomics: bool,
}

/// An instance of the backends that the passes run on.
pub fn instance() -> wgpu::Instance {
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12,
        flags: wgpu::InstanceFlags::from_build_config().with_env(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

impl Gpu {
    /// Opens the best adapter whose name contains `wanted` (any case) and which can present to `surface`, if given.
    pub fn open(
        instance: &wgpu::Instance,
        wanted: Option<&str>,
        surface: Option<&wgpu::Surface<'_>>,
    ) -> Result<(Self, wgpu::Adapter), GpuError> {
        Self::open_without(instance, wanted, surface, Features::empty())
    }

    /// [`Gpu::open`] as on an adapter that lacks `absent`.
    pub fn open_without(
        instance: &wgpu::Instance,
        wanted: Option<&str>,
        surface: Option<&wgpu::Surface<'_>>,
        absent: Features,
    ) -> Result<(Self, wgpu::Adapter), GpuError> {
        let adapter = choose(instance, wanted, surface)?;
        let info = adapter.get_info();
        let name = describe(&info);
        let limits = adapter.limits();
        let found = adapter.features().difference(absent);
        let has_wide_atomics = found.contains(WIDE_ATOMICS);
        let mut features = found & Features::TIMESTAMP_QUERY;
        if has_wide_atomics {
            features |= WIDE_ATOMICS;
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("lodestream"),
            required_features: features,
            required_limits: limits.clone(),
            ..Default::default()
        };
        let (device, queue) =
            ready(adapter.request_device(&descriptor)).map_err(|error| GpuError::NoDevice {
                adapter: name.clone(),
                reason: error.to_string(),
            })?;
        let gpu = Self {
            device,
            queue,
            limits,
            name,
            has_timestamps: features.contains(Features::TIMESTAMP_QUERY),
            has_wide_atomics,
        };
        Ok((gpu, adapter))
    }

    /// A device that computes nothing but validates everything, within the limits that every WebGPU
    /// adapter has: pipelines are checked on it where no adapter is.
    pub fn noop() -> Self {
        Self::noop_with(WIDE_ATOMICS)
    }

    /// [`Gpu::noop`] with `features` and no others.
    pub fn noop_with(features: Features) -> Self {
        let limits = wgpu::Limits::default();
        let (device, queue) = wgpu::Device::noop(&wgpu::DeviceDescriptor {
            label: Some("noop"),
            required_features: features,
            required_limits: limits.clone(),
            ..Default::default()
        });
        Self {
            device,
            queue,
            limits,
            name: "noop".to_owned(),
            has_timestamps: false,
            has_wide_atomics: features.contains(WIDE_ATOMICS),
        }
    }

    /// Most bytes that one storage binding, hence one buffer, may have.
    pub fn max_binding_bytes(&self) -> u64 {
        self.limits
            .max_storage_buffer_binding_size
            .min(self.limits.max_buffer_size)
    }

    /// Blocks until everything submitted has run and its callbacks were called.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map(|_| ())
            .map_err(|error| GpuError::Device(error.to_string()))
    }

    /// Runs `build` and turns what the device says against it into an error.
    pub fn checked<T>(&self, build: impl FnOnce() -> T) -> Result<T, String> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let built = build();
        // Every scope has to be closed, whichever of them says something.
        let said = [
            ready(validation.pop()),
            ready(internal.pop()),
            ready(memory.pop()),
        ];
        if let Some(error) = said.into_iter().flatten().next() {
            return Err(error.to_string());
        }
        Ok(built)
    }
}

fn choose(
    instance: &wgpu::Instance,
    wanted: Option<&str>,
    surface: Option<&wgpu::Surface<'_>>,
) -> Result<wgpu::Adapter, GpuError> {
    let adapters = ready(instance.enumerate_adapters(wgpu::Backends::all()));
    let fits = |adapter: &wgpu::Adapter| {
        let name = describe(&adapter.get_info()).to_lowercase();
        wanted.is_none_or(|wanted| name.contains(&wanted.to_lowercase()))
            && surface.is_none_or(|surface| adapter.is_surface_supported(surface))
    };
    let rank = |adapter: &wgpu::Adapter| {
        let info = adapter.get_info();
        let kind = match info.device_type {
            DeviceType::DiscreteGpu => 0,
            DeviceType::IntegratedGpu => 1,
            DeviceType::VirtualGpu => 2,
            DeviceType::Other => 3,
            DeviceType::Cpu => 4,
        };
        let able = adapter.features().contains(WIDE_ATOMICS);
        (!able, kind, info.backend != Backend::Vulkan)
    };
    let wanted_text = wanted.map_or(String::new(), |wanted| format!(" named like {wanted:?}"));
    adapters
        .into_iter()
        .filter(fits)
        .min_by_key(rank)
        .ok_or(GpuError::NoAdapter(wanted_text))
}

fn describe(info: &wgpu::AdapterInfo) -> String {
    format!("{} ({:?})", info.name, info.backend)
}

/// wgpu's native futures are ready when they are made or after a poll of the device; none of them needs an executor.
pub(crate) fn ready<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        match future.as_mut().poll(&mut context) {
            Poll::Ready(value) => return value,
            Poll::Pending => std::thread::yield_now(),
        }
    }
}

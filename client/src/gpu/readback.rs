//! Counters, streaming requests and timestamps back to the host, a few frames late and never waited for: a frame that
//! finds every slot of the ring in flight goes without.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use lodestream_shaders::types::{Counters, RequestRecord};

use super::buffers::Buffers;
use super::device::Gpu;
use super::error::GpuError;
use super::recorder::Recorder;
use super::timestamps::{TIMESTAMP_BYTES, Timestamps};

/// Frames in flight.
const SLOTS: usize = 4;
/// Requests copied at first; the copy doubles when a frame has more.
const FIRST_REQUESTS: u32 = 1 << 14;
const COUNTERS_OFFSET: u64 = TIMESTAMP_BYTES;
/// Copies start at multiples of 8 bytes.
const REQUESTS_OFFSET: u64 = COUNTERS_OFFSET + size_of::<Counters>() as u64;

const PENDING: u8 = 0;
const MAPPED: u8 = 1;
const FAILED: u8 = 2;

/// What one frame told.
#[derive(Debug, Clone)]
pub struct FrameResult {
    /// Number of the frame.
    pub frame: u64,
    /// Its counters.
    pub counters: Counters,
    /// Its requests; fewer than `counters.request_count` where the copy was too short.
    pub requests: Vec<RequestRecord>,
    /// Milliseconds a span, where the adapter has timestamps.
    pub gpu_ms: Vec<(&'static str, f64)>,
}

#[derive(Debug)]
struct InFlight {
    frame: u64,
    buffer: wgpu::Buffer,
    spans: Vec<&'static str>,
    requests: u32,
    state: Arc<AtomicU8>,
}

/// The ring.
#[derive(Debug)]
pub struct Readback {
    idle: Vec<wgpu::Buffer>,
    in_flight: VecDeque<InFlight>,
    requests: u32,
    most_requests: u32,
}

/// A frame's copy, between its recording and its submission.
#[derive(Debug)]
pub struct Recorded {
    buffer: wgpu::Buffer,
    spans: Vec<&'static str>,
    requests: u32,
}

impl Readback {
    /// Slots for a scene of `page_count` pages: a frame asks for each at most once.
    pub fn new(gpu: &Gpu, page_count: u32) -> Self {
        let mut readback = Self {
            idle: Vec::new(),
            in_flight: VecDeque::new(),
            requests: 0,
            most_requests: page_count.max(1),
        };
        readback.resize(gpu, FIRST_REQUESTS);
        readback
    }

    fn resize(&mut self, gpu: &Gpu, requests: u32) {
        self.requests = requests.min(self.most_requests);
        let bytes = REQUESTS_OFFSET + self.requests as u64 * size_of::<RequestRecord>() as u64;
        let make = |_| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("readback"),
                size: bytes.next_multiple_of(8),
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        self.idle = (0..SLOTS).map(make).collect();
    }

    /// Records the copies of a frame that ends here; `None` where every slot is in flight.
    pub fn record(
        &mut self,
        recorder: &mut Recorder<'_>,
        buffers: &Buffers,
        timestamps: Option<&Timestamps>,
    ) -> Option<Recorded> {
        if self.in_flight.len() >= SLOTS {
            return None;
        }
        let buffer = self.idle.pop()?;
        let spans = std::mem::take(&mut recorder.spans);
        let encoder = &mut recorder.encoder;
        if let Some(timestamps) = timestamps {
            timestamps.resolve(encoder, spans.len(), &buffer, 0);
        }
        let counters = size_of::<Counters>() as u64;
        encoder.copy_buffer_to_buffer(
            buffers.get("counters"),
            0,
            &buffer,
            COUNTERS_OFFSET,
            counters,
        );
        let bytes = self.requests as u64 * size_of::<RequestRecord>() as u64;
        encoder.copy_buffer_to_buffer(buffers.get("requests"), 0, &buffer, REQUESTS_OFFSET, bytes);
        Some(Recorded {
            buffer,
            spans,
            requests: self.requests,
        })
    }

    /// Asks for the copy of a frame that has been submitted.
    pub fn submitted(&mut self, frame: u64, recorded: Recorded) {
        let state = Arc::new(AtomicU8::new(PENDING));
        let told = state.clone();
        recorded
            .buffer
            .map_async(wgpu::MapMode::Read, .., move |result| {
                let value = if result.is_ok() { MAPPED } else { FAILED };
                told.store(value, Ordering::Release);
            });
        self.in_flight.push_back(InFlight {
            frame,
            buffer: recorded.buffer,
            spans: recorded.spans,
            requests: recorded.requests,
            state,
        });
    }

    /// Frames whose copies have not been collected.
    pub fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    /// The frames that have come back, oldest first. `wait` waits for all in flight.
    pub fn collect(
        &mut self,
        gpu: &Gpu,
        timestamps: Option<&Timestamps>,
        wait: bool,
    ) -> Result<Vec<FrameResult>, GpuError> {
        if wait {
            gpu.wait()?;
        } else {
            gpu.device
                .poll(wgpu::PollType::Poll)
                .map_err(|error| GpuError::Device(error.to_string()))?;
        }
        let mut results = Vec::new();
        while let Some(first) = self.in_flight.front() {
            match first.state.load(Ordering::Acquire) {
                PENDING => break,
                FAILED => {
                    return Err(GpuError::Device(
                        "a readback could not be mapped".to_owned(),
                    ));
                }
                _ => {}
            }
            let Some(done) = self.in_flight.pop_front() else {
                break;
            };
            results.push(read(&done, timestamps)?);
            done.buffer.unmap();
            // A buffer of before a growth is dropped.
            if done.requests == self.requests {
                self.idle.push(done.buffer);
            }
        }
        let wanted = results
            .iter()
            .map(|result| result.counters.request_count)
            .max();
        if wanted.is_some_and(|wanted| wanted > self.requests) {
            self.resize(gpu, wanted.unwrap_or(0).next_power_of_two());
        }
        Ok(results)
    }
}

fn read(done: &InFlight, timestamps: Option<&Timestamps>) -> Result<FrameResult, GpuError> {
    let bytes = done
        .buffer
        .get_mapped_range(..)
        .map_err(|error| GpuError::Device(error.to_string()))?;
    let (ticks, rest) = bytes.split_at(COUNTERS_OFFSET as usize);
    let (counters, requests) = rest.split_at(size_of::<Counters>());
    let counters: Counters = bytemuck::pod_read_unaligned(counters);
    let count = counters.request_count.min(done.requests) as usize;
    let requests = bytemuck::allocation::pod_collect_to_vec::<u8, RequestRecord>(
        &requests[..count * size_of::<RequestRecord>()],
    );
    let ticks = bytemuck::allocation::pod_collect_to_vec::<u8, u64>(ticks);
    Ok(FrameResult {
        frame: done.frame,
        counters,
        requests,
        gpu_ms: timestamps.map_or(Vec::new(), |all| all.milliseconds(&done.spans, &ticks)),
    })
}

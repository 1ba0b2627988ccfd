//! Milliseconds of the GPU a pass, where the adapter can tell.

use super::device::Gpu;

/// Most timed passes a frame.
const MOST_SPANS: u32 = 32;
/// Bytes that the readback of one frame's timestamps takes.
pub const TIMESTAMP_BYTES: u64 = MOST_SPANS as u64 * 2 * 8;

/// Query set and the buffer that it resolves to.
#[derive(Debug)]
pub struct Timestamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    period_ns: f32,
}

impl Timestamps {
    /// `None` where the adapter has no timestamps.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        gpu.has_timestamps.then(|| Self {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: MOST_SPANS * 2,
            }),
            resolved: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: TIMESTAMP_BYTES,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            period_ns: gpu.queue.get_timestamp_period(),
        })
    }

    /// The query set and the first of span `index`'s two queries; `None` past the last span.
    pub fn span(&self, index: usize) -> Option<(&wgpu::QuerySet, u32)> {
        ((index as u32) < MOST_SPANS).then_some((&self.queries, index as u32 * 2))
    }

    /// Resolves the first `spans` spans and copies them to `target`.
    pub fn resolve(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        spans: usize,
        target: &wgpu::Buffer,
        target_offset: u64,
    ) {
        let queries = (spans as u32).min(MOST_SPANS) * 2;
        if queries > 0 {
            encoder.resolve_query_set(&self.queries, 0..queries, &self.resolved, 0);
            encoder.copy_buffer_to_buffer(
                &self.resolved,
                0,
                target,
                target_offset,
                queries as u64 * 8,
            );
        }
    }

    /// Milliseconds of each of `spans`, from the resolved ticks.
    pub fn milliseconds(&self, spans: &[&'static str], ticks: &[u64]) -> Vec<(&'static str, f64)> {
        let of =
            |pair: &[u64]| pair[1].saturating_sub(pair[0]) as f64 * self.period_ns as f64 / 1e6;
        spans
            .iter()
            .copied()
            .zip(ticks.chunks_exact(2).map(of))
            .collect()
    }
}

//! Page priorities to the dense list that the host reads back.

use lodestream_shaders::passes;

use super::Parts;
use crate::gpu::error::GpuError;
use crate::gpu::pipelines::Bound;
use crate::gpu::recorder::{Recorder, workgroups};

/// `compact_requests`.
#[derive(Debug)]
pub struct Requests {
    compact_requests: Bound,
    page_count: u32,
}

impl Requests {
    /// Binds the pass.
    pub fn new(parts: &mut Parts<'_>, page_count: u32) -> Result<Self, GpuError> {
        Ok(Self {
            compact_requests: parts.bind(&passes::COMPACT_REQUESTS)?,
            page_count,
        })
    }

    /// A thread a page.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        recorder.compute("compact_requests", |dispatches| {
            dispatches.run(&self.compact_requests, workgroups(self.page_count));
        });
    }
}

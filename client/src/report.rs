//! What a command says about what it did: the keys of the project's contract, absent where they do not apply.

use std::collections::BTreeMap;
use std::path::Path;

use lodestream_shaders::types::Counters;

use crate::picture::FileError;
use crate::subject::Subject;

/// A command's report. Seconds and bytes are plain numbers.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Report {
    /// Scene that was drawn.
    pub scene: String,
    /// Seconds until everything wanted was installed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settled_secs: Option<f64>,
    /// Seconds that opening the scene took.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open_secs: Option<f64>,
    /// Frames drawn, those that only asked for pages included.
    pub frames: u64,
    /// Page fetches sent.
    pub requests: u64,
    /// Pages that came and passed every check.
    pub pages_fetched: u64,
    /// Bytes of their frames, and of opening the scene and its textures.
    pub bytes_fetched: u64,
    /// Bytes of opening the scene alone.
    pub open_bytes: u64,
    /// Bytes of the texture objects.
    pub texture_bytes_fetched: u64,
    /// Pages in the pool.
    pub pages_resident: u64,
    /// Pages that left it.
    pub pages_evicted: u64,
    /// Bytes of the pool.
    pub pool_bytes: u64,
    /// What the last picture drew.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drawn: Option<Drawn>,
    /// Pixel error of the last picture.
    pub pixel_error_shown: f64,
    /// Pixel error that was asked for.
    pub pixel_error_asked: f64,
    /// Why the one exceeds the other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_error_limit: Option<String>,
    /// Milliseconds of the GPU a pass, medians over the pictures; absent where the adapter cannot tell.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub gpu_ms: BTreeMap<&'static str, f64>,
    /// Milliseconds a picture on the host's clock, from its recording to its end on the GPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_ms: Option<Percentiles>,
    /// Name and backend of the adapter.
    pub adapter: String,
    /// Way to the visbuffer: `u64`, `two-round` or `attachment`.
    pub visbuffer: &'static str,
    /// Passes that ran.
    pub passes_recorded: Vec<&'static str>,
    /// Pipelines that were built.
    pub pipelines_built: Vec<&'static str>,
    /// Bytes of the texel buffer.
    pub texture_bytes: u64,
    /// Largest mips left out of all textures, so that they can be bound.
    pub texture_mips_left_out: u32,
    /// Batches of a full-detail reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_batches: Option<u32>,
    /// Instances that lie, wholly or in part, outside of what the default camera frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instances_outside: Option<u64>,
    /// One line each.
    pub warnings: Vec<String>,
}

/// What a picture drew.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct Drawn {
    /// Instances in the frustum.
    pub instances: u64,
    /// Hierarchy nodes visited.
    pub nodes_visited: u64,
    /// Clusters drawn.
    pub clusters: u64,
    /// Their triangles.
    pub triangles: u64,
    /// Clusters drawn by the hardware rasterizer.
    pub clusters_hardware: u64,
    /// Clusters drawn by the compute rasterizer.
    pub clusters_software: u64,
    /// Instances below a pixel that are drawn as points.
    pub points: u64,
    /// Clusters that the depths of the last frame did not hide.
    pub clusters_early: u64,
    /// Clusters that those hid and this frame's did not.
    pub clusters_late: u64,
    /// Instances that are hidden whole.
    pub hidden_instances: u64,
    /// Children of hierarchy nodes that are hidden whole.
    pub hidden_nodes: u64,
    /// Clusters that are hidden, of visible nodes.
    pub hidden_clusters: u64,
    /// Clusters that the cut and the frustum were asked about.
    pub candidates: u64,
}

impl From<&Counters> for Drawn {
    fn from(counters: &Counters) -> Self {
        Self {
            instances: counters.instances_drawn as u64,
            nodes_visited: counters.nodes_visited as u64,
            clusters: counters.visible_count as u64,
            triangles: counters.triangles_drawn as u64,
            clusters_hardware: counters.hardware_count as u64,
            clusters_software: counters.compute_count as u64,
            points: counters.point_count as u64,
            clusters_early: counters.early_count as u64,
            clusters_late: (counters.drawn_count - counters.early_count) as u64,
            hidden_instances: counters.hidden_instances as u64,
            hidden_nodes: counters.hidden_nodes as u64,
            hidden_clusters: counters.hidden_clusters as u64,
            candidates: counters.candidate_count as u64,
        }
    }
}

/// Two points of a distribution.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Percentiles {
    /// Half of the values are at most this.
    pub p50: f64,
    /// All but a hundredth are.
    pub p99: f64,
}

impl Percentiles {
    /// Nearest-rank percentiles; `None` of nothing.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let rank = |share: f64| {
            let index = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(index.max(1) - 1).copied()
        };
        Some(Self {
            p50: rank(0.5)?,
            p99: rank(0.99)?,
        })
    }
}

impl Report {
    /// Says, here and on standard error, what the camera that frames `subject` leaves out.
    pub fn tell_outside(&mut self, subject: &Subject) {
        self.instances_outside = Some(subject.instances_outside);
        if let Some(note) = subject.note() {
            tracing::warn!("{note}");
            self.warnings.push(note);
        }
    }

    /// Writes the report as JSON.
    pub fn write(&self, file: &Path) -> Result<(), FileError> {
        let mut text =
            serde_json::to_string_pretty(self).map_err(|error| FileError::new(file, error))?;
        text.push('\n');
        std::fs::write(file, text).map_err(|error| FileError::new(file, error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_ranks() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        let expected = Percentiles {
            p50: 50.0,
            p99: 99.0,
        };
        assert_eq!(Percentiles::of(&values), Some(expected));
        assert_eq!(
            Percentiles::of(&[7.0]),
            Some(Percentiles { p50: 7.0, p99: 7.0 })
        );
        assert_eq!(Percentiles::of(&[]), None);
    }
}

//! Error against build time over the knobs of the build.
//!
//! A new knob of [`BuildOptions`] is one more line in [`ALL`].

use lodestream_format::frame::Codec;
use lodestream_server::build::{BuildOptions, Placement, PositionStep};
use lodestream_server::import::Mesh;
use rayon::ThreadPool;
use serde::Serialize;

use super::curves::{CutFigures, Figure, Measuring, SourceSurface};
use super::dag::{ClusterDag, center_metres, source_places};
use super::edges::SourceBorder;
use super::process::median;
use super::rows::run_ours;
use super::target::StudyError;

/// The cut that settings are compared by has this share of the input's triangles.
const TRIANGLE_SHARE: f64 = 1.0 / 16.0;

/// Options under the name of the setting.
type Setting = (String, BuildOptions);

/// An option of the build: its name, and the settings to try on a mesh of a longest side in metres.
pub struct Knob {
    /// Name of the curve.
    pub name: &'static str,
    /// What to try.
    pub settings: fn(extent_metres: f64) -> Vec<Setting>,
}

/// Every knob there is.
pub const ALL: [Knob; 3] = [
    Knob {
        name: "position step",
        settings: |extent_metres| {
            let coarse = [16, 14, 12, 10].map(|bits| {
                let position_step = PositionStep::Metres(extent_metres / f64::from(1 << bits));
                let options = BuildOptions {
                    position_step,
                    ..BuildOptions::default()
                };
                (format!("extent / 2^{bits}"), options)
            });
            let auto = ("auto".into(), BuildOptions::default());
            std::iter::once(auto).chain(coarse).collect()
        },
    },
    Knob {
        name: "codec",
        settings: |_| {
            let all = [("zstd", Codec::Zstd), ("lz4", Codec::Lz4)];
            let options = |codec| BuildOptions {
                codec,
                ..BuildOptions::default()
            };
            all.map(|(name, codec)| (name.into(), options(codec)))
                .into()
        },
    },
    Knob {
        name: "placement",
        settings: |_| {
            let options = |placement| BuildOptions {
                placement,
                ..BuildOptions::default()
            };
            [Placement::Optimal, Placement::Subset]
                .map(|placement| (placement.name().into(), options(placement)))
                .into()
        },
    },
];

/// One setting, measured.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct KnobRow {
    /// The input.
    pub input: String,
    /// The knob.
    pub knob: &'static str,
    /// Its setting.
    pub setting: String,
    /// Median seconds from mesh to DAG.
    pub build_secs: f64,
    /// Median seconds from mesh to bytes.
    pub total_secs: f64,
    /// Pack and hierarchy over input triangles.
    pub stored_bytes_per_triangle: f64,
    /// Largest distance of a cut of a sixteenth of the triangles, metres; on a line between levels.
    pub max_metres: Option<f64>,
    /// Its root mean square, metres.
    pub rms_metres: Option<f64>,
    /// Why there is nothing.
    pub refused: Vec<String>,
}

/// Tries every setting of every knob on `mesh`.
///
/// # Errors
/// A built asset that does not read back.
pub fn rows(
    input: &str,
    mesh: &Mesh,
    pool: &ThreadPool,
    runs: usize,
    most_samples: usize,
) -> Result<Vec<KnobRow>, StudyError> {
    let mut rows = Vec::new();
    for knob in &ALL {
        for (setting, options) in (knob.settings)(extent_metres(mesh)) {
            let mut last = None;
            let timed: Vec<_> = (0..runs.max(1))
                .map(|_| {
                    run_ours(std::slice::from_ref(mesh), &options, pool, |built| {
                        last = Some(built);
                    })
                })
                .collect();
            let mut row = KnobRow {
                input: input.into(),
                knob: knob.name,
                setting,
                build_secs: median(timed.iter().map(|run| run.build_secs)),
                total_secs: median(timed.iter().map(|run| run.total_secs)),
                refused: timed[0].refused.clone(),
                ..KnobRow::default()
            };
            if let Some(built) = last {
                let dag = ClusterDag::of_asset(&built).map_err(|source| StudyError::Format {
                    input: input.into(),
                    source,
                })?;
                let source = SourceSurface::new(source_places(mesh, center_metres(&built)));
                let measuring = Measuring {
                    dag: &dag,
                    source: &source,
                    border: SourceBorder::new(&dag),
                    step_metres: built.asset.position_grid.step(),
                    most_samples,
                };
                let levels = measuring.levels();
                let triangles = mesh.triangles.len() as f64;
                let wanted = triangles * TRIANGLE_SHARE;
                row.max_metres = error_at(&levels, |cut| cut.max_metres, wanted);
                row.rms_metres = error_at(&levels, |cut| cut.rms_metres, wanted);
                let bytes = built.report.bytes.stored + built.report.bytes.hierarchy;
                row.stored_bytes_per_triangle = bytes as f64 / triangles;
            }
            rows.push(row);
        }
    }
    Ok(rows)
}

/// Longest side of the mesh's box, metres.
fn extent_metres(mesh: &Mesh) -> f64 {
    let side = |axis: usize| {
        let along = || {
            mesh.positions
                .iter()
                .map(|position| f64::from(position[axis]))
        };
        along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
    };
    (0..3).map(side).fold(0.0, f64::max)
}

/// The error of a curve (fine to coarse) at a number of triangles, on straight lines between its logarithms.
fn error_at(curve: &[CutFigures], figure: Figure, triangles: f64) -> Option<f64> {
    curve.windows(2).find_map(|pair| {
        let [fine, coarse] = [pair[0], pair[1]].map(|cut| (cut.triangles as f64, figure(&cut)));
        if !(coarse.0..=fine.0).contains(&triangles) || fine.1 <= 0.0 || coarse.0 >= fine.0 {
            return None;
        }
        let share = (fine.0 / triangles).ln() / (fine.0 / coarse.0).ln();
        Some((fine.1.ln() + share * (coarse.1 / fine.1).ln()).exp())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_between_two_levels() {
        let cut = |triangles, rms_metres| CutFigures {
            triangles,
            rms_metres,
            ..CutFigures::default()
        };
        let levels = [cut(1000, 0.01), cut(100, 0.1), cut(10, 1.0)];
        let at = |triangles| error_at(&levels, |cut| cut.rms_metres, triangles);
        assert!((at(100.0).unwrap() - 0.1).abs() < 1e-12);
        assert!((at(1000.0 / 10f64.sqrt()).unwrap() - 0.01 * 10f64.sqrt()).abs() < 1e-9);
        assert_eq!((at(2000.0), at(5.0)), (None, None));
    }
}

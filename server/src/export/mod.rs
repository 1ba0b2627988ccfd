//! Export: a crack-free cut of a scene as plain meshes, for whoever has no streaming viewer.
//!
//! The cut is the viewer's own with one world-space error everywhere (`cut`); its clusters are welded to one mesh an asset
//! (`mesh`) and written as `.glb` (`glb`) or `.ply` (`ply`).

mod cut;
mod glb;
mod material;
mod mesh;
mod ply;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use lodestream_format::Scene;
use tokio::runtime::Handle;

use crate::library::{Library, LibraryError};
use cut::SceneAssetCut;
use mesh::PlainMesh;

/// How fine the cut is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Detail {
    /// At most this error, metres in the world, or that of the rounding of the source where it is
    /// larger.
    Error(f64),
    /// The smallest error whose cut has at most so many triangles, every instance counted.
    Triangles(u64),
    /// The source triangles.
    Source,
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ExportReport {
    /// World-space error bound of the cut, metres; for the source that of its rounding to the
    /// position grid.
    pub error_metres: f64,
    /// Triangles, each asset once.
    pub triangles: u64,
    /// Triangles, every instance counted.
    pub drawn_triangles: u64,
    /// Assets.
    pub assets: u64,
    /// Instances.
    pub instances: u64,
}

/// Why a scene cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The library has it not, or not whole.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// Even the coarsest cut has more triangles.
    #[error(
        "scene {scene}: expected a cut of at most {limit} triangles, found {coarsest} in the coarsest"
    )]
    TooFew {
        /// The scene.
        scene: String,
        /// What was asked for.
        limit: u64,
        /// What there is.
        coarsest: u64,
    },
    /// The name of the file says no format.
    #[error("{}: expected a name that ends in .glb or .ply", .0.display())]
    Format(PathBuf),
    /// More than the format's counters hold.
    #[error("{}: expected {expected}, found {found}; take a coarser cut", file.display())]
    TooLarge {
        /// The file.
        file: PathBuf,
        /// Most that the format holds.
        expected: String,
        /// What there is.
        found: String,
    },
    /// The file cannot be written.
    #[error("{}: cannot write: {cause}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// The operating system's reason.
        cause: std::io::Error,
    },
}

/// File formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FileFormat {
    Glb,
    Ply,
}

/// Writes a cut of the scene `name` to `out`, atomically.
pub fn export(
    runtime: &Handle,
    library: &Library,
    name: &str,
    detail: Detail,
    out: &Path,
) -> Result<ExportReport, ExportError> {
    let format = match out.extension().and_then(|extension| extension.to_str()) {
        Some(text) if text.eq_ignore_ascii_case("glb") => FileFormat::Glb,
        Some(text) if text.eq_ignore_ascii_case("ply") => FileFormat::Ply,
        _ => return Err(ExportError::Format(out.to_owned())),
    };
    let scene = runtime.block_on(async {
        let reference = library.reference(name).await?;
        library.scene(&reference.scene).await
    })?;
    let cuts = cut::scene_assets(runtime, library, &scene)?;
    let error_metres = match detail {
        Detail::Error(metres) => metres,
        Detail::Source => cut::SOURCE,
        Detail::Triangles(limit) => cut::error_of_triangles(runtime, library, &cuts, limit)?
            .map_err(|coarsest| ExportError::TooFew {
                scene: name.to_owned(),
                limit,
                coarsest,
            })?,
    };
    let meshes: Vec<PlainMesh> = cuts
        .iter()
        .map(|cut| mesh::weld(runtime, library, cut, error_metres))
        .collect::<Result<_, _>>()?;
    write_atomically(out, |file| match format {
        FileFormat::Glb => {
            let images = glb::images(runtime, library, &scene)?;
            glb::write(file, out, &scene, &meshes, &images)
        }
        FileFormat::Ply => ply::write(file, out, &scene, &meshes),
    })?;
    Ok(report(&scene, &cuts, &meshes, error_metres))
}

fn report(
    scene: &Scene,
    cuts: &[SceneAssetCut],
    meshes: &[PlainMesh],
    error_metres: f64,
) -> ExportReport {
    let drawn = |(cut, mesh): (&SceneAssetCut, &PlainMesh)| cut.instances * mesh.triangle_count();
    let rounding = cuts.iter().map(SceneAssetCut::rounding_in_world);
    ExportReport {
        error_metres: rounding.fold(error_metres.max(0.0), f64::max),
        triangles: meshes.iter().map(PlainMesh::triangle_count).sum(),
        drawn_triangles: cuts.iter().zip(meshes).map(drawn).sum(),
        assets: meshes.len() as u64,
        instances: scene.instances.len() as u64,
    }
}

/// Writes beside `out` and renames, so that a broken run leaves no half file under the name.
fn write_atomically(
    out: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let failed = |cause| ExportError::File {
        file: out.to_owned(),
        cause,
    };
    let mut partial = out.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    let written = File::create(&partial).map_err(failed).and_then(|file| {
        let mut file = BufWriter::with_capacity(1 << 20, file);
        write(&mut file)?;
        file.flush().map_err(failed)
    });
    let renamed = written.and_then(|()| std::fs::rename(&partial, out).map_err(failed));
    if renamed.is_err() {
        // The first error is the one to tell.
        let _ = std::fs::remove_file(&partial);
    }
    renamed
}

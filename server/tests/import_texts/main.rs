//! Text formats and their kin: what the author of a file meant, whatever his program wrote.

mod facets;
mod far;
mod foreign;
mod habits;
mod materials;
mod numbers;
mod polygons;
mod scans;
mod statements;

use std::path::PathBuf;

use glam::DVec3;
use lodestream_server::import::{ImportedScene, OpenOptions, import, open};

/// A folder with a model and files beside it.
struct Rig {
    folder: tempfile::TempDir,
}

impl Rig {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        Self { folder }
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, bytes).expect("writes");
        path
    }

    /// An image of one row, known again by its width.
    fn image(&self, name: &str, width: u32) {
        let path = self.folder.path().join(name);
        image::RgbImage::new(width, 1).save(path).expect("writes");
    }
}

/// Imports a file of this name and these bytes.
fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<ImportedScene, String> {
    let rig = Rig::new();
    import(&rig.write(name, bytes)).map_err(|error| error.to_string())
}

/// The same with every mesh read in pieces.
fn read_in_pieces(name: &str, bytes: impl AsRef<[u8]>) -> Result<ImportedScene, String> {
    let rig = Rig::new();
    let options = OpenOptions::with_max_mesh_bytes(0);
    let opened = open(&rig.write(name, bytes), &options);
    let scene = opened.and_then(|opened| opened.into_imported());
    scene.map_err(|error| error.to_string())
}

/// Corners of all triangles in the world, in f64.
fn corners(scene: &ImportedScene) -> Vec<[DVec3; 3]> {
    let mesh = &scene.meshes[0];
    let world = scene.instances[0].world_from_object;
    let corner = |at: u32| {
        let position = mesh.positions[at as usize].map(f64::from);
        world.transform_point3(position.into())
    };
    mesh.triangles.iter().map(|it| it.map(corner)).collect()
}

/// Sum of the areas, each counted as positive.
fn area(scene: &ImportedScene) -> f64 {
    let area = |[a, b, c]: &[DVec3; 3]| (b - a).cross(c - a).length() / 2.0;
    corners(scene).iter().map(area).sum()
}

/// Whether a warning says all of `words`.
fn warns(scene: &ImportedScene, words: &[&str]) -> bool {
    let says = |line: &String| words.iter().all(|word| line.contains(word));
    scene.warnings.iter().any(says)
}

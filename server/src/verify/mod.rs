//! Re-hashing and re-parsing everything: what passes here can be drawn.
//!
//! Every fault is found on its own: a damaged object does not hide the next one.

mod asset;
mod texture;

use std::collections::{BTreeMap, BTreeSet};

use futures_util::TryStreamExt;
use lodestream_format::scene::Texture;
use lodestream_format::{ContentHash, FormatError, Scene, library};
use tokio::runtime::Handle;

use crate::library::{Library, LibraryError};

/// What was looked at, and what is wrong with it.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct VerifyReport {
    /// Scenes.
    pub scenes: u64,
    /// Objects, each once.
    pub objects: u64,
    /// Bytes of the objects.
    pub bytes: u64,
    /// Build records; 0 where only one scene is checked.
    pub records: u64,
    /// Pages parsed.
    pub pages: u64,
    /// Clusters in them.
    pub clusters: u64,
    /// One line a fault: place, expected, found.
    pub faults: Vec<String>,
}

/// Checks one scene, or the whole library with the objects that hang on no scene.
///
/// # Errors
/// Only where nothing can be checked: no such scene, or a store that cannot list. All else is in the report.
pub fn verify(
    runtime: &Handle,
    library: &Library,
    scene: Option<&str>,
) -> Result<VerifyReport, LibraryError> {
    let mut verifier = Verifier {
        runtime,
        library,
        report: VerifyReport::default(),
        hashed: BTreeSet::new(),
        assets: BTreeSet::new(),
    };
    let names = match scene {
        Some(name) => vec![name.to_owned()],
        None => runtime.block_on(library.scene_names(None, usize::MAX))?,
    };
    for name in names {
        match runtime.block_on(library.reference(&name)) {
            Ok(reference) => verifier.scene(&name, &reference.scene),
            Err(error @ LibraryError::NoScene { .. }) if scene.is_some() => return Err(error),
            Err(error) => verifier.fault(error),
        }
    }
    if scene.is_none() {
        verifier.orphans()?;
        verifier.records()?;
        for error in runtime.block_on(library.no_files())? {
            verifier.fault(error);
        }
    }
    Ok(verifier.report)
}

struct Verifier<'a> {
    runtime: &'a Handle,
    library: &'a Library,
    report: VerifyReport,
    /// Objects whose bytes have been hashed.
    hashed: BTreeSet<ContentHash>,
    assets: BTreeSet<ContentHash>,
}

impl Verifier<'_> {
    fn fault(&mut self, error: LibraryError) {
        self.report.faults.push(error.to_string());
    }

    /// A fault in bytes that hash right.
    fn wrong(&mut self, place: String, error: FormatError) {
        let error = self.library.damaged(place, error);
        self.fault(error);
    }

    fn scene(&mut self, name: &str, hash: &ContentHash) {
        self.report.scenes += 1;
        let Some(scene) = self.object(hash, |library, bytes| library.decode_scene(hash, bytes))
        else {
            return;
        };
        let textures: BTreeMap<_, _> = scene
            .textures
            .iter()
            .map(|texture| (texture.object, texture))
            .collect();
        for texture in textures.values() {
            self.texture(texture);
        }
        for index in 0..scene.assets.len() {
            self.scene_asset(name, &scene, index);
        }
    }

    fn scene_asset(&mut self, name: &str, scene: &Scene, index: usize) {
        let used = &scene.assets[index];
        let slots = match self.runtime.block_on(self.library.asset(&used.asset)) {
            Ok(asset) => asset.material_slots as usize,
            // Told once, below.
            Err(_) => used.materials.len(),
        };
        if slots != used.materials.len() {
            let at = format!("scene asset {index} materials");
            let error = FormatError::new(at, slots, used.materials.len());
            self.wrong(format!("scene {name}"), error);
        }
        if self.assets.insert(used.asset) {
            self.asset(&used.asset);
        }
    }

    /// Reads an object whole, counts it, and parses it; `None` after a fault.
    fn object<T>(
        &mut self,
        hash: &ContentHash,
        parse: impl FnOnce(&Library, &[u8]) -> Result<T, LibraryError>,
    ) -> Option<T> {
        let parsed = self
            .runtime
            .block_on(self.library.object(hash))
            .and_then(|bytes| {
                self.count(hash, bytes.len() as u64);
                parse(self.library, &bytes)
            });
        parsed
            .map_err(|error| {
                // Told here, so that the sweep over all objects need not look again.
                self.hashed.insert(*hash);
                self.fault(error);
            })
            .ok()
    }

    fn count(&mut self, hash: &ContentHash, bytes: u64) {
        if self.hashed.insert(*hash) {
            self.report.objects += 1;
            self.report.bytes += bytes;
        }
    }

    fn texture(&mut self, texture: &Texture) {
        let path = library::object_path(&texture.object);
        self.object(&texture.object, |library, bytes| {
            texture::check(texture, bytes).map_err(|error| library.damaged(path, error))
        });
    }

    /// Checks build records against their own hashes; their objects may be missing.
    fn records(&mut self) -> Result<(), LibraryError> {
        let listed: Vec<_> = self.runtime.block_on(self.library.builds().try_collect())?;
        for key in listed.into_iter().filter_map(|entry| entry.hash) {
            self.report.records += 1;
            if let Err(error) = self.runtime.block_on(self.library.check_build(&key)) {
                self.fault(error);
            }
        }
        Ok(())
    }

    /// Hashes what no scene led to.
    fn orphans(&mut self) -> Result<(), LibraryError> {
        let listed: Vec<_> = self
            .runtime
            .block_on(self.library.objects().try_collect())?;
        for entry in listed {
            match entry.hash {
                None => {
                    let expected = "an object, named objects/ab/ab12…";
                    let error = FormatError::new("file", expected, "another name");
                    self.wrong(entry.path, error);
                }
                Some(hash) if self.hashed.contains(&hash) => {}
                Some(hash) => match self.runtime.block_on(self.library.check_object(&hash)) {
                    Ok(bytes) => self.count(&hash, bytes),
                    Err(error) => self.fault(error),
                },
            }
        }
        Ok(())
    }
}

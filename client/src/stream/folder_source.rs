//! A library folder, read directly.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use lodestream_format::library::{SCENES, SceneReference, object_path, scene_path};
use lodestream_format::wire::SceneEntry;
use lodestream_format::{Asset, ContentHash, FormatError, Scene};

use super::error::StreamError;
use super::opened_scene::OpenParts;
use super::page_check::pack_range;

#[derive(Debug)]
pub(crate) struct FolderSource {
    root: PathBuf,
}

impl FolderSource {
    pub(crate) fn new(folder: &str) -> Result<Self, StreamError> {
        let root = PathBuf::from(folder);
        let found = match root.join(SCENES).metadata() {
            Ok(metadata) if metadata.is_dir() => return Ok(Self { root }),
            _ if !root.exists() => "nothing there",
            _ => "no such folder in it",
        };
        Err(StreamError::Location {
            location: folder.to_owned(),
            found: found.to_owned(),
        })
    }

    pub(crate) fn scenes(&self) -> Result<Vec<SceneEntry>, StreamError> {
        let folder = self.root.join(SCENES);
        let listed = std::fs::read_dir(&folder).map_err(StreamError::io(&folder))?;
        let mut names = Vec::new();
        for entry in listed {
            let entry = entry.map_err(StreamError::io(&folder))?;
            // What no scene can be named is a writer's temporary file.
            if let Ok(name) = entry.file_name().into_string()
                && scene_path(&name).is_ok()
            {
                names.push(name);
            }
        }
        names.sort_unstable();
        let entry = |name: String| {
            let reference = self.reference(&name)?;
            Ok(SceneEntry { name, reference })
        };
        names.into_iter().map(entry).collect()
    }

    fn reference(&self, name: &str) -> Result<SceneReference, StreamError> {
        let path = scene_path(name).map_err(StreamError::format("scene reference"))?;
        let path = self.root.join(path);
        let json = std::fs::read(&path).map_err(StreamError::io(&path))?;
        serde_json::from_slice(&json).map_err(|error| {
            let error = FormatError::new("scene reference", "its JSON", error);
            StreamError::format(path.display().to_string())(error)
        })
    }

    pub(crate) fn open(&self, scene: &str) -> Result<OpenParts, StreamError> {
        let mut parts = OpenParts::default();
        let hash = self.reference(scene)?.scene;
        parts.scene = Some(hash);
        self.add(&mut parts, &hash)?;
        let scene = Scene::decode(parts.object(&hash)?)
            .map_err(StreamError::format(format!("scene {hash}")))?;
        for used in &scene.assets {
            if parts.root_pages.contains_key(&used.asset) {
                continue;
            }
            self.add(&mut parts, &used.asset)?;
            let asset = Asset::decode(parts.object(&used.asset)?)
                .map_err(StreamError::format(format!("asset {}", used.asset)))?;
            self.add(&mut parts, &asset.hierarchy)?;
            if let Some(range) = pack_range(&asset, 0, asset.root_page_count - 1) {
                let frames = self.object_range(&asset.pack, range)?;
                parts.read_bytes += frames.len() as u64;
                parts.root_pages.insert(used.asset, frames);
            }
        }
        Ok(parts)
    }

    fn add(&self, parts: &mut OpenParts, hash: &ContentHash) -> Result<(), StreamError> {
        let bytes = self.object(hash)?;
        parts.read_bytes += bytes.len() as u64;
        parts.objects.insert(*hash, bytes);
        Ok(())
    }

    fn object_file(&self, hash: &ContentHash) -> PathBuf {
        self.root.join(object_path(hash))
    }

    pub(crate) fn object(&self, hash: &ContentHash) -> Result<Bytes, StreamError> {
        let path = self.object_file(hash);
        let bytes = std::fs::read(&path).map_err(StreamError::io(&path))?;
        Ok(Bytes::from(bytes))
    }

    pub(crate) fn object_range(
        &self,
        hash: &ContentHash,
        range: Range<u64>,
    ) -> Result<Bytes, StreamError> {
        let path = self.object_file(hash);
        read_range(&path, range)
    }
}

fn read_range(path: &Path, range: Range<u64>) -> Result<Bytes, StreamError> {
    let mut file = File::open(path).map_err(StreamError::io(path))?;
    file.seek(SeekFrom::Start(range.start))
        .map_err(StreamError::io(path))?;
    let mut bytes = Vec::new();
    let expected_bytes = range.end - range.start;
    file.take(expected_bytes)
        .read_to_end(&mut bytes)
        .map_err(StreamError::io(path))?;
    if bytes.len() as u64 == expected_bytes {
        return Ok(Bytes::from(bytes));
    }
    Err(StreamError::Length {
        place: format!("{} from byte {}", path.display(), range.start),
        expected_bytes,
        found_bytes: bytes.len() as u64,
    })
}

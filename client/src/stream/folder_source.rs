//! A library folder, read directly.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use lodestream_format::library::{SCENES, SceneReference, object_path, scene_path};
use lodestream_format::wire::{Block, BlockHeader, BlockKind, PageStatus, SceneEntry};
use lodestream_format::{ContentHash, FormatError};

use super::error::StreamError;
use super::open_parts::OpenParts;
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

    pub(crate) fn open(&self, scene: &str, memory_bytes: u64) -> Result<OpenParts, StreamError> {
        let mut parts = OpenParts::new(memory_bytes);
        let hash = self.reference(scene)?.scene;
        self.add(&mut parts, BlockKind::Scene, hash)?;
        for hash in parts.named_assets() {
            self.add(&mut parts, BlockKind::Asset, hash)?;
            let asset = parts.asset(&hash)?;
            let (hierarchy, pack) = (asset.hierarchy, asset.pack);
            let roots = pack_range(asset, 0, asset.root_page_count - 1).unwrap_or(0..0);
            self.add(&mut parts, BlockKind::Hierarchy, hierarchy)?;
            let header = header(BlockKind::RootPages, hash, roots.end - roots.start);
            parts.announced(&header)?;
            let frames = read_range(&self.object_file(&pack), roots)?;
            parts.take(whole(header, frames))?;
        }
        Ok(parts)
    }

    fn add(
        &self,
        parts: &mut OpenParts,
        kind: BlockKind,
        hash: ContentHash,
    ) -> Result<(), StreamError> {
        let path = self.object_file(&hash);
        let metadata = path.metadata().map_err(StreamError::io(&path))?;
        let header = header(kind, hash, metadata.len());
        parts.announced(&header)?;
        let bytes = read_range(&path, 0..metadata.len())?;
        parts.take(whole(header, bytes))
    }

    fn object_file(&self, hash: &ContentHash) -> PathBuf {
        self.root.join(object_path(hash))
    }

    pub(crate) fn object(&self, hash: &ContentHash, most_bytes: u64) -> Result<Bytes, StreamError> {
        let path = self.object_file(hash);
        let metadata = path.metadata().map_err(StreamError::io(&path))?;
        match metadata.len() <= most_bytes {
            true => Ok(read_range(&path, 0..metadata.len())?.into()),
            false => Err(StreamError::Length {
                place: path.display().to_string(),
                expected_bytes: most_bytes,
                found_bytes: metadata.len(),
            }),
        }
    }

    pub(crate) fn object_range(
        &self,
        hash: &ContentHash,
        range: Range<u64>,
    ) -> Result<Bytes, StreamError> {
        let path = self.object_file(hash);
        read_range(&path, range).map(Bytes::from)
    }
}

fn header(kind: BlockKind, hash: ContentHash, payload_bytes: u64) -> BlockHeader {
    BlockHeader {
        kind,
        status: PageStatus::Ok,
        page: 0,
        hash,
        payload_bytes,
    }
}

fn whole(header: BlockHeader, payload: Vec<u8>) -> Block {
    Block {
        kind: header.kind,
        status: header.status,
        page: header.page,
        hash: header.hash,
        payload,
    }
}

fn read_range(path: &Path, range: Range<u64>) -> Result<Vec<u8>, StreamError> {
    let mut file = File::open(path).map_err(StreamError::io(path))?;
    file.seek(SeekFrom::Start(range.start))
        .map_err(StreamError::io(path))?;
    let mut bytes = Vec::new();
    let expected_bytes = range.end - range.start;
    file.take(expected_bytes)
        .read_to_end(&mut bytes)
        .map_err(StreamError::io(path))?;
    if bytes.len() as u64 == expected_bytes {
        return Ok(bytes);
    }
    Err(StreamError::Length {
        place: format!("{} from byte {}", path.display(), range.start),
        expected_bytes,
        found_bytes: bytes.len() as u64,
    })
}

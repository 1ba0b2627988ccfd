//! Buffers: the bytes behind the document, and the views into them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gltf::json::Root;

use super::error::{Read, cannot_read, malformed};
use super::uri::{self, Target};

/// All buffers of a file, each exactly as long as the document says.
pub(super) struct Buffers<'a> {
    buffers: Vec<BufferBytes<'a>>,
}

enum BufferBytes<'a> {
    /// The glb's binary chunk, without its padding.
    Chunk(&'a [u8]),
    /// Several buffers may name one file; it is read once.
    Shared { file: Arc<Vec<u8>>, length: usize },
}

/// A buffer view's bytes.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) bytes: &'a [u8],
    /// Where the view starts in its buffer: alignment is told from there.
    pub(super) offset_in_buffer: usize,
    /// `None`: elements lie tight.
    pub(super) stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    /// Reads every buffer that the document lists.
    pub(super) fn load(root: &Root, bin: Option<&'a [u8]>, folder: &Path) -> Read<Self> {
        let mut files: HashMap<PathBuf, Arc<Vec<u8>>> = HashMap::new();
        let mut buffers = Vec::with_capacity(root.buffers.len());
        for (at, buffer) in root.buffers.iter().enumerate() {
            let place = format!("buffers[{at}]");
            let too_short = |found: usize| {
                let expected = format!("byteLength {} at least", buffer.byte_length.0);
                malformed(&place, expected, format!("{found} bytes"))
            };
            let length = usize::try_from(buffer.byte_length.0).unwrap_or(usize::MAX);
            let file = match (&buffer.uri, bin) {
                (None, Some(bin)) if at == 0 => {
                    let bytes = bin.get(..length).ok_or_else(|| too_short(bin.len()))?;
                    buffers.push(BufferBytes::Chunk(bytes));
                    continue;
                }
                (None, _) => {
                    let expected = "a uri, or in a .glb a binary chunk for the first buffer";
                    return Err(malformed(place, expected, "neither"));
                }
                (Some(uri), _) => match uri::resolve(uri, folder, &format!("{place}.uri"))? {
                    Target::Data(bytes) => Arc::new(bytes),
                    Target::File(path) => match files.get(&path) {
                        Some(file) => file.clone(),
                        None => {
                            let bytes = std::fs::read(&path)
                                .map_err(|cause| cannot_read(&place, &path, &cause))?;
                            let file = Arc::new(bytes);
                            files.insert(path, file.clone());
                            file
                        }
                    },
                },
            };
            if file.len() < length {
                return Err(too_short(file.len()));
            }
            buffers.push(BufferBytes::Shared { file, length });
        }
        Ok(Self { buffers })
    }

    /// All bytes together: what a file can account for.
    pub(super) fn total_bytes(&self) -> u64 {
        self.buffers.iter().map(|it| it.bytes().len() as u64).sum()
    }

    /// The bytes of `bufferViews[index]`, which `place` names.
    pub(super) fn view(&self, root: &Root, index: usize, place: &str) -> Read<View<'_>> {
        let here = format!("{place}.bufferView");
        let Some(view) = root.buffer_views.get(index) else {
            return Err(out_of_range(
                &here,
                "bufferViews",
                root.buffer_views.len(),
                index,
            ));
        };
        let here = format!("bufferViews[{index}]");
        let Some(buffer) = self.buffers.get(view.buffer.value()) else {
            let here = format!("{here}.buffer");
            let found = view.buffer.value();
            return Err(out_of_range(&here, "buffers", self.buffers.len(), found));
        };
        let buffer = buffer.bytes();
        let offset = view.byte_offset.unwrap_or_default().0;
        let bytes = usize::try_from(offset)
            .ok()
            .zip(usize::try_from(view.byte_length.0).ok())
            .and_then(|(offset, length)| buffer.get(offset..offset.checked_add(length)?));
        let Some(bytes) = bytes else {
            let expected = format!("a range within {} bytes", buffer.len());
            let found = format!("{} bytes at {offset}", view.byte_length.0);
            return Err(malformed(here, expected, found));
        };
        let stride = view.byte_stride.map(|stride| stride.0);
        if let Some(stride) = stride
            && (!(4..=252).contains(&stride) || stride % 4 != 0)
        {
            let here = format!("{here}.byteStride");
            return Err(malformed(here, "a multiple of 4 in 4..=252", stride));
        }
        Ok(View {
            bytes,
            offset_in_buffer: offset as usize,
            stride,
        })
    }
}

impl BufferBytes<'_> {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Chunk(bytes) => bytes,
            Self::Shared { file, length } => &file[..*length],
        }
    }
}

/// An index into one of the document's lists that is too large.
pub(super) fn out_of_range(
    place: &str,
    list: &str,
    length: usize,
    found: usize,
) -> super::error::Fault {
    malformed(
        place,
        format!("one of {length} {list}"),
        format!("index {found}"),
    )
}

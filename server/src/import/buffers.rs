//! Buffers: the bytes behind the document, and the views into them. Nothing is read before it is asked for, but for small
//! files and inline data.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Mutex;

use gltf::json::{Root, buffer};

use super::allowance::Allowance;
use super::decompress;
use super::error::{Fault, Read, malformed};
use super::file::{Extent, InputFile};
use super::uri::Target;

/// Files below this are read at once: many small ones would need many open files.
const SMALL_FILE_BYTES: u64 = 1 << 20;

/// All buffers of a file, each exactly as long as the document says.
pub(super) struct Buffers {
    /// `None` for a buffer that only stands in for compressed views: it need not be there.
    buffers: Vec<Option<Extent>>,
    /// Bytes of all buffers and decompressed views.
    held_bytes: u64,
    /// Decompressed views, each once.
    decompressed: Mutex<HashMap<usize, Extent>>,
}

/// Where a view's bytes stand: its buffer, the offset there and the length. A compressed view is a
/// buffer of its own.
pub(super) type Range = (Option<usize>, u64, u64);

/// A buffer view's bytes.
pub(super) struct View {
    pub(super) extent: Extent,
    /// Where the view starts in its buffer: alignment is told from there. 0 for a decompressed view.
    pub(super) offset_in_buffer: u64,
    /// `None`: elements lie tight.
    pub(super) stride: Option<usize>,
}

impl Buffers {
    /// Finds every buffer that the document lists; `bin` is the glb's binary chunk.
    pub(super) fn open(root: &Root, bin: Option<&Extent>, allowance: &Allowance) -> Read<Self> {
        let mut files: HashMap<PathBuf, Extent> = HashMap::new();
        let mut buffers = Vec::with_capacity(root.buffers.len());
        for (at, buffer) in root.buffers.iter().enumerate() {
            let place = format!("buffers[{at}]");
            if decompress::is_fallback(buffer) {
                buffers.push(None);
                continue;
            }
            let whole = match (&buffer.uri, bin) {
                (None, Some(bin)) if at == 0 => bin.clone(),
                (None, _) => {
                    let expected = "a uri, or in a .glb a binary chunk for the first buffer";
                    return Err(malformed(place, expected, "neither"));
                }
                (Some(uri), _) => match allowance.resolve(uri, &format!("{place}.uri"))? {
                    Target::Data(bytes) => {
                        allowance.take(bytes.len() as u64, &place)?;
                        Extent::memory(bytes)
                    }
                    // Several buffers may name one file.
                    Target::File(path) => match files.get(&path) {
                        Some(file) => file.clone(),
                        None => {
                            let mut file = Extent::file(InputFile::open(&path, &place)?);
                            if file.len() <= SMALL_FILE_BYTES {
                                allowance.take(file.len(), &place)?;
                                file = Extent::memory(file.to_vec()?);
                            }
                            files.insert(path, file.clone());
                            file
                        }
                    },
                },
            };
            let length = buffer.byte_length.0;
            let Some(extent) = whole.slice(0, length) else {
                let expected = format!("byteLength {length} at least");
                return Err(malformed(place, expected, format!("{} bytes", whole.len())));
            };
            buffers.push(Some(extent));
        }
        let mut buffers = Self {
            buffers,
            held_bytes: 0,
            decompressed: Mutex::default(),
        };
        let decompressed = decompress::check_total(root, buffers.total_bytes())?;
        allowance.take(decompressed, "bufferViews, decompressed")?;
        buffers.held_bytes = buffers.total_bytes().saturating_add(decompressed);
        Ok(buffers)
    }

    /// Bytes of all buffers and decompressed views.
    pub(super) fn held_bytes(&self) -> u64 {
        self.held_bytes
    }

    /// Where `bufferViews[index]`, which `place` names, has its bytes.
    pub(super) fn origin(&self, root: &Root, index: usize, place: &str) -> Read<Range> {
        let view = find_view(root, index, place)?;
        Ok(match decompress::find(view) {
            Some(_) => (None, index as u64, view.byte_length.0),
            None => {
                let offset = view.byte_offset.unwrap_or_default().0;
                (Some(view.buffer.value()), offset, view.byte_length.0)
            }
        })
    }

    /// All bytes together: what a file can account for.
    pub(super) fn total_bytes(&self) -> u64 {
        let lengths = self.buffers.iter().flatten().map(Extent::len);
        lengths.fold(0, u64::saturating_add)
    }

    /// The bytes of `bufferViews[index]`, which `place` names; decompressed where the view is compressed.
    pub(super) fn view(&self, root: &Root, index: usize, place: &str) -> Read<View> {
        let view = find_view(root, index, place)?;
        let here = format!("bufferViews[{index}]");
        let stride = view.byte_stride.map(|stride| stride.0);
        if let Some(stride) = stride
            && (!(4..=252).contains(&stride) || stride % 4 != 0)
        {
            let here = format!("{here}.byteStride");
            return Err(malformed(here, "a multiple of 4 in 4..=252", stride));
        }
        if let Some(compressed) = decompress::find(view) {
            return Ok(View {
                extent: self.decompress(index, view, compressed, &here)?,
                offset_in_buffer: 0,
                stride,
            });
        }
        let offset = view.byte_offset.unwrap_or_default().0;
        let buffer = view.buffer.value();
        Ok(View {
            extent: self.range(buffer, offset, view.byte_length.0, &here)?,
            offset_in_buffer: offset,
            stride,
        })
    }

    fn decompress(
        &self,
        index: usize,
        view: &buffer::View,
        compressed: decompress::Extension,
        place: &str,
    ) -> Read<Extent> {
        // Nothing panics while it is held.
        let known = || {
            self.decompressed
                .lock()
                .unwrap_or_else(|held| held.into_inner())
        };
        if let Some(extent) = known().get(&index) {
            return Ok(extent.clone());
        }
        let block = decompress::Block::parse(view, compressed, place)?;
        let source = self.range(block.buffer, block.offset, block.length, &block.place)?;
        let extent = Extent::memory(block.decode(&source.to_vec()?)?);
        Ok(known().entry(index).or_insert(extent).clone())
    }

    /// A range of a buffer, which `place` names.
    fn range(&self, buffer: usize, offset: u64, length: u64, place: &str) -> Read<Extent> {
        let Some(extent) = self.buffers.get(buffer) else {
            let place = format!("{place}.buffer");
            return Err(out_of_range(&place, "buffers", self.buffers.len(), buffer));
        };
        let Some(extent) = extent else {
            let place = format!("{place}.buffer");
            let found = format!("buffer {buffer}, a fallback without bytes");
            return Err(malformed(place, "a buffer with bytes", found));
        };
        extent.slice(offset, length).ok_or_else(|| {
            let expected = format!("a range within {} bytes", extent.len());
            malformed(place, expected, format!("{length} bytes at {offset}"))
        })
    }
}

fn find_view<'a>(root: &'a Root, index: usize, place: &str) -> Read<&'a buffer::View> {
    root.buffer_views.get(index).ok_or_else(|| {
        let here = format!("{place}.bufferView");
        out_of_range(&here, "bufferViews", root.buffer_views.len(), index)
    })
}

/// An index into one of the document's lists that is too large.
pub(super) fn out_of_range(place: &str, list: &str, length: usize, found: usize) -> Fault {
    let expected = format!("one of {length} {list}");
    malformed(place, expected, format!("index {found}"))
}

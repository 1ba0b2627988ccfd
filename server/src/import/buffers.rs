//! Buffers: the bytes behind the document, and the views into them. Nothing is read before it is asked for, but for small
//! files and inline data.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Mutex;

use super::allowance::Allowance;
use super::decompress;
use super::document::{BufferView, Index, Root, Whole};
use super::error::{Fault, Read, malformed, quoted};
use super::file::{Extent, InputFile};
use super::uri::Target;
use super::warnings::Warnings;

/// Files below this are read at once: many small ones would need many open files.
const SMALL_FILE_BYTES: u64 = 1 << 20;

/// All buffers of a file, each exactly as long as the document says.
pub(super) struct Buffers {
    /// A buffer that cannot be had is a fault where it is read: files list some that nobody reads,
    /// stand-ins for compressed views and the data of animations.
    buffers: Vec<Read<Extent>>,
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
    pub(super) fn open(
        root: &Root,
        bin: Option<&Extent>,
        allowance: &Allowance,
        warnings: &mut Warnings,
    ) -> Read<Self> {
        let mut files: HashMap<PathBuf, Extent> = HashMap::new();
        let buffers = (0..root.buffers.len())
            .map(|at| find(root, at, bin, allowance, &mut files, warnings))
            .collect();
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
            Some(_) => (None, index as u64, view.claimed_bytes()),
            None => {
                let buffer = view.buffer.map(Index::value);
                (buffer, view.byte_offset.0, view.claimed_bytes())
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
        let stride = match view.byte_stride {
            // Readers take 0 for tight, as the format's first version had it.
            None | Some(Whole(0)) => None,
            Some(Whole(stride)) if (4..=252).contains(&stride) && stride % 4 == 0 => {
                Some(stride as usize)
            }
            Some(Whole(stride)) => {
                let here = format!("{here}.byteStride");
                return Err(malformed(here, "a multiple of 4 in 4..=252", stride));
            }
        };
        if let Some(compressed) = decompress::find(view) {
            return Ok(View {
                extent: self.decompress(index, view, compressed, &here)?,
                offset_in_buffer: 0,
                stride,
            });
        }
        let offset = view.byte_offset.0;
        let buffer = demand(view.buffer, &format!("{here}.buffer"))?.value();
        let length = demand(view.byte_length, &format!("{here}.byteLength"))?.0;
        Ok(View {
            extent: self.range(buffer, offset, length, &here)?,
            offset_in_buffer: offset,
            stride,
        })
    }

    fn decompress(
        &self,
        index: usize,
        view: &BufferView,
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
        let extent = extent.as_ref().map_err(Fault::clone)?;
        extent.slice(offset, length).ok_or_else(|| {
            let expected = format!("a range within {} bytes", extent.len());
            malformed(place, expected, format!("{length} bytes at {offset}"))
        })
    }
}

/// The bytes of `buffers[at]`.
fn find(
    root: &Root,
    at: usize,
    bin: Option<&Extent>,
    allowance: &Allowance,
    files: &mut HashMap<PathBuf, Extent>,
    warnings: &mut Warnings,
) -> Read<Extent> {
    let buffer = &root.buffers[at];
    let place = format!("buffers[{at}]");
    let length = demand(buffer.byte_length, &format!("{place}.byteLength"))?.0;
    let whole = match (&buffer.uri, bin) {
        (None, _) if decompress::is_fallback(buffer) => {
            return Err(malformed(
                place,
                "a buffer with bytes",
                "a fallback without",
            ));
        }
        (None, Some(bin)) if at == 0 => bin.clone(),
        (None, _) => {
            let expected = "a uri, or in a .glb a binary chunk for the first buffer";
            return Err(malformed(place, expected, "neither"));
        }
        (Some(uri), _) => {
            let target = allowance.resolve(uri, &format!("{place}.uri"))?;
            if let Target::Misspelt(_) = target {
                let what = format!("buffer {} found by another spelling", quoted(uri));
                warnings.add(what, 1, &place);
            }
            match target {
                Target::Data(bytes) => {
                    allowance.take(bytes.len() as u64, &place)?;
                    Extent::memory(bytes)
                }
                Target::File(path) | Target::Misspelt(path) => {
                    open_file(path, &place, allowance, files)?
                }
            }
        }
    };
    whole.slice(0, length).ok_or_else(|| {
        let expected = format!("byteLength {length} at least");
        malformed(place, expected, format!("{} bytes", whole.len()))
    })
}

/// The file at `path`, once for all buffers that name it.
fn open_file(
    path: PathBuf,
    place: &str,
    allowance: &Allowance,
    files: &mut HashMap<PathBuf, Extent>,
) -> Read<Extent> {
    if let Some(file) = files.get(&path) {
        return Ok(file.clone());
    }
    let mut file = Extent::file(InputFile::open(&path, place)?);
    if file.len() <= SMALL_FILE_BYTES {
        allowance.take(file.len(), place)?;
        file = Extent::memory(file.to_vec()?);
    }
    files.insert(path, file.clone());
    Ok(file)
}

/// A member that must be there, which `place` names.
pub(super) fn demand<T>(member: Option<T>, place: &str) -> Read<T> {
    member.ok_or_else(|| malformed(place, "a value", "none"))
}

fn find_view<'a>(root: &'a Root, index: usize, place: &str) -> Read<&'a BufferView> {
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

//! Decompress: buffer views under `EXT_meshopt_compression` and its successor `KHR_meshopt_compression`, which keeps the
//! container and adds a newer vertex codec and a filter for colours.
//!
//! meshoptimizer's decoders are made for untrusted bytes, but they take lengths and strides on trust: those are
//! checked here first, and what a view unfolds to is held to what its bytes can account for.

use super::buffers::demand;
use super::document::{Buffer, BufferView, Extensions, Index, Meshopt, Root, Whole};
use super::error::{Read, malformed, short};

/// The extension's names.
pub(super) const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// The newer vertex codec spends two bits on up to 256 equal bytes.
const MOST_BYTES_PER_BYTE: u64 = 1024;
/// All views together: several may name the same bytes, and no real file comes near.
const MOST_TOTAL_BYTES_PER_BYTE: u64 = 256;
const TOTAL_BYTES_ALWAYS: u64 = 1 << 24;

/// The extension's object, with its name.
pub(super) type Extension<'a> = (&'static str, &'a Meshopt);

fn of(extensions: Option<&Extensions>) -> Option<Extension<'_>> {
    let extensions = extensions?;
    let both = [&extensions.ext_meshopt, &extensions.khr_meshopt];
    let mut named = NAMES.into_iter().zip(both);
    named.find_map(|(name, it)| Some((name, &**it.as_ref()?)))
}

/// The extension of a view.
pub(super) fn find(view: &BufferView) -> Option<Extension<'_>> {
    of(view.extensions.as_deref())
}

/// Whether the buffer may be without bytes: it stands for what readers without the extension would need.
pub(super) fn is_fallback(buffer: &Buffer) -> bool {
    of(buffer.extensions.as_deref()).is_some_and(|(_, it)| it.fallback)
}

/// Bytes of all compressed views. Refuses a small file whose views unfold to very much.
pub(super) fn check_total(root: &Root, bytes: u64) -> Read<u64> {
    let compressed = root.buffer_views.iter().filter(|view| find(view).is_some());
    let total = compressed.fold(0u64, |sum, view| sum.saturating_add(view.claimed_bytes()));
    let most = bytes
        .saturating_mul(MOST_TOTAL_BYTES_PER_BYTE)
        .max(TOTAL_BYTES_ALWAYS);
    match total <= most {
        true => Ok(total),
        false => {
            let expected = format!("compressed views of {most} bytes at most from {bytes} bytes");
            Err(malformed("bufferViews", expected, total))
        }
    }
}

/// A compressed view, checked.
pub(super) struct Block {
    pub(super) place: String,
    pub(super) buffer: usize,
    pub(super) offset: u64,
    pub(super) length: u64,
    count: usize,
    stride: usize,
    mode: Mode,
}

enum Mode {
    Attributes(Filter),
    Triangles,
    Indices,
}

enum Filter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

impl Block {
    /// Reads and checks the extension of `view`, which stands at `place`.
    pub(super) fn parse(
        view: &BufferView,
        (name, extension): Extension,
        place: &str,
    ) -> Read<Self> {
        let view_place = place;
        let place = format!("{place}.extensions.{name}");
        let number = |member: Option<Whole>, key: &str| {
            demand(member, &format!("{place}.{key}")).map(|number| number.0)
        };
        let buffer = demand(extension.buffer, &format!("{place}.buffer"))?;
        let offset = extension.byte_offset.0;
        let length = number(extension.byte_length, "byteLength")?;
        let count = number(extension.count, "count")?;
        let stride = number(extension.byte_stride, "byteStride")?;
        let filter = extension.filter.as_deref().unwrap_or("NONE");
        let mode = extension.mode.as_deref();
        let (mode, strides, least_length) = match (mode, filter) {
            (Some("ATTRIBUTES"), filter) => {
                let (filter, strides): (_, &[u64]) = match filter {
                    "NONE" => (Filter::None, &[]),
                    "OCTAHEDRAL" => (Filter::Octahedral, &[4, 8]),
                    "QUATERNION" => (Filter::Quaternion, &[8]),
                    "EXPONENTIAL" => (Filter::Exponential, &[]),
                    "COLOR" => (Filter::Color, &[4, 8]),
                    other => {
                        let expected = "NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR";
                        return Err(malformed(format!("{place}.filter"), expected, other));
                    }
                };
                let bytes = count.saturating_mul(stride);
                (
                    Mode::Attributes(filter),
                    strides,
                    bytes / MOST_BYTES_PER_BYTE,
                )
            }
            (Some("TRIANGLES"), "NONE") if count % 3 == 0 => {
                (Mode::Triangles, &[2, 4][..], (count / 3).saturating_add(17))
            }
            (Some("INDICES"), "NONE") => (Mode::Indices, &[2, 4][..], count.saturating_add(5)),
            (mode, filter) => {
                let expected =
                    "ATTRIBUTES, or without a filter TRIANGLES (a multiple of 3) or INDICES";
                let mode = short(mode.unwrap_or("nothing"));
                let found = format!("{mode} of {count} with filter {}", short(filter));
                return Err(malformed(format!("{place}.mode"), expected, found));
            }
        };
        let fits = match strides {
            [] => (4..=256).contains(&stride) && stride % 4 == 0,
            strides => strides.contains(&stride),
        };
        if !fits {
            let expected = match strides {
                [] => "a multiple of 4 in 4..=256".to_owned(),
                strides => format!("one of {strides:?}"),
            };
            return Err(malformed(format!("{place}.byteStride"), expected, stride));
        }
        if length < least_length {
            let expected = format!("{least_length} at least for {count} elements");
            return Err(malformed(format!("{place}.byteLength"), expected, length));
        }
        let bytes = count.saturating_mul(stride);
        if bytes != view.claimed_bytes() {
            let expected = format!("{count} elements of {stride} bytes, as its extension says");
            let found = view.claimed_bytes();
            return Err(malformed(
                format!("{view_place}.byteLength"),
                expected,
                found,
            ));
        }
        Ok(Self {
            place,
            buffer: Index::value(buffer),
            offset,
            length,
            // In range: the bytes that back them are bounded above.
            count: count as usize,
            stride: stride as usize,
            mode,
        })
    }

    /// Decompresses `source`, the block's bytes.
    pub(super) fn decode(&self, source: &[u8]) -> Read<Vec<u8>> {
        let decoded = match (&self.mode, self.stride) {
            (Mode::Attributes(filter), _) => self.decode_attributes(source, filter),
            (Mode::Triangles, 2) => bytes(meshopt::decode_index_buffer::<u16>(source, self.count)),
            (Mode::Triangles, _) => bytes(meshopt::decode_index_buffer::<u32>(source, self.count)),
            (Mode::Indices, 2) => bytes(meshopt::decode_index_sequence::<u16>(source, self.count)),
            (Mode::Indices, _) => bytes(meshopt::decode_index_sequence::<u32>(source, self.count)),
        };
        decoded.ok_or_else(|| {
            let expected = format!("{} elements of compressed data", self.count);
            malformed(&self.place, expected, "corrupt bytes")
        })
    }

    fn decode_attributes(&self, source: &[u8], filter: &Filter) -> Option<Vec<u8>> {
        // Words, for the alignment that the filters need; strides are multiples of 4.
        let words = self.count * (self.stride / 4);
        let mut decoded = vec![0u32; words];
        // SAFETY: the function writes `count * stride` bytes, which is the length of `decoded`, and reads `source.len()`
        // bytes of `source`; it asks for a stride in 1..=256 that is a multiple of 4, which `parse` has checked. It is
        // made for any bytes: each of its reads is checked against the end that it is given.
        let code = unsafe {
            meshopt::ffi::meshopt_decodeVertexBuffer(
                decoded.as_mut_ptr().cast(),
                self.count,
                self.stride,
                source.as_ptr(),
                source.len(),
            )
        };
        if code != 0 {
            return None;
        }
        match (filter, self.stride) {
            (Filter::None, _) => {}
            (Filter::Octahedral, 4) => {
                meshopt::decode_filter_oct::<i8>(bytemuck::cast_slice_mut(&mut decoded));
            }
            (Filter::Octahedral, _) => {
                meshopt::decode_filter_oct::<i16>(bytemuck::cast_slice_mut(&mut decoded));
            }
            (Filter::Quaternion, _) => {
                meshopt::decode_filter_quat(bytemuck::cast_slice_mut(&mut decoded));
            }
            (Filter::Exponential, _) => {
                meshopt::decode_filter_exp::<1>(bytemuck::cast_slice_mut(&mut decoded));
            }
            (Filter::Color, 4) => {
                meshopt::decode_filter_color::<u8>(bytemuck::cast_slice_mut(&mut decoded));
            }
            (Filter::Color, _) => {
                meshopt::decode_filter_color::<u16>(bytemuck::cast_slice_mut(&mut decoded));
            }
        }
        Some(bytemuck::cast_slice(&decoded).to_vec())
    }
}

fn bytes<T: bytemuck::NoUninit>(decoded: meshopt::Result<Vec<T>>) -> Option<Vec<u8>> {
    decoded.ok().map(|it| bytemuck::cast_slice(&it).to_vec())
}

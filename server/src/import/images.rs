//! Images: the encoded bytes behind textures, each once, measured but not decoded.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{ImageFormat, ImageReader, ImageResult};

use super::Document;
use super::allowance::Allowance;
use super::buffers::{Range, out_of_range};
use super::error::{Read, cannot_read, malformed, quoted};
use super::scene::{Image, MediaType};
use super::uri::{self, Target};
use super::warnings::Warnings;

/// Warning for an image in another file, where the model must hold all.
const OUTSIDE: &str = "images in other files left out (--self-contained)";
/// All images of a model may have the pixels of so many of the largest, or so many for each of
/// their bytes: photographs have four to ten, and a flat picture that is no bomb is small.
const MOST_LARGEST_IMAGES: u64 = 16;
const MOST_PIXELS_PER_BYTE: u64 = 64;

/// The images found so far.
pub(super) struct Images<'a> {
    document: &'a Document<'a>,
    gauge: Gauge<'a>,
    /// By index into the document's images; `None` within for one that is left out.
    found: HashMap<usize, Option<u32>>,
    /// Several images may name the same bytes; those are kept once.
    by_origin: HashMap<Origin, Option<u32>>,
    /// Bytes read from views, which may overlap.
    view_bytes: u64,
    used: Vec<Image>,
}

#[derive(PartialEq, Eq, Hash)]
enum Origin {
    View(Range),
    File(PathBuf),
}

impl<'a> Images<'a> {
    pub(super) fn new(document: &'a Document<'a>, allowance: &'a Allowance<'a>) -> Self {
        Self {
            document,
            gauge: Gauge::new(allowance),
            found: HashMap::new(),
            by_origin: HashMap::new(),
            view_bytes: 0,
            used: Vec::new(),
        }
    }

    /// The place in [`Images::into_used`] of `images[index]`, which `user` names; `None`, with a
    /// warning, where it is left out.
    pub(super) fn find(
        &mut self,
        index: usize,
        user: &str,
        warnings: &mut Warnings,
    ) -> Read<Option<u32>> {
        if let Some(found) = self.found.get(&index) {
            return Ok(*found);
        }
        let number = self.look(index, user, warnings)?;
        self.found.insert(index, number);
        Ok(number)
    }

    fn look(&mut self, index: usize, user: &str, warnings: &mut Warnings) -> Read<Option<u32>> {
        let images = &self.document.root.images;
        let Some(image) = images.get(index) else {
            let user = format!("{user}.source");
            return Err(out_of_range(&user, "images", images.len(), index));
        };
        let place = format!("images[{index}]");
        let allowance = self.gauge.allowance;
        let origin = match (&image.uri, image.buffer_view) {
            (None, Some(view)) => {
                let (buffers, root) = (self.document.buffers, self.document.root);
                Origin::View(buffers.origin(root, view.value(), &place)?)
            }
            (Some(uri), None) if allowance.is_self_contained() && !uri::is_data(uri) => {
                warnings.add(OUTSIDE, 1, &format!("{place} {}", quoted(uri)));
                return Ok(None);
            }
            (Some(uri), None) => match allowance.resolve(uri, &format!("{place}.uri"))? {
                Target::File(path) => Origin::File(path),
                Target::Data(bytes) => {
                    let name = image.name.as_deref().unwrap_or("of a data: URI");
                    let image = self.gauge.measure(bytes, name, &place, warnings)?;
                    return Ok(self.keep(image));
                }
            },
            (uri, _) => {
                let found = if uri.is_some() { "both" } else { "neither" };
                return Err(malformed(place, "either a uri or a bufferView", found));
            }
        };
        if let Some(known) = self.by_origin.get(&origin) {
            return Ok(*known);
        }
        let name = image.uri.as_deref().or(image.name.as_deref());
        let bytes = self.load(&origin, image, &place)?;
        let name = name.unwrap_or("without a name");
        let image = self.gauge.measure(bytes, name, &place, warnings)?;
        let number = self.keep(image);
        self.by_origin.insert(origin, number);
        Ok(number)
    }

    fn load(&mut self, origin: &Origin, image: &gltf::json::Image, place: &str) -> Read<Vec<u8>> {
        if let Origin::File(path) = origin {
            let name = image.uri.as_deref().unwrap_or_default();
            return self.gauge.allowance.read(path, name, place);
        }
        let (buffers, root) = (self.document.buffers, self.document.root);
        let view = image.buffer_view.map_or(usize::MAX, |view| view.value());
        let extent = buffers.view(root, view, place)?.extent;
        // Each range is read once, so that more than all bytes are read only of ranges that
        // overlap.
        self.view_bytes = self.view_bytes.saturating_add(extent.len());
        let most = buffers.held_bytes();
        if self.view_bytes > most {
            let expected = format!("images within {most} bytes of buffers, none over another");
            return Err(malformed(place, expected, self.view_bytes));
        }
        extent.to_vec()
    }

    fn keep(&mut self, image: Option<Image>) -> Option<u32> {
        let number = self.used.len() as u32;
        self.used.push(image?);
        Some(number)
    }

    /// The images that were asked for, in that order.
    pub(super) fn into_used(self) -> Vec<Image> {
        self.used
    }
}

/// Keeps the images of a model within their bounds.
pub(super) struct Gauge<'a> {
    allowance: &'a Allowance<'a>,
    pixels: u64,
    bytes: u64,
}

impl<'a> Gauge<'a> {
    pub(super) fn new(allowance: &'a Allowance<'a>) -> Self {
        Self {
            allowance,
            pixels: 0,
            bytes: 0,
        }
    }

    /// The image in the file `name` beside a mesh file, which `place` names; `None`, with a
    /// warning, where it cannot be had: such names are often stale.
    pub(super) fn beside(
        &mut self,
        name: &str,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<Option<Image>> {
        let allowance = self.allowance;
        if allowance.is_self_contained() {
            warnings.add(OUTSIDE, 1, &format!("{place} {}", quoted(name)));
            return Ok(None);
        }
        let loaded = allowance.file(name, place).and_then(|path| {
            let bytes = allowance.read(&path, name, place)?;
            self.measure(bytes, name, place, warnings)
        });
        match loaded {
            Ok(image) => Ok(image),
            Err(fault) => {
                warnings.add(format!("images left out ({fault})"), 1, place);
                Ok(None)
            }
        }
    }

    /// Tells the format by content and reads the size out of the header; `None`, with a warning,
    /// for another format than PNG and JPEG, and for more pixels than there may be.
    fn measure(
        &mut self,
        bytes: Vec<u8>,
        name: &str,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<Option<Image>> {
        let (media_type, format) = match image::guess_format(&bytes) {
            Ok(ImageFormat::Png) => (MediaType::Png, ImageFormat::Png),
            Ok(ImageFormat::Jpeg) => (MediaType::Jpeg, ImageFormat::Jpeg),
            Ok(other) => {
                let what = format!("images of type {} left out", other.to_mime_type());
                warnings.add(what, 1, place);
                return Ok(None);
            }
            Err(_) => {
                // Named, not quoted: the file may be anything.
                let what = match () {
                    () if bytes.starts_with(b"\xabKTX 20\xbb") => "images of type image/ktx2",
                    () if bytes.starts_with(b"sB") => "images of type Basis",
                    () => "images that are neither PNG nor JPEG",
                };
                warnings.add(format!("{what} left out"), 1, place);
                return Ok(None);
            }
        };
        // The reader refuses the largest without telling their size.
        let size = match png_size(&bytes) {
            Some(size) if pixels(size) > self.allowance.max_image_pixels => size,
            _ => dimensions(format, &bytes).map_err(|error| {
                let expected = format!("a readable {} header", media_type.as_str());
                malformed(place, expected, error)
            })?,
        };
        let (width, height) = size;
        if width == 0 || height == 0 {
            let found = format!("{width} x {height} pixels");
            return Err(malformed(place, "pixels", found));
        }
        let pixels = pixels(size);
        let size = format!(
            "image {} of {width} x {height} pixels left out",
            quoted(name)
        );
        let most = self.allowance.max_image_pixels;
        if pixels > most {
            let what = format!("{size}, above {most} (--max-image-pixels)");
            warnings.add(what, 1, place);
            return Ok(None);
        }
        let all_bytes = self.bytes.saturating_add(bytes.len() as u64);
        let most_of_all = most
            .saturating_mul(MOST_LARGEST_IMAGES)
            .max(all_bytes.saturating_mul(MOST_PIXELS_PER_BYTE));
        if self.pixels.saturating_add(pixels) > most_of_all {
            let times = MOST_LARGEST_IMAGES;
            let what =
                format!("{size}, all above {most_of_all} ({times} times --max-image-pixels)");
            warnings.add(what, 1, place);
            return Ok(None);
        }
        (self.pixels, self.bytes) = (self.pixels + pixels, all_bytes);
        self.allowance.take(bytes.len() as u64, place)?;
        Ok(Some(Image {
            media_type,
            bytes,
            width,
            height,
        }))
    }
}

impl Allowance<'_> {
    /// All of the file at `path`, which the model calls `name`.
    pub(super) fn read(&self, path: &Path, name: &str, place: &str) -> Read<Vec<u8>> {
        let refuse = |cause: std::io::Error| cannot_read(place, Path::new(name), &cause);
        self.fits(path.metadata().map_err(refuse)?.len(), place)?;
        std::fs::read(path).map_err(refuse)
    }
}

fn pixels((width, height): (u32, u32)) -> u64 {
    u64::from(width) * u64::from(height)
}

/// Width and height that the first chunk of a PNG claims.
fn png_size(bytes: &[u8]) -> Option<(u32, u32)> {
    let header = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR")?;
    let (width, rest) = header.split_first_chunk()?;
    let height = rest.first_chunk()?;
    Some((u32::from_be_bytes(*width), u32::from_be_bytes(*height)))
}

/// Width and height out of the header. Neither pixels nor profiles and texts, which may unfold to
/// gigabytes, are looked at.
pub(crate) fn dimensions(format: ImageFormat, bytes: &[u8]) -> ImageResult<(u32, u32)> {
    /// Signature and IHDR with its checksum.
    const PNG_HEADER_BYTES: usize = 33;
    /// A reader goes on to where the pixels begin.
    const PNG_PIXELS: &[u8] = b"\0\0\0\0IDAT";
    let png;
    let header = match (format, bytes.get(..PNG_HEADER_BYTES)) {
        (ImageFormat::Png, Some(header)) => {
            png = [header, PNG_PIXELS].concat();
            &png
        }
        _ => bytes,
    };
    ImageReader::with_format(Cursor::new(header), format).into_dimensions()
}

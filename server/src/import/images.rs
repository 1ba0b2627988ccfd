//! Images: the encoded bytes behind textures, each once, measured but not decoded.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{ImageFormat, ImageReader, ImageResult};

use super::Document;
use super::allowance::Allowance;
use super::buffers::{Range, out_of_range};
use super::decodable;
use super::document::{self, Tolerant};
use super::error::{Read, cannot_read, malformed, quoted, short};
use super::scene::{Image, Material, MediaType};
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
    /// Of the image with this index.
    Inline(usize),
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
    /// warning that names it, where it cannot be had: the surface keeps its shape without.
    pub(super) fn find(
        &mut self,
        index: usize,
        user: &str,
        warnings: &mut Warnings,
    ) -> Option<u32> {
        if let Some(found) = self.found.get(&index) {
            return *found;
        }
        let found = self.look(index, user, warnings);
        let number = found.unwrap_or_else(|fault| {
            let what = format!("image {} left out ({fault})", quoted(&self.name(index)));
            warnings.add(what, 1, user);
            None
        });
        self.found.insert(index, number);
        number
    }

    /// The name of `images[index]` as people know it, short.
    pub(super) fn name(&self, index: usize) -> String {
        let image = self.document.root.images.get(index);
        let image = image.and_then(Tolerant::read);
        let file = image.and_then(|it| it.uri.as_deref());
        let file = file.filter(|uri| !uri::is_data(uri));
        match file.or(image.and_then(|it| it.name.0.as_deref())) {
            Some(name) => short(name),
            None => format!("images[{index}]"),
        }
    }

    fn look(&mut self, index: usize, user: &str, warnings: &mut Warnings) -> Read<Option<u32>> {
        let images = &self.document.root.images;
        let place = format!("images[{index}]");
        let image = match images.get(index).map(|it| &it.0) {
            Some(Ok(image)) => image,
            Some(Err(reason)) => return Err(malformed(place, "an image", reason)),
            None => {
                let user = format!("{user}.source");
                return Err(out_of_range(&user, "images", images.len(), index));
            }
        };
        let allowance = self.gauge.allowance;
        let mut inline = None;
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
                Target::Misspelt(path) => {
                    let what = format!("image {} found by another spelling", quoted(uri));
                    warnings.add(what, 1, &place);
                    Origin::File(path)
                }
                Target::Data(bytes) => {
                    inline = Some(bytes);
                    Origin::Inline(index)
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
        let bytes = match inline {
            Some(bytes) => bytes,
            None => self.load(&origin, image, &place)?,
        };
        let name = self.name(index);
        let image = self.gauge.measure(bytes, &name, &place, warnings)?;
        let number = self.keep(image, name);
        self.by_origin.insert(origin, number);
        Ok(number)
    }

    fn load(&mut self, origin: &Origin, image: &document::Image, place: &str) -> Read<Vec<u8>> {
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

    fn keep(&mut self, image: Option<Image>, name: String) -> Option<u32> {
        let number = self.used.len() as u32;
        self.used.push(image?);
        self.gauge.names.push(name);
        Some(number)
    }

    /// The images that were asked for, in that order, but for those whose pixels cannot be had;
    /// numbers the images of `materials` anew.
    pub(super) fn into_used(
        self,
        materials: &mut [Material],
        warnings: &mut Warnings,
    ) -> Vec<Image> {
        self.gauge.decodable(self.used, materials, warnings)
    }
}

/// Keeps the images of a model within their bounds.
pub(super) struct Gauge<'a> {
    allowance: &'a Allowance<'a>,
    pixels: u64,
    bytes: u64,
    /// Of the images that are kept.
    names: Vec<String>,
}

impl<'a> Gauge<'a> {
    pub(super) fn new(allowance: &'a Allowance<'a>) -> Self {
        Self {
            allowance,
            pixels: 0,
            bytes: 0,
            names: Vec::new(),
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
        let loaded = allowance.beside(name, place).and_then(|path| {
            let bytes = allowance.read(&path, name, place)?;
            self.measure(bytes, name, place, warnings)
        });
        match loaded {
            Ok(image) => {
                self.names.extend(image.is_some().then(|| short(name)));
                Ok(image)
            }
            Err(fault) => {
                warnings.add(format!("images left out ({fault})"), 1, place);
                Ok(None)
            }
        }
    }

    /// All of `images`, which were kept in this order, but for those whose pixels cannot be had;
    /// numbers the images of `materials` anew.
    pub(super) fn decodable(
        &self,
        images: Vec<Image>,
        materials: &mut [Material],
        warnings: &mut Warnings,
    ) -> Vec<Image> {
        let faults = decodable::faults(&images, self.allowance);
        let (mut numbers, mut kept) = (Vec::new(), Vec::new());
        for ((image, name), fault) in images.into_iter().zip(&self.names).zip(faults) {
            numbers.push(fault.is_none().then_some(kept.len() as u32));
            match fault {
                None => kept.push(image),
                Some(reason) => {
                    let what = format!("image {} left out ({reason})", quoted(name));
                    warnings.add(what, 1, "images");
                }
            }
        }
        for material in materials {
            let image = material.base_color_image;
            material.base_color_image = image.and_then(|image| numbers[image as usize]);
        }
        kept
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
            other => {
                // By its type, not by its bytes: the file may be anything.
                let kind = match other {
                    Ok(other) => format!("of type {}", other.to_mime_type()),
                    Err(_) if bytes.starts_with(b"\xabKTX 20\xbb") => {
                        "of type image/ktx2".to_owned()
                    }
                    Err(_) if bytes.starts_with(b"sB") => "of type Basis".to_owned(),
                    Err(_) => "that is neither PNG nor JPEG".to_owned(),
                };
                let what = format!("image {} {kind} left out", quoted(name));
                warnings.add(what, 1, place);
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

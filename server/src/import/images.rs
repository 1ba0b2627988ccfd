//! Images: the encoded bytes behind textures, each once, measured but not decoded.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{ImageFormat, ImageReader};

use super::Document;
use super::buffers::out_of_range;
use super::error::{Read, cannot_read, malformed};
use super::scene::{Image, MediaType};
use super::uri::{self, Target};
use super::warnings::Warnings;

/// The images found so far.
pub(super) struct Images<'a> {
    document: &'a Document<'a>,
    folder: &'a Path,
    /// By index into the document's images; `None` within for one that is left out.
    found: HashMap<usize, Option<u32>>,
    /// Several images may name the same bytes; those are kept once.
    by_origin: HashMap<Origin, Option<u32>>,
    used: Vec<Image>,
}

#[derive(PartialEq, Eq, Hash)]
enum Origin {
    View(usize),
    File(PathBuf),
}

impl<'a> Images<'a> {
    pub(super) fn new(document: &'a Document<'a>, folder: &'a Path) -> Self {
        Self {
            document,
            folder,
            found: HashMap::new(),
            by_origin: HashMap::new(),
            used: Vec::new(),
        }
    }

    /// The place in [`Images::into_used`] of `images[index]`, which `user` names; `None`, with a warning, where its format is
    /// neither PNG nor JPEG.
    pub(super) fn find(
        &mut self,
        index: usize,
        user: &str,
        warnings: &mut Warnings,
    ) -> Read<Option<u32>> {
        if let Some(found) = self.found.get(&index) {
            return Ok(*found);
        }
        let images = &self.document.root.images;
        let Some(image) = images.get(index) else {
            let user = format!("{user}.source");
            return Err(out_of_range(&user, "images", images.len(), index));
        };
        let place = format!("images[{index}]");
        let origin = match (&image.uri, image.buffer_view) {
            (None, Some(view)) => Origin::View(view.value()),
            (Some(uri), None) => match uri::resolve(uri, self.folder, &format!("{place}.uri"))? {
                Target::File(path) => Origin::File(path),
                Target::Data(bytes) => {
                    let number = self.keep(measure(bytes, &place, warnings)?);
                    self.found.insert(index, number);
                    return Ok(number);
                }
            },
            (uri, _) => {
                let found = if uri.is_some() { "both" } else { "neither" };
                return Err(malformed(place, "either a uri or a bufferView", found));
            }
        };
        let number = match self.by_origin.get(&origin) {
            Some(known) => *known,
            None => {
                let bytes = self.load(&origin, &place)?;
                let number = self.keep(measure(bytes, &place, warnings)?);
                self.by_origin.insert(origin, number);
                number
            }
        };
        self.found.insert(index, number);
        Ok(number)
    }

    fn load(&self, origin: &Origin, place: &str) -> Read<Vec<u8>> {
        match origin {
            Origin::File(path) => {
                std::fs::read(path).map_err(|cause| cannot_read(place, path, &cause))
            }
            Origin::View(view) => {
                let buffers = self.document.buffers;
                buffers
                    .view(self.document.root, *view, place)?
                    .extent
                    .to_vec()
            }
        }
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

/// The image in the file `name` beside a mesh file, which `place` names; `None`, with a warning, where it cannot be had: such
/// names are often stale.
pub(super) fn beside(
    name: &str,
    folder: &Path,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Option<Image>> {
    let loaded = uri::file_below(name, folder, place).and_then(|path| {
        let bytes = std::fs::read(&path).map_err(|cause| cannot_read(place, &path, &cause))?;
        measure(bytes, place, warnings)
    });
    match loaded {
        Ok(image) => Ok(image),
        Err(fault) => {
            warnings.add(format!("images left out ({fault})"), 1, place);
            Ok(None)
        }
    }
}

/// Tells the format by content and reads the size out of the header.
fn measure(bytes: Vec<u8>, place: &str, warnings: &mut Warnings) -> Read<Option<Image>> {
    let media_type = match image::guess_format(&bytes) {
        Ok(ImageFormat::Png) => MediaType::Png,
        Ok(ImageFormat::Jpeg) => MediaType::Jpeg,
        Ok(other) => {
            let what = format!("images of type {} left out", other.to_mime_type());
            warnings.add(what, 1, place);
            return Ok(None);
        }
        // KTX2, for one, which the image crate does not know.
        Err(_) => {
            let start = &bytes[..bytes.len().min(8)];
            let what = format!(
                "images that start with \"{}\" left out",
                start.escape_ascii()
            );
            warnings.add(what, 1, place);
            return Ok(None);
        }
    };
    let format = match media_type {
        MediaType::Png => ImageFormat::Png,
        MediaType::Jpeg => ImageFormat::Jpeg,
    };
    let reader = ImageReader::with_format(Cursor::new(&bytes), format);
    let expected = format!("a readable {} header", media_type.as_str());
    let (width, height) = reader
        .into_dimensions()
        .map_err(|error| malformed(place, &expected, error))?;
    if width == 0 || height == 0 {
        let found = format!("{width} x {height} pixels");
        return Err(malformed(place, "pixels", found));
    }
    Ok(Some(Image {
        media_type,
        bytes,
        width,
        height,
    }))
}

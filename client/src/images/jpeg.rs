//! JPEG. One that is too large is decoded at half, a quarter or an eighth of its size, by
//! transforms of fewer coefficients; it is never there at full size.

use std::io::Cursor;

use image::{DynamicImage, ImageFormat, ImageReader};
use jpeg_decoder::{Decoder, PixelFormat};
use lodestream_shaders::cpu::Mips;

use super::check_size;
use super::rows::{Rows, shrunk};

/// Most bytes of the coefficients of a progressive image, which are all there before any of it can
/// be shown.
const COEFFICIENT_BYTES: u64 = 1 << 30;
/// Largest power of two by which transforms reduce.
const MOST_STEP: u32 = 3;

pub(super) fn mips(size: [u32; 2], file: &[u8], dropped: u32) -> Result<Mips, String> {
    let frame = Frame::find(file).ok_or("expected a frame header, found none")?;
    check_size(size, frame.size)?;
    if frame.is_progressive && frame.coefficient_bytes > COEFFICIENT_BYTES {
        let expected = format!("expected at most {COEFFICIENT_BYTES} bytes of coefficients");
        let found = format!("{} in a progressive image", frame.coefficient_bytes);
        return Err(format!("{expected}, found {found}"));
    }
    match dropped {
        0 => whole(size, file),
        _ => reduced(size, file, dropped),
    }
}

fn whole(size: [u32; 2], file: &[u8]) -> Result<Mips, String> {
    let mut reader = ImageReader::with_format(Cursor::new(file), ImageFormat::Jpeg);
    // The layout has room for it: what the file claims is what the scene says.
    reader.no_limits();
    let image = reader.decode().map_err(|error| error.to_string())?;
    check_size(size, [image.width(), image.height()])?;
    let width = size[0] as usize;
    let mut rows = Rows::new(size, 0);
    match image {
        DynamicImage::ImageLuma8(image) => {
            for row in image.chunks_exact(width) {
                rows.push(|rgba| append(rgba, row, PixelFormat::L8));
            }
        }
        image => {
            for row in image.into_rgb8().chunks_exact(3 * width) {
                rows.push(|rgba| append(rgba, row, PixelFormat::RGB24));
            }
        }
    }
    rows.finish()
}

fn reduced(size: [u32; 2], file: &[u8], dropped: u32) -> Result<Mips, String> {
    let wrong = |error: jpeg_decoder::Error| error.to_string();
    let wanted_step = dropped.min(MOST_STEP);
    let mut decoder = Decoder::new(file);
    let [width, height] = size.map(|side| side.div_ceil(1 << wanted_step) as u16);
    decoder.read_info().map_err(wrong)?;
    let info = decoder
        .info()
        .ok_or("expected a frame header, found none")?;
    check_size(size, [info.width, info.height].map(u32::from))?;
    let (width, height) = decoder.scale(width, height).map_err(wrong)?;
    let found = [width, height].map(u32::from);
    // A side of few texels may make the decoder take less than was asked for.
    let step = (0..=wanted_step).find(|step| found == size.map(|side| side.div_ceil(1 << step)));
    let step = step.ok_or_else(|| {
        format!(
            "expected a size of {} x {} to halve, found {found:?}",
            size[0], size[1]
        )
    })?;
    let image = decoder.decode().map_err(wrong)?;
    let mut rows = Rows::new(shrunk(size, step), dropped - step);
    let row_bytes = width as usize * info.pixel_format.pixel_bytes();
    for row in image
        .chunks_exact(row_bytes)
        .take(shrunk(size, step)[1] as usize)
    {
        rows.push(|rgba| append(rgba, row, info.pixel_format));
    }
    rows.finish()
}

fn append(rgba: &mut Vec<u8>, row: &[u8], format: PixelFormat) {
    match format {
        PixelFormat::L8 => rgba.extend(row.iter().flat_map(|&l| [l, l, l, 255])),
        PixelFormat::L16 => rgba.extend(row.chunks_exact(2).flat_map(|l| [l[1], l[1], l[1], 255])),
        PixelFormat::RGB24 => rgba.extend(
            row.chunks_exact(3)
                .flat_map(|at| [at[0], at[1], at[2], 255]),
        ),
        // Inks, as Adobe stores them: 255 is none.
        PixelFormat::CMYK32 => rgba.extend(row.chunks_exact(4).flat_map(|at| {
            let light = |ink: u8| (ink as u32 * at[3] as u32 / 255) as u8;
            [light(at[0]), light(at[1]), light(at[2]), 255]
        })),
    }
}

/// A frame header (ITU T.81, B.2.2).
struct Frame {
    size: [u32; 2],
    is_progressive: bool,
    coefficient_bytes: u64,
}

impl Frame {
    /// The first frame header of a file; `None` where there is none that is sequential or
    /// progressive with Huffman codes.
    fn find(file: &[u8]) -> Option<Self> {
        let mut rest = file.strip_prefix(&[0xff, 0xd8])?;
        loop {
            let start = rest.iter().position(|&byte| byte == 0xff)?;
            let marker = rest[start..].iter().position(|&byte| byte != 0xff)? + start;
            let code = rest[marker];
            rest = &rest[marker + 1..];
            // Zero is a stuffed byte, the others stand alone.
            if matches!(code, 0x00 | 0x01 | 0xd0..=0xd8) {
                continue;
            }
            let bytes = u16::from_be_bytes([*rest.first()?, *rest.get(1)?]) as usize;
            let segment = rest.get(2..bytes)?;
            match code {
                0xc0..=0xc2 => return Self::parse(segment, code == 0xc2),
                // Scans before a frame, and frames that nobody decodes.
                0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf | 0xd9 | 0xda => return None,
                _ => rest = &rest[bytes..],
            }
        }
    }

    fn parse(segment: &[u8], is_progressive: bool) -> Option<Self> {
        let (header, components) = segment.split_at_checked(6)?;
        let height = u16::from_be_bytes([header[1], header[2]]) as u32;
        let width = u16::from_be_bytes([header[3], header[4]]) as u32;
        let samplings = components
            .chunks_exact(3)
            .map(|component| [component[1] >> 4, component[1] & 15].map(u64::from));
        let most = |axis: usize| samplings.clone().map(|sampling| sampling[axis]).max();
        let most = [most(0)?.max(1), most(1)?.max(1)];
        let units = [width, height].map(u64::from);
        let blocks = samplings.map(|sampling| {
            let side = |axis: usize| units[axis].div_ceil(8 * most[axis]) * sampling[axis];
            side(0) * side(1)
        });
        Some(Self {
            size: [width, height],
            is_progressive,
            coefficient_bytes: 128 * blocks.sum::<u64>(),
        })
    }
}

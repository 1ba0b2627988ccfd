//! Images that claim more than they hold, or hold more than fits: the memory that decoding takes,
//! and the picture that comes of it.
#![cfg(feature = "gpu")]
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

#[path = "hostile_common/counting.rs"]
mod counting;

use std::io::Cursor;

use counting::{Counting, Measure};
use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
use lodestream_client::gpu::{Gpu, TextureUpload};
use lodestream_client::images::{admitted, mips};
use lodestream_format::ContentHash;
use lodestream_format::scene::{MediaType, Texture};
use lodestream_shaders::cpu::mip_chain;
use png::{BitDepth, ColorType};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const MIB: usize = 1 << 20;

fn texture(media_type: MediaType, width: u32, height: u32) -> Texture {
    Texture {
        object: ContentHash::of(b"image"),
        bytes: 1000,
        media_type,
        width,
        height,
    }
}

fn png_texture(width: u32, height: u32) -> Texture {
    texture(MediaType::Png, width, height)
}

/// A chunk of a PNG.
fn chunk(name: &[u8; 4], bytes: &[u8]) -> Vec<u8> {
    let mut crc = !0u32;
    for byte in name.iter().chain(bytes) {
        crc ^= *byte as u32;
        for _ in 0..8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 };
        }
    }
    let length = (bytes.len() as u32).to_be_bytes();
    [&length[..], name, bytes, &(!crc).to_be_bytes()].concat()
}

/// A PNG of RGB bytes whose filtered rows are `raw`, stored without compression.
fn rgb_png(width: u32, height: u32, is_interlaced: bool, raw: &[u8]) -> Vec<u8> {
    let mut zlib = vec![0x78, 1];
    let blocks = raw.chunks(65_535).count();
    for (index, block) in raw.chunks(65_535).enumerate() {
        let length = block.len() as u16;
        zlib.push((index + 1 == blocks) as u8);
        zlib.extend(length.to_le_bytes());
        zlib.extend((!length).to_le_bytes());
        zlib.extend(block);
    }
    let (a, b) = raw.iter().fold((1u32, 0u32), |(a, b), &byte| {
        let a = (a + byte as u32) % 65_521;
        (a, (a + b) % 65_521)
    });
    zlib.extend((b << 16 | a).to_be_bytes());
    let mut header = [width.to_be_bytes(), height.to_be_bytes()].concat();
    header.extend([8, 2, 0, 0, is_interlaced as u8]);
    let chunks = [
        chunk(b"IHDR", &header),
        chunk(b"IDAT", &zlib),
        chunk(b"IEND", &[]),
    ];
    [&b"\x89PNG\r\n\x1a\n"[..], &chunks.concat()].concat()
}

fn noise(index: u32) -> u8 {
    (index.wrapping_mul(0x9e37_79b1) >> 13) as u8
}

/// Four colours in columns of 64 texels; a quarter of the light of each is the mean.
const STRIPES: [[u8; 3]; 4] = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]];

fn striped_png(side: u32) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, side, side);
    encoder.set_color(ColorType::Indexed);
    encoder.set_depth(BitDepth::Two);
    encoder.set_palette(STRIPES.concat());
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().unwrap();
    let mut rows = writer.stream_writer().unwrap();
    // Four texels a byte.
    let row: Vec<u8> = (0..side / 4)
        .map(|byte| [0x00, 0x55, 0xaa, 0xff][(byte / 16 % 4) as usize])
        .collect();
    for _ in 0..side {
        std::io::Write::write_all(&mut rows, &row).unwrap();
    }
    rows.finish().unwrap();
    writer.finish().unwrap();
    file
}

#[test]
fn an_image_of_16384_texels_a_side_shows_its_colours_in_little_memory() {
    let side = 16_384;
    let file = striped_png(side);
    let texture = png_texture(side, side);
    assert_eq!(admitted([&texture].into_iter(), 1 << 30), [Ok(())]);
    let measure = Measure::new();
    // 4,096 texels a side: 85 MiB with all mips, where the image has a gigabyte.
    let words = mips(&texture, &file, 2).unwrap().words;
    let peak = measure.peak_bytes();
    assert!(peak < 192 * MIB, "{peak} bytes");
    let [r, g, b, a] = words[words.len() - 1].to_le_bytes();
    // Half the light of each channel is 188 in sRGB.
    assert!(
        r.abs_diff(188) <= 1 && g.abs_diff(188) <= 1 && b.abs_diff(188) <= 1,
        "{r} {g} {b}"
    );
    assert_eq!(a, 255);
    for (stripe, color) in STRIPES.iter().enumerate() {
        let texel = words[4096 * 1000 + 16 * stripe + 8].to_le_bytes();
        assert_eq!(texel[..3], color[..], "stripe {stripe}");
    }
}

#[test]
fn claims_are_looked_at_before_anything_is_decoded() {
    let measure = Measure::new();
    let bomb = rgb_png(60_000, 60_000, false, &[]);
    let refused = |texture: &Texture| {
        admitted([texture].into_iter(), 1 << 30)[0]
            .clone()
            .unwrap_err()
    };
    let error = refused(&png_texture(60_000, 60_000));
    assert_eq!(
        error,
        "expected at most 1073741824 texels, found 60000 x 60000"
    );
    for (width, height) in [
        (0, 1),
        (1, 0),
        (65_536, 1),
        (1, u32::MAX),
        (u32::MAX, u32::MAX),
    ] {
        let error = refused(&png_texture(width, height));
        assert!(
            error.starts_with("expected sides of 1 to 65535 texels, found"),
            "{error}"
        );
    }
    // The scene says less than the file, by PNG and by JPEG.
    let error = mips(&png_texture(8, 8), &bomb, 0).unwrap_err();
    assert_eq!(error, "expected 8 x 8 texels, found 60000 x 60000");
    let jpeg = jpeg_header(0xc0, 60_000, 60_000);
    let error = mips(&texture(MediaType::Jpeg, 8, 8), &jpeg, 0).unwrap_err();
    assert_eq!(error, "expected 8 x 8 texels, found 60000 x 60000");
    // An image that claims what may be, and holds nothing.
    for is_interlaced in [false, true] {
        let empty = rgb_png(32_768, 32_768, is_interlaced, &[]);
        assert!(mips(&png_texture(32_768, 32_768), &empty, 4).is_err());
    }
    let peak = measure.peak_bytes();
    assert!(peak < 96 * MIB, "{peak} bytes");
}

/// Start, one frame header of three components, the end.
fn jpeg_header(code: u8, width: u16, height: u16) -> Vec<u8> {
    let mut file = vec![0xff, 0xd8, 0xff, code, 0, 17, 8];
    file.extend(height.to_be_bytes());
    file.extend(width.to_be_bytes());
    file.extend([3, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0, 0xff, 0xd9]);
    file
}

#[test]
fn a_progressive_image_is_refused_where_its_coefficients_do_not_fit() {
    let file = jpeg_header(0xc2, 16_384, 16_384);
    let error = mips(&texture(MediaType::Jpeg, 16_384, 16_384), &file, 2).unwrap_err();
    let expected = "expected at most 1073741824 bytes of coefficients, found 1610612736";
    assert!(error.starts_with(expected), "{error}");
}

#[test]
fn texts_and_profiles_are_passed_over() {
    let text = "\0".repeat(64 * MIB).replace('\0', "x");
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 1, 1);
    encoder
        .add_ztxt_chunk("bomb".to_owned(), text.clone())
        .unwrap();
    encoder.add_itxt_chunk("bomb".to_owned(), text).unwrap();
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&[7]).unwrap();
    writer.finish().unwrap();
    let measure = Measure::new();
    let words = mips(&png_texture(1, 1), &file, 0).unwrap().words;
    assert_eq!(words, [0xff07_0707]);
    let peak = measure.peak_bytes();
    assert!(peak < 4 * MIB, "{peak} bytes");
}

/// Every kind of PNG gives the bytes that the `image` crate gives.
#[test]
fn every_kind_of_png_is_read() {
    let (width, height) = (37u32, 23u32);
    for (color, depth) in [
        (ColorType::Grayscale, BitDepth::One),
        (ColorType::Grayscale, BitDepth::Eight),
        (ColorType::Grayscale, BitDepth::Sixteen),
        (ColorType::GrayscaleAlpha, BitDepth::Eight),
        (ColorType::GrayscaleAlpha, BitDepth::Sixteen),
        (ColorType::Rgb, BitDepth::Eight),
        (ColorType::Rgb, BitDepth::Sixteen),
        (ColorType::Rgba, BitDepth::Eight),
        (ColorType::Rgba, BitDepth::Sixteen),
        (ColorType::Indexed, BitDepth::Four),
    ] {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == ColorType::Indexed {
            encoder.set_palette((0..48).map(noise).collect::<Vec<_>>());
            encoder.set_trns((0..9).map(noise).collect::<Vec<_>>());
        }
        let row_bits = width as usize * color.samples() * depth as usize;
        let bytes = row_bits.div_ceil(8) * height as usize;
        let data: Vec<u8> = (0..bytes as u32).map(noise).collect();
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&data).unwrap();
        writer.finish().unwrap();
        let expected = image::load_from_memory(&file).unwrap().into_rgba8();
        for dropped in 0..6 {
            let words = mips(&png_texture(width, height), &file, dropped)
                .unwrap()
                .words;
            let expected = mip_chain([width, height], &expected, dropped).words;
            assert!(words == expected, "{color:?} {depth:?} from mip {dropped}");
        }
    }
}

#[test]
fn an_interlaced_image_is_read_whole_or_thinned_out() {
    for (width, height) in [(1u32, 1u32), (5, 3), (33, 18), (64, 64), (3, 40)] {
        let texel = |x: u32, y: u32| [0, 1, 2].map(|channel| noise(3 * (y * width + x) + channel));
        let passes: [[usize; 4]; 7] = [
            [0, 0, 8, 8],
            [4, 0, 8, 8],
            [0, 4, 4, 8],
            [2, 0, 4, 4],
            [0, 2, 2, 4],
            [1, 0, 2, 2],
            [0, 1, 1, 2],
        ];
        let mut raw = Vec::new();
        for [left, top, across, down] in passes {
            let left = left as u32;
            for y in (top as u32..height).step_by(down).filter(|_| left < width) {
                raw.push(0);
                raw.extend((left..width).step_by(across).flat_map(|x| texel(x, y)));
            }
        }
        let file = rgb_png(width, height, true, &raw);
        let mips_there = 32 - width.max(height).leading_zeros();
        for dropped in 0..mips_there {
            let step = dropped.min(3);
            let thin = [width, height].map(|side| (side >> step).max(1));
            let rgba: Vec<u8> = (0..thin[1])
                .flat_map(|y| (0..thin[0]).map(move |x| (x << step, y << step)))
                .flat_map(|(x, y)| {
                    let [r, g, b] = texel(x, y);
                    [r, g, b, 255]
                })
                .collect();
            let words = mips(&png_texture(width, height), &file, dropped)
                .unwrap()
                .words;
            let expected = mip_chain(thin, &rgba, dropped - step).words;
            assert!(words == expected, "{width} x {height} from mip {dropped}");
        }
    }
}

#[test]
fn a_jpeg_is_reduced_while_it_is_decoded() {
    for (width, height) in [(4096u32, 4096u32), (1001, 777)] {
        let picture = RgbImage::from_fn(width, height, |x, y| {
            Rgb([(x * 255 / width) as u8, (y * 255 / height) as u8, 90])
        });
        let mut file = Cursor::new(Vec::new());
        let picture = DynamicImage::ImageRgb8(picture);
        picture.write_to(&mut file, ImageFormat::Jpeg).unwrap();
        let texture = texture(MediaType::Jpeg, width, height);
        let whole = mips(&texture, file.get_ref(), 0).unwrap().words;
        for dropped in 1..6 {
            let measure = Measure::new();
            let words = mips(&texture, file.get_ref(), dropped).unwrap().words;
            let peak = measure.peak_bytes();
            let same = &whole[whole.len() - words.len()..];
            for (at, (found, expected)) in words.iter().zip(same).enumerate() {
                let far = found.to_le_bytes().into_iter().zip(expected.to_le_bytes());
                let far = far.map(|(a, b)| a.abs_diff(b)).max().unwrap();
                assert!(
                    far <= 6,
                    "{width} x {height}, mip {dropped}, word {at}: {far}"
                );
            }
            if width == 4096 && dropped >= 3 {
                // Whole it has 48 MiB, and its mips as much again.
                assert!(peak < 24 * MIB, "mip {dropped}: {peak} bytes");
            }
        }
    }
}

/// Each fits alone; together they are shown coarser, and said so by name. Those that do not decode
/// are white.
#[test]
fn all_textures_together_keep_to_their_memory() {
    let gpu = Gpu::noop();
    let mut textures: Vec<Texture> = (0..100).map(|_| png_texture(4096, 4096)).collect();
    textures.push(png_texture(60_000, 60_000));
    let admitted_of = |textures: &[Texture]| admitted(textures.iter(), 1 << 30);
    let admitted = admitted_of(&textures);
    let mut upload = TextureUpload::new(&gpu, &textures, &admitted, &[], 64 << 20).unwrap();
    upload.put(0, &rgb_png(4096, 4096, false, &[])).unwrap();
    let size_px = [16, 16];
    let arrays = std::sync::Arc::default();
    let mut renderer =
        lodestream_client::gpu::Renderer::new(&gpu, arrays, 1 << 15, size_px).unwrap();
    let layout = upload.finish(&mut renderer).unwrap();
    assert!(layout.words * 4 <= 64 << 20, "{} words", layout.words);
    assert!(layout.words * 4 > 16 << 20, "{} words", layout.words);
    let object = ContentHash::of(b"image");
    let notes = layout.notes.join("\n");
    for index in 0..100 {
        let coarser = format!("texture {index} ({object}): shown at ");
        assert!(notes.contains(&coarser), "{coarser} in {notes}");
    }
    for (index, reason) in [(100, "expected at most 1073741824 texels"), (0, "")] {
        let white = format!("texture {index} ({object}): shown white: {reason}");
        assert!(notes.contains(&white), "{white} in {notes}");
    }
    assert_eq!(
        (layout.records[100].width, layout.records[100].height),
        (1, 1)
    );

    // No time is told: laid out one by one against each other they would take hours.
    let many: Vec<Texture> = (0..200_000).map(|_| png_texture(60, 60)).collect();
    TextureUpload::new(&gpu, &many, &admitted_of(&many), &[], 64 << 20).unwrap();
}

#[test]
fn files_and_texels_of_a_scene_have_a_sum() {
    let mut textures: Vec<Texture> = (0..5).map(|_| png_texture(32_768, 32_768)).collect();
    let admitted_texels = admitted(textures.iter(), 1 << 30);
    assert_eq!(admitted_texels.iter().filter(|it| it.is_ok()).count(), 4);
    for texture in &mut textures {
        (texture.width, texture.bytes) = (1, u64::MAX / 2);
    }
    let error = admitted(textures.iter(), 1 << 30)[0].clone().unwrap_err();
    let expected = "expected at most 1073741824 bytes of image files (--open-memory), found more";
    assert_eq!(error, expected);
}

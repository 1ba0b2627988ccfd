//! Images: sizes that headers claim, bytes that many images share, profiles that unfold.

use std::io::Cursor;

use super::{glb, import, import_within, list};
use lodestream_server::import::OpenOptions;

/// A PNG that claims this size, with `chunks` before its pixels.
fn png(width: u32, height: u32, chunks: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [
        &width.to_be_bytes()[..],
        &height.to_be_bytes(),
        &[8, 2, 0, 0, 0],
    ]
    .concat();
    bytes.extend(chunk(b"IHDR", &header));
    bytes.extend(chunks);
    bytes.extend(chunk(b"IDAT", &pixels(width, height)));
    bytes.extend(chunk(b"IEND", &[]));
    bytes
}

/// Black pixels, stored; of a large picture none.
fn pixels(width: u32, height: u32) -> Vec<u8> {
    const MOST_BYTES: u64 = 1 << 15;
    let bytes = u64::from(height) * (1 + 3 * u64::from(width));
    if bytes > MOST_BYTES {
        return vec![0x78, 0x9c, 3, 0, 0, 0, 0, 1];
    }
    let length = (bytes as u16).to_le_bytes();
    let inverse = (!(bytes as u16)).to_le_bytes();
    let zeros = vec![0; bytes as usize];
    // Adler's sum of zeros: their number, and 1.
    let sum = [&(bytes as u16).to_be_bytes()[..], &[0, 1]].concat();
    [&[0x78, 1, 1][..], &length, &inverse, &zeros, &sum].concat()
}

fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let checked = [kind, data].concat();
    // The checksum of the format, bit by bit.
    let mut sum = u32::MAX;
    for &byte in &checked {
        sum ^= u32::from(byte);
        for _ in 0..8 {
            sum = sum >> 1 ^ if sum & 1 == 1 { 0xedb8_8320 } else { 0 };
        }
    }
    let length = data.len() as u32;
    [&length.to_be_bytes()[..], &checked, &(!sum).to_be_bytes()].concat()
}

/// A JPEG of two pixels whose header then claims this size.
fn jpeg(width: u16, height: u16) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let picture = image::DynamicImage::new_rgb8(2, 1);
    picture
        .write_to(&mut bytes, image::ImageFormat::Jpeg)
        .expect("encodes");
    let mut bytes = bytes.into_inner();
    let frame = bytes
        .windows(2)
        .position(|it| it == [0xff, 0xc0])
        .expect("a frame");
    bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
    bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
    bytes
}

/// A triangle whose materials show the images, which are at these ranges of `bin`.
fn model(ranges: &[(usize, usize)], bin: &[u8]) -> Vec<u8> {
    let corners: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let corners: Vec<u8> = corners.iter().flat_map(|it| it.to_le_bytes()).collect();
    let views: Vec<String> = ranges
        .iter()
        .map(|(start, length)| {
            format!(
                r#"{{"buffer":0,"byteOffset":{},"byteLength":{length}}}"#,
                start + 36
            )
        })
        .collect();
    let images: Vec<String> = (1..=ranges.len())
        .map(|view| {
            format!(r#"{{"name":"roof{view}","bufferView":{view},"mimeType":"image/png"}}"#)
        })
        .collect();
    let material =
        r#"{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1],"baseColorTexture":{"index":#}}}"#;
    let json = format!(
        r##"{{"asset":{{"version":"2.0"}},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,
        "TEXCOORD_0":1}},"material":0}}]}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,
        "type":"VEC3"}},{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{}],"buffers":[{{"byteLength":{}}}],
        "images":[{}],"textures":[{}],"materials":[{}]}}"##,
        views.join(","),
        bin.len() + 36,
        images.join(","),
        list(ranges.len(), r#"{"source":#}"#),
        list(ranges.len(), material),
    );
    glb(&json, &[&corners, bin].concat())
}

fn of_images(images: &[Vec<u8>]) -> Vec<u8> {
    let mut bin = Vec::new();
    let mut ranges = Vec::new();
    for image in images {
        ranges.push((bin.len(), image.len()));
        bin.extend(image);
    }
    model(&ranges, &bin)
}

#[test]
fn images_above_the_bound_are_left_out_by_name() {
    for (image, size) in [
        (png(60_000, 60_000, &[]), "60000 x 60000"),
        (png(16_385, 16_384, &[]), "16385 x 16384"),
        (png(1 << 30, 1 << 30, &[]), "1073741824 x 1073741824"),
        (jpeg(65_000, 65_000), "65000 x 65000"),
    ] {
        let file = of_images(&[png(2, 2, &[]), image]);
        let outcome = import("glb", &file, &OpenOptions::default());
        let scene = outcome.scene.expect("is read");
        assert_eq!(scene.images.len(), 1, "{size}");
        assert_eq!(scene.materials[0].base_color_image, Some(0));
        assert_eq!(scene.materials[1].base_color_image, None);
        assert_eq!(scene.materials[1].base_color_factor, [1.0, 0.0, 0.0, 1.0]);
        let warnings = scene.warnings.concat();
        let told = format!(
            "image \"roof2\" of {size} pixels left out, above 268435456 (--max-image-pixels)"
        );
        assert!(warnings.contains(&told), "{warnings}");
    }
}

#[test]
fn the_bound_is_an_option() {
    for (most, kept) in [(1 << 28, 2), ((1 << 28) - 1, 1), (4, 1), (3, 0)] {
        let options = OpenOptions {
            max_image_pixels: most,
            ..OpenOptions::default()
        };
        let file = of_images(&[png(2, 2, &[]), png(16_384, 16_384, &[])]);
        let scene = import("glb", &file, &options).scene.expect("is read");
        assert_eq!(scene.images.len(), kept, "{most}");
    }
}

/// Many images below the bound take as much as one above it.
#[test]
fn all_images_together_have_a_bound() {
    // Different bytes, so that each counts.
    let images: Vec<Vec<u8>> = (0..40).map(|at| png(16_384, 16_384 - at, &[])).collect();
    let scene = import("glb", &of_images(&images), &OpenOptions::default());
    let scene = scene.scene.expect("is read");
    assert_eq!(scene.images.len(), 16);
    let warnings = scene.warnings.concat();
    assert!(
        warnings.contains("16 times --max-image-pixels"),
        "{warnings}"
    );
}

/// Views of one range, and views that each begin a byte later, would copy it again and again.
#[test]
fn images_that_share_bytes_are_read_once() {
    let mut image = png(4, 4, &[]);
    image.resize(1 << 20, 0);
    let same = vec![(0, image.len()); 1000];
    let outcome = import_within("one range", "glb", &model(&same, &image));
    assert_eq!(outcome.scene.expect("is read").images.len(), 1);
    let shorter: Vec<(usize, usize)> = (0..1000).map(|at| (0, image.len() - at)).collect();
    let outcome = import_within("overlapping ranges", "glb", &model(&shorter, &image));
    let scene = outcome.scene.expect("is read");
    assert_eq!(scene.images.len(), 1);
    let warnings = scene.warnings.concat();
    assert!(warnings.contains("none over another"), "{warnings}");
}

/// A colour profile of a gigabyte of zeros is a megabyte.
#[test]
fn profiles_are_not_unfolded() {
    // Stored twice: deflate of zeros, by zlib's own coder in the image crate, then wrapped as a
    // profile.
    let plain = image::RgbImage::new(8192, 4096);
    let mut encoded = Cursor::new(Vec::new());
    plain
        .write_to(&mut encoded, image::ImageFormat::Png)
        .expect("encodes");
    let encoded = encoded.into_inner();
    let mut zlib = Vec::new();
    let mut at = 8;
    while at + 8 <= encoded.len() {
        let length = u32::from_be_bytes([
            encoded[at],
            encoded[at + 1],
            encoded[at + 2],
            encoded[at + 3],
        ]);
        let data = at + 8..at + 8 + length as usize;
        if &encoded[at + 4..at + 8] == b"IDAT" {
            zlib.extend(&encoded[data.clone()]);
        }
        at = data.end + 4;
    }
    let profile = chunk(b"iCCP", &[&b"p\0\0"[..], &zlib].concat());
    let file = of_images(&[png(4, 4, &profile)]);
    let outcome = import_within("a profile", "glb", &file);
    assert_eq!(outcome.scene.expect("is read").images.len(), 1);
    let most = 4 * file.len() + (1 << 20);
    assert!(outcome_is_small(&file, most));
}

fn outcome_is_small(file: &[u8], most_bytes: usize) -> bool {
    import("glb", file, &OpenOptions::default()).peak_bytes < most_bytes
}

#[test]
fn indexed_images_are_measured() {
    // A palette comes after the header, which alone is read.
    let mut image = png(5, 3, &chunk(b"PLTE", &[0; 6]));
    let header = [
        &5u32.to_be_bytes()[..],
        &3u32.to_be_bytes(),
        &[8, 3, 0, 0, 0],
    ]
    .concat();
    image.splice(8..33, chunk(b"IHDR", &header));
    let scene = import("glb", &of_images(&[image]), &OpenOptions::default())
        .scene
        .expect("is read");
    assert_eq!((scene.images[0].width, scene.images[0].height), (5, 3));
}

/// The case that is shared: 209 bytes that claim 60,000 x 60,000.
#[test]
fn the_shared_case_is_left_out() {
    let case = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/cases/bomb60k.png.gltf"
    );
    let Ok(scene) = lodestream_server::import::import(case.as_ref()) else {
        assert!(!std::path::Path::new(case).exists(), "{case} is refused");
        println!("SKIPPED: {case} is absent");
        return;
    };
    assert!(scene.images.is_empty());
    assert_eq!(scene.source_triangles, 2);
    let warnings = scene.warnings.concat();
    assert!(
        warnings.contains("\"bomb60k.png\" of 60000 x 60000"),
        "{warnings}"
    );
}

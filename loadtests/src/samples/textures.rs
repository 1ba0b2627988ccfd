//! Small tiling textures, drawn in code and packed as PNG.

use glam::DVec3;

use super::noise::fractal;
use super::number::{Random, lerp, smoothstep};

/// Pixels along an edge. A power of two, so that every texture repeats without a seam.
const SIZE_PX: usize = 256;

/// Running-bond brickwork: 8 courses of 4 bricks.
pub(super) fn bricks() -> Vec<u8> {
    let mut random = Random::new(0xb41c, 0);
    let tints: Vec<f64> = (0..32).map(|_| random.between(0.72, 1.12)).collect();
    draw(|u, v| {
        let course = (v * 8.0).floor();
        let along = u * 4.0 + if course as usize % 2 == 1 { 0.5 } else { 0.0 };
        let brick = along.floor();
        let edge = |t: f64, width: f64| smoothstep(0.0, width, t.min(1.0 - t));
        let inside = edge(along - brick, 0.05).min(edge(v * 8.0 - course, 0.12));
        let tint =
            tints[course as usize * 4 + brick as usize % 4] * (1.0 + 0.14 * grain(u, v, 48.0, 3));
        let clay = [0.66 * tint, 0.36 * tint, 0.27 * tint];
        let mortar = 0.68 + 0.10 * grain(u, v, 64.0, 4);
        std::array::from_fn(|channel| lerp(mortar, clay[channel], inside))
    })
}

/// Weathered plaster or cast stone, near white so that the vertex colour tints it.
pub(super) fn stone() -> Vec<u8> {
    draw(|u, v| {
        let stain = 0.05 * grain(u, v, 4.0, 5) + 0.05 * grain(u, v, 32.0, 6);
        [0.93 + stain, 0.92 + stain, 0.90 + stain]
    })
}

/// Asphalt: dark with light grit.
pub(super) fn asphalt() -> Vec<u8> {
    draw(|u, v| {
        let grit = smoothstep(0.35, 0.7, grain(u, v, 96.0, 7));
        let shade = 0.80 + 0.07 * grain(u, v, 8.0, 8) + 0.20 * grit;
        [shade, shade, shade * 1.01]
    })
}

/// Square paving slabs, 4 by 4.
pub(super) fn paving() -> Vec<u8> {
    let mut random = Random::new(0x9a7e, 0);
    let tints: Vec<f64> = (0..16).map(|_| random.between(0.80, 0.96)).collect();
    draw(|u, v| {
        let (x, y) = ((u * 4.0).floor(), (v * 4.0).floor());
        let joint = |t: f64| smoothstep(0.0, 0.035, t.min(1.0 - t));
        let inside = joint(u * 4.0 - x).min(joint(v * 4.0 - y));
        let shade = tints[y as usize * 4 + x as usize] + 0.05 * grain(u, v, 48.0, 9);
        let shade = lerp(0.45, shade, inside);
        [shade, shade * 0.985, shade * 0.95]
    })
}

/// Short grass, near white-green so that the vertex colour tints it.
pub(super) fn grass() -> Vec<u8> {
    draw(|u, v| {
        let blade = 0.16 * grain(u, v, 80.0, 10) + 0.10 * grain(u, v, 6.0, 11);
        [0.82 + blade * 1.2, 0.90 + blade, 0.70 + blade * 0.8]
    })
}

/// Fractal noise that repeats once over the texture, in about `[-1, 1]`.
fn grain(u: f64, v: f64, cells: f64, seed: u32) -> f64 {
    // Four shifted copies, blended by distance to the border: the usual way to make any noise tile.
    let at = |x: f64, y: f64| fractal(DVec3::new(x * cells, y * cells, 0.5), seed, 3);
    let along = |y: f64| lerp(at(u, y), at(u - 1.0, y), u);
    // Blending averages four values and flattens them; the factor restores the spread.
    lerp(along(v), along(v - 1.0), v) * 1.6
}

fn draw(colour: impl Fn(f64, f64) -> [f64; 3]) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(SIZE_PX * SIZE_PX * 3);
    for row in 0..SIZE_PX {
        for column in 0..SIZE_PX {
            let centre = |pixel: usize| (pixel as f64 + 0.5) / SIZE_PX as f64;
            let rgb = colour(centre(column), centre(row));
            pixels.extend(rgb.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    encode(&pixels)
}

/// PNG with stored blocks: no compressor, so that the bytes do not change with a library's version.
fn encode(pixels: &[u8]) -> Vec<u8> {
    let mut raw = Vec::with_capacity(pixels.len() + SIZE_PX);
    for row in pixels.chunks(SIZE_PX * 3) {
        raw.push(0);
        raw.extend_from_slice(row);
    }
    let mut zlib = vec![0x78, 0x01];
    let blocks = raw.chunks(0xffff);
    let last = blocks.len() - 1;
    for (index, block) in blocks.enumerate() {
        let length = block.len() as u16;
        zlib.push(u8::from(index == last));
        zlib.extend_from_slice(&length.to_le_bytes());
        zlib.extend_from_slice(&(!length).to_le_bytes());
        zlib.extend_from_slice(block);
    }
    zlib.extend_from_slice(&adler32(&raw).to_be_bytes());

    let mut header = Vec::new();
    header.extend_from_slice(&(SIZE_PX as u32).to_be_bytes());
    header.extend_from_slice(&(SIZE_PX as u32).to_be_bytes());
    // 8 bits, RGB, deflate, adaptive filters, not interlaced.
    header.extend_from_slice(&[8, 2, 0, 0, 0]);
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, body) in [(b"IHDR", &header), (b"IDAT", &zlib), (b"IEND", &Vec::new())] {
        png.extend_from_slice(&(body.len() as u32).to_be_bytes());
        let start = png.len();
        png.extend_from_slice(kind);
        png.extend_from_slice(body);
        let sum = crc32(&png[start..]);
        png.extend_from_slice(&sum.to_be_bytes());
    }
    png
}

fn adler32(bytes: &[u8]) -> u32 {
    let (a, b) = bytes.iter().fold((1u32, 0u32), |(a, b), &byte| {
        let a = (a + u32::from(byte)) % 65521;
        (a, (b + a) % 65521)
    });
    b << 16 | a
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| {
            if c & 1 == 1 {
                c >> 1 ^ 0xedb8_8320
            } else {
                c >> 1
            }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_match_the_published_check_values() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        assert_eq!(adler32(b"Wikipedia"), 0x11e6_0398);
    }

    #[test]
    fn grain_repeats_at_the_border() {
        for step in 0..50 {
            let t = f64::from(step) / 50.0;
            assert!((grain(0.0, t, 16.0, 3) - grain(1.0, t, 16.0, 3)).abs() < 1e-9);
            assert!((grain(t, 0.0, 16.0, 3) - grain(t, 1.0, 16.0, 3)).abs() < 1e-9);
        }
    }
}

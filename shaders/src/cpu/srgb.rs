//! sRGB (IEC 61966-2-1) to linear light and back, and packing. Twin of `wgsl/shared/srgb.wgsl`.

use glam::Vec3;
use std::sync::LazyLock;

/// Linear light of an sRGB value, both 0..=1.
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// sRGB value of linear light, both 0..=1.
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.0031308 {
        linear * 12.92
    } else {
        1.055 * linear.max(0.0031308).powf(1.0 / 2.4) - 0.055
    }
}

/// Linear light of an sRGB byte.
pub fn linear_from_byte(byte: u8) -> f32 {
    static TABLE: LazyLock<[f32; 256]> =
        LazyLock::new(|| std::array::from_fn(|byte| linear_from_srgb(byte as f32 / 255.0)));
    TABLE[byte as usize]
}

/// The nearest byte to a value of 0..=1; beyond it the ends, 0 for what is not a number.
pub fn byte_from_unit(value: f32) -> u8 {
    // The cast makes 0 of a NaN, which `clamp` keeps.
    (value.clamp(0.0, 1.0) * 255.0 + 0.5).floor() as u8
}

/// Opaque RGBA8 of sRGB values.
pub fn pack_color(encoded: Vec3) -> u32 {
    let [red, green, blue] = encoded.to_array().map(byte_from_unit);
    u32::from_le_bytes([red, green, blue, 255])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_linear_light() {
        for byte in 0..=255 {
            assert_eq!(
                byte_from_unit(srgb_from_linear(linear_from_byte(byte))),
                byte
            );
        }
    }

    #[test]
    fn curve_is_monotone_and_meets_the_standard() {
        assert!((0..255).all(|byte| linear_from_byte(byte) < linear_from_byte(byte + 1)));
        assert!((linear_from_byte(128) - 0.215_860_5).abs() < 1e-6);
        assert!((srgb_from_linear(0.5) - 0.735_356_9).abs() < 1e-6);
    }

    #[test]
    fn no_number_packs_to_black() {
        assert_eq!(
            pack_color(Vec3::new(f32::NAN, f32::INFINITY, -1.0)),
            0xff00_ff00
        );
    }
}

//! The fixed light of every picture. Twin of `wgsl/shared/light.wgsl`, which tells about the numbers.

use glam::{Vec3, Vec4};

const KEY_DIRECTION: Vec3 = Vec3::new(-0.2996255, 0.6991261, 0.6491886);
const FILL_DIRECTION: Vec3 = Vec3::new(0.9206016, 0.2166121, -0.3249182);
const KEY_RADIANCE: Vec3 = Vec3::new(0.74, 0.71, 0.66);
const FILL_RADIANCE: Vec3 = Vec3::new(0.10, 0.12, 0.15);
const SKY_RADIANCE: Vec3 = Vec3::new(0.27, 0.30, 0.35);
const GROUND_RADIANCE: Vec3 = Vec3::new(0.15, 0.135, 0.12);
const METAL_DIFFUSE: f32 = 0.35;
const SMALLEST_ROUGHNESS: f32 = 0.15;
const LARGEST_SPECULAR: f32 = 1.5;
/// sRGB colour of the sky at the top of the picture.
pub const SKY_TOP_SRGB: Vec3 = Vec3::new(0.36, 0.43, 0.52);
/// sRGB colour of the sky at the bottom of the picture.
pub const SKY_BOTTOM_SRGB: Vec3 = Vec3::new(0.74, 0.76, 0.78);

/// WGSL's `mix`.
pub fn mix(a: Vec3, b: Vec3, share: f32) -> Vec3 {
    a * (1.0 - share) + b * share
}

fn hemisphere(direction: Vec3) -> Vec3 {
    mix(GROUND_RADIANCE, SKY_RADIANCE, direction.y * 0.5 + 0.5)
}

/// Linear radiance towards the eye. `normal` and `to_eye` are unit vectors in world space.
pub fn light_surface(
    base_color: Vec3,
    metallic: f32,
    roughness: f32,
    normal: Vec3,
    to_eye: Vec3,
) -> Vec3 {
    let to_key = normal.dot(KEY_DIRECTION).max(0.0);
    let to_fill = ((normal.dot(FILL_DIRECTION) + 0.5) / 1.5).max(0.0);
    let diffuse = base_color * (1.0 - (1.0 - METAL_DIFFUSE) * metallic);
    let light = hemisphere(normal) + KEY_RADIANCE * to_key + FILL_RADIANCE * to_fill;
    let at_normal = mix(Vec3::splat(0.04), base_color, metallic);
    let toward_eye = normal.dot(to_eye).max(1e-3);
    let rough = roughness.max(SMALLEST_ROUGHNESS);
    diffuse * light
        + key_specular(at_normal, rough, normal, to_eye, to_key, toward_eye)
        + hemisphere_specular(at_normal, rough, normal, to_eye, toward_eye)
}

fn key_specular(
    at_normal: Vec3,
    roughness: f32,
    normal: Vec3,
    to_eye: Vec3,
    to_key: f32,
    toward_eye: f32,
) -> Vec3 {
    let half_vector = safe_normalize(KEY_DIRECTION + to_eye, normal);
    let alpha = roughness * roughness;
    let along = normal.dot(half_vector).max(0.0);
    let spread = along * along * (alpha * alpha - 1.0) + 1.0;
    let facets = alpha * alpha / (spread * spread);
    let k = alpha * 0.5;
    let visibility = 0.25 / ((to_key * (1.0 - k) + k) * (toward_eye * (1.0 - k) + k));
    let rest = 1.0 - to_eye.dot(half_vector).max(0.0);
    let squared = rest * rest;
    let fresnel = at_normal + (1.0 - at_normal) * (squared * squared * rest);
    (fresnel * (facets * visibility * to_key)).min(Vec3::splat(LARGEST_SPECULAR)) * KEY_RADIANCE
}

fn hemisphere_specular(
    at_normal: Vec3,
    roughness: f32,
    normal: Vec3,
    to_eye: Vec3,
    toward_eye: f32,
) -> Vec3 {
    let fit =
        Vec4::new(1.0, 0.0425, 1.04, -0.04) + roughness * Vec4::new(-1.0, -0.0275, -0.572, 0.022);
    let grazing = (fit.x * fit.x).min((-9.28 * toward_eye).exp2()) * fit.x + fit.y;
    let scale = -1.04 * grazing + fit.z;
    let bias = 1.04 * grazing + fit.w;
    let mirrored = 2.0 * normal.dot(to_eye) * normal - to_eye;
    hemisphere(mirrored) * (at_normal * scale + bias.max(0.0))
}

/// Identity up to 0.75, then bends towards 1 without a kink.
pub fn tone(radiance: Vec3) -> Vec3 {
    let over = (radiance - 0.75).max(Vec3::ZERO);
    radiance.min(Vec3::splat(0.75)) + over / (1.0 + over * 4.0)
}

/// A unit vector, or `otherwise` where `value` has no direction.
pub fn safe_normalize(value: Vec3, otherwise: Vec3) -> Vec3 {
    let largest = value.x.abs().max(value.y.abs().max(value.z.abs()));
    if largest > 1e-37 && largest < 1e38 {
        let scaled = value / largest;
        scaled / scaled.dot(scaled).sqrt()
    } else {
        otherwise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_unit_vectors_and_tone_is_monotone_below_one() {
        assert!(KEY_DIRECTION.is_normalized() && FILL_DIRECTION.is_normalized());
        let toned: Vec<_> = (0..400)
            .map(|step| tone(Vec3::splat(step as f32 * 0.01)).x)
            .collect();
        assert!(toned.windows(2).all(|pair| pair[0] < pair[1]) && toned[399] < 1.0);
        assert_eq!(toned[50], 0.5);
    }

    /// A white furnace of a kind: no matt surface sends out more than the light that all sources together bring.
    #[test]
    fn matt_surfaces_stay_below_their_light_and_keep_their_hue() {
        let base = Vec3::new(0.8, 0.4, 0.2);
        for step in 0..64 {
            let angle = step as f32 * 0.4;
            let normal = Vec3::new(angle.cos(), (angle * 0.37).sin(), angle.sin()).normalize();
            let lit = light_surface(base, 0.0, 1.0, normal, normal);
            assert!(
                lit.cmpgt(Vec3::ZERO).all() && lit.cmplt(Vec3::splat(1.3)).all(),
                "{lit}"
            );
            assert!(lit.x > lit.y && lit.y > lit.z, "{lit}");
        }
    }

    #[test]
    fn numbers_are_those_of_the_wgsl() {
        use crate::passes::{PoolBindings, SHADE};
        use naga::{Expression, Literal};
        let source = SHADE.source(PoolBindings {
            count: 1,
            words_log2: 25,
        });
        let module = naga::front::wgsl::parse_str(&source).expect("the module parses");
        let numbers = |name: &str| -> Vec<f32> {
            let found = module
                .constants
                .iter()
                .find(|(_, constant)| constant.name.as_deref() == Some(name));
            let init = found.expect("the constant is there").1.init;
            let number = |handle| match module.global_expressions[handle] {
                Expression::Literal(Literal::F32(value)) => value,
                ref other => panic!("{name}: {other:?}"),
            };
            match &module.global_expressions[init] {
                Expression::Compose { components, .. } => {
                    components.iter().map(|&handle| number(handle)).collect()
                }
                _ => vec![number(init)],
            }
        };
        for (name, value) in [
            ("KEY_DIRECTION", KEY_DIRECTION),
            ("FILL_DIRECTION", FILL_DIRECTION),
            ("KEY_RADIANCE", KEY_RADIANCE),
            ("FILL_RADIANCE", FILL_RADIANCE),
            ("SKY_RADIANCE", SKY_RADIANCE),
            ("GROUND_RADIANCE", GROUND_RADIANCE),
            ("SKY_TOP_SRGB", SKY_TOP_SRGB),
            ("SKY_BOTTOM_SRGB", SKY_BOTTOM_SRGB),
        ] {
            assert_eq!(numbers(name), value.to_array(), "{name}");
        }
        for (name, value) in [
            ("METAL_DIFFUSE", METAL_DIFFUSE),
            ("SMALLEST_ROUGHNESS", SMALLEST_ROUGHNESS),
            ("LARGEST_SPECULAR", LARGEST_SPECULAR),
        ] {
            assert_eq!(numbers(name), [value], "{name}");
        }
    }

    #[test]
    fn directions_survive_any_length() {
        for length in [1e-36, 1e-20, 1.0, 1e20, 1e37] {
            let unit = safe_normalize(Vec3::new(3.0, 0.0, -4.0) * length, Vec3::X);
            assert!(
                (unit - Vec3::new(0.6, 0.0, -0.8)).length() < 1e-6,
                "{length}"
            );
        }
        assert_eq!(safe_normalize(Vec3::ZERO, Vec3::X), Vec3::X);
        assert_eq!(safe_normalize(Vec3::splat(f32::NAN), Vec3::X), Vec3::X);
    }
}

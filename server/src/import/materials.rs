//! Materials: the metallic-roughness model with its base-colour texture.

use super::Document;
use super::allowance::Allowance;
use super::document::{
    Extensions, Material as Source, SpecularGlossiness, TextureInfo, TextureTransform, Tolerant,
    Whole,
};
use super::error::{quoted, short};
use super::features;
use super::images::Images;
use super::scene::{AlphaMode, Image, Material, SamplerWrap, short_name};
use super::warnings::Warnings;

/// Every material of the document, the default one after them where asked, and the images that they use.
pub(super) fn read(
    document: &Document,
    allowance: &Allowance,
    with_default: bool,
    warnings: &mut Warnings,
) -> (Vec<Material>, Vec<Image>) {
    let mut images = Images::new(document, allowance);
    let mut materials = Vec::with_capacity(document.root.materials.len() + 1);
    for (at, source) in document.root.materials.iter().enumerate() {
        let place = format!("materials[{at}]");
        let source = match &source.0 {
            Ok(source) => source,
            Err(reason) => {
                let what = format!("materials left out, the default shown ({reason})");
                warnings.add(what, 1, &place);
                materials.push(Material::default());
                continue;
            }
        };
        note_other_textures(source, &place, warnings);
        let mut material = read_factors(source, &place, warnings);
        if let Some((texture, name)) = base_texture(source) {
            let place = format!("{place}.{name}");
            read_texture(
                document,
                texture,
                &place,
                &mut material,
                &mut images,
                warnings,
            );
        }
        materials.push(material);
    }
    if with_default {
        materials.push(Material::default());
    }
    let images = images.into_used(&mut materials, warnings);
    (materials, images)
}

fn extensions(source: &Source) -> Option<&Extensions> {
    source.extensions.as_deref()
}

/// The specular-glossiness model where the material has it: its authors prefer that one.
fn specular_glossiness(source: &Source) -> Option<&SpecularGlossiness> {
    extensions(source)?.specular_glossiness.as_deref()
}

/// The share of light that the specular factor leaves to the diffuse colour.
fn unmirrored(model: &SpecularGlossiness) -> f64 {
    let specular = model.specular_factor.unwrap_or([1.0; 3]);
    1.0 - specular.into_iter().fold(0.0, f64::max).min(1.0)
}

/// The texture that becomes the base colour's, and its place in the material.
fn base_texture(source: &Source) -> Option<(&TextureInfo, &'static str)> {
    if let Some(model) = specular_glossiness(source) {
        let place = "extensions.KHR_materials_pbrSpecularGlossiness.diffuseTexture";
        // All light is mirrored where the specular colour is 1, so that no texel is seen.
        let is_mirror = model.specular_glossiness_texture.is_none() && unmirrored(model) == 0.0;
        let texture = model.diffuse_texture.as_ref().filter(|_| !is_mirror);
        return Some((texture?, place));
    }
    let texture = source.surface.base_color_texture.as_ref();
    Some((texture?, "pbrMetallicRoughness.baseColorTexture"))
}

fn texture_transform(info: &TextureInfo) -> Option<&TextureTransform> {
    info.extensions.as_ref()?.texture_transform.as_deref()
}

/// The set `N` of `TEXCOORD_N` that the base colour's texture uses; `None` without a texture.
pub(super) fn textured_uv_set(source: &Tolerant<Source>) -> Option<usize> {
    let (info, _) = base_texture(source.read()?)?;
    let chosen = texture_transform(info).and_then(|it| it.uv_set);
    Some(chosen.or(info.uv_set).unwrap_or_default().value())
}

/// The same, 0 without a texture.
pub(super) fn uv_set(source: &Tolerant<Source>) -> usize {
    textured_uv_set(source).unwrap_or(0)
}

fn note_other_textures(source: &Source, place: &str, warnings: &mut Warnings) {
    let model = specular_glossiness(source);
    let textures = [
        (
            "metallicRoughnessTexture",
            source.surface.metallic_roughness_texture.is_some(),
        ),
        ("normalTexture", source.normal_texture.is_some()),
        ("occlusionTexture", source.occlusion_texture.is_some()),
        ("emissiveTexture", source.emissive_texture.is_some()),
        (
            "specularGlossinessTexture",
            model.is_some_and(|it| it.specular_glossiness_texture.is_some()),
        ),
    ];
    for (name, present) in textures {
        let what = format!("{name} left out, with the factors that it scales");
        warnings.add(what, u64::from(present), place);
    }
    let what = format!(
        "{} approximated as metallic-roughness",
        features::SPECULAR_GLOSSINESS
    );
    warnings.add(what, u64::from(model.is_some()), place);
    for name in extensions(source).iter().flat_map(|it| &it.others) {
        features::note(name, place, warnings);
    }
}

/// Factors of the metallic-roughness model.
struct Factors {
    base_color: [f64; 4],
    metallic: f64,
    roughness: f64,
}

fn factors(source: &Source) -> Factors {
    let surface = &source.surface;
    let Some(model) = specular_glossiness(source) else {
        return Factors {
            base_color: surface.base_color_factor.unwrap_or([1.0; 4]),
            // The factor multiplies a texture that is left out; taken alone, its default of 1 would make everything metal.
            metallic: match surface.metallic_roughness_texture {
                Some(_) => 0.0,
                None => surface.metallic_factor.unwrap_or(1.0),
            },
            roughness: surface.roughness_factor.unwrap_or(1.0),
        };
    };
    let diffuse = model.diffuse_factor.unwrap_or([1.0; 4]);
    let specular = model.specular_factor.unwrap_or([1.0; 3]);
    let glossiness = model.glossiness_factor.unwrap_or(1.0);
    let (base_color, metallic) = match model.specular_glossiness_texture {
        // Each texel says whether it is metal; the surface is taken as none.
        Some(_) => (diffuse, 0.0),
        None => convert_specular(diffuse, specular),
    };
    Factors {
        base_color,
        metallic,
        roughness: match model.specular_glossiness_texture {
            // The factor multiplies a texture that is left out; its default of 1 would be a mirror.
            Some(_) => 1.0 - 0.5 * glossiness,
            None => 1.0 - glossiness,
        },
    }
}

/// Base colour and metalness of a diffuse and a specular colour, as the extension's own converter has it (KhronosGroup/glTF,
/// `extensions/2.0/Archived/KHR_materials_pbrSpecularGlossiness/examples/convert-between-workflows`).
fn convert_specular(diffuse: [f64; 4], specular: [f64; 3]) -> ([f64; 4], f64) {
    /// Reflectance of a surface that is no metal.
    const DIELECTRIC: f64 = 0.04;
    let brightness = |[r, g, b]: [f64; 3]| (0.299 * r * r + 0.587 * g * g + 0.114 * b * b).sqrt();
    let [r, g, b, alpha] = diffuse;
    let (dark, bright) = (brightness([r, g, b]), brightness(specular));
    let rest = 1.0 - specular.into_iter().fold(0.0, f64::max);
    let metallic = match bright < DIELECTRIC {
        true => 0.0,
        false => {
            let b = dark * rest / (1.0 - DIELECTRIC) + bright - 2.0 * DIELECTRIC;
            let c = DIELECTRIC - bright;
            let root = (b * b - 4.0 * DIELECTRIC * c).max(0.0).sqrt();
            ((root - b) / (2.0 * DIELECTRIC)).clamp(0.0, 1.0)
        }
    };
    let blend = |diffuse: f64, specular: f64| {
        let of_diffuse = diffuse * rest / (1.0 - DIELECTRIC) / (1.0 - metallic).max(1e-6);
        let of_specular = (specular - DIELECTRIC * (1.0 - metallic)) / metallic.max(1e-6);
        let share = metallic * metallic;
        (of_diffuse * (1.0 - share) + of_specular * share).clamp(0.0, 1.0)
    };
    let [s_r, s_g, s_b] = specular;
    (
        [blend(r, s_r), blend(g, s_g), blend(b, s_b), alpha],
        metallic,
    )
}

fn read_factors(source: &Source, place: &str, warnings: &mut Warnings) -> Material {
    let strength = extensions(source).and_then(|it| it.emissive_strength.as_ref());
    let strength = strength.and_then(|it| it.strength).unwrap_or(1.0);
    let cutoff = source.alpha_cutoff.unwrap_or(0.5);
    let factors = factors(source);
    let mut clamped = false;
    let mut within = |it: f64, most: f64| {
        clamped |= !(0.0..=most).contains(&it);
        it.clamp(0.0, most) as f32
    };
    let alpha_mode = match source.alpha_mode.as_deref() {
        None | Some("OPAQUE") => AlphaMode::Opaque,
        // A cutoff above 1 is allowed: nothing is seen.
        Some("MASK") => AlphaMode::Mask(within(cutoff, MOST_FACTOR)),
        Some("BLEND") => {
            warnings.add("alphaMode BLEND approximated", 1, place);
            AlphaMode::Blend
        }
        Some(other) => {
            let what = format!("alphaMode {} read as OPAQUE", quoted(other));
            warnings.add(what, 1, place);
            AlphaMode::Opaque
        }
    };
    let material = Material {
        name: short_name(source.name.0.as_deref().unwrap_or_default()),
        base_color_factor: factors.base_color.map(|it| within(it, 1.0)),
        alpha_mode,
        double_sided: source.double_sided,
        unlit: extensions(source).is_some_and(|it| it.unlit.is_some()),
        // Under a texture that is left out the factor alone would light the whole surface.
        emissive_factor: match source.emissive_texture {
            Some(_) => [0.0; 3],
            None => source
                .emissive_factor
                .map(|it| within(it * strength, MOST_FACTOR)),
        },
        metallic: within(factors.metallic, 1.0),
        roughness: within(factors.roughness, 1.0),
        ..Material::default()
    };
    let what = "materials with factors clamped to what they may be";
    warnings.add(what, u64::from(clamped), place);
    material
}

/// Most of a factor that may exceed 1: far from the end of f32.
const MOST_FACTOR: f64 = 1e30;

fn read_texture(
    document: &Document,
    info: &TextureInfo,
    place: &str,
    material: &mut Material,
    images: &mut Images,
    warnings: &mut Warnings,
) {
    let root = document.root;
    let index = info.index.map(|index| index.value());
    let texture = index.and_then(|index| root.textures.get(index));
    let Some((texture, index)) = texture.and_then(Tolerant::read).zip(index) else {
        let what = "textures left out that are not among the document's";
        warnings.add(what, 1, place);
        return;
    };
    let texture_place = format!("textures[{index}]");
    let Some(source) = texture.source else {
        note_other_source(
            texture.extensions.as_deref(),
            images,
            &texture_place,
            warnings,
        );
        return;
    };
    material.base_color_image = images.find(source.value(), &texture_place, warnings);
    if material.base_color_image.is_none() {
        return;
    }
    material.uv_transform = texture_transform(info).and_then(|it| {
        let rows = rows(it);
        let what = "texture transforms that are not finite left out";
        warnings.add(what, u64::from(rows.is_none()), place);
        rows
    });
    let Some(sampler) = texture.sampler else {
        return;
    };
    let sampler = root.samplers.get(sampler.value());
    let Some(sampler) = sampler.and_then(Tolerant::read) else {
        let what = "samplers left out that are not among the document's";
        warnings.add(what, 1, &texture_place);
        return;
    };
    let mut note = |name: &str, number: u64| {
        let what = format!("{name} of samplers left out that glTF does not have");
        warnings.add(what, 1, &format!("{texture_place}, {number}"));
    };
    let mut wrap = |mode: Option<Whole>, name: &str| match mode.map(|it| it.0) {
        None | Some(10_497) => SamplerWrap::Repeat,
        Some(33_071) => SamplerWrap::Clamp,
        Some(33_648) => SamplerWrap::Mirror,
        Some(other) => {
            note(name, other);
            SamplerWrap::Repeat
        }
    };
    material.wrap_u = wrap(sampler.wrap_s, "wrapS");
    material.wrap_v = wrap(sampler.wrap_t, "wrapT");
    material.nearest = match sampler.mag_filter.map(|it| it.0) {
        None | Some(9_729) => false,
        Some(9_728) => true,
        Some(other) => {
            note("magFilter", other);
            false
        }
    };
}

/// Names the image of a texture that has one by an extension alone.
fn note_other_source(
    extensions: Option<&Extensions>,
    images: &Images,
    place: &str,
    warnings: &mut Warnings,
) {
    let sources = extensions.map(|it| {
        [
            ("EXT_texture_avif", &it.avif),
            ("EXT_texture_webp", &it.webp),
            ("KHR_texture_basisu", &it.basisu),
            ("MSFT_texture_dds", &it.dds),
        ]
    });
    let mut sources = sources.into_iter().flatten();
    let known = sources.find_map(|(name, source)| Some((name, source.as_ref()?.source?)));
    let other = extensions.and_then(|it| it.others.first());
    let what = match (known, other) {
        (Some((name, source)), _) => {
            let image = quoted(&images.name(source.value()));
            format!("image {image} left out, which needs {name}")
        }
        (None, Some(other)) => format!("textures left out that need {}", short(other)),
        (None, None) => "textures without an image left out".to_owned(),
    };
    warnings.add(what, 1, place);
}

/// Offset after rotation after scale. The rotation is counter-clockwise as seen, and `v` points down: the sign of the
/// extension's prose and example. Its GLSL listing turns the other way (KhronosGroup/glTF issue 1563).
/// `None` where they are not finite.
fn rows(transform: &TextureTransform) -> Option<[f32; 6]> {
    let [scale_u, scale_v] = transform.scale.unwrap_or([1.0; 2]);
    let [offset_u, offset_v] = transform.offset;
    let (sin, cos) = transform.rotation.sin_cos();
    let rows = [
        cos * scale_u,
        sin * scale_v,
        offset_u,
        -sin * scale_u,
        cos * scale_v,
        offset_v,
    ]
    .map(|it| it as f32);
    rows.iter().all(|it| it.is_finite()).then_some(rows)
}

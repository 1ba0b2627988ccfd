//! Materials: the metallic-roughness model with its base-colour texture.

use gltf::json::extensions::material::PbrSpecularGlossiness;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::AlphaMode as JsonAlphaMode;
use gltf::json::texture::{Info, MagFilter, WrappingMode};
use gltf::json::validation::Checked;

use super::Document;
use super::allowance::Allowance;
use super::buffers::out_of_range;
use super::error::{Read, malformed, short};
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
) -> Read<(Vec<Material>, Vec<Image>)> {
    let mut images = Images::new(document, allowance);
    let mut materials = Vec::with_capacity(document.root.materials.len() + 1);
    for (at, source) in document.root.materials.iter().enumerate() {
        let place = format!("materials[{at}]");
        note_other_textures(source, &place, warnings);
        let mut material = read_factors(source, &place, warnings)?;
        if let Some((texture, name)) = base_texture(source) {
            let place = format!("{place}.{name}");
            read_texture(
                document,
                texture,
                &place,
                &mut material,
                &mut images,
                warnings,
            )?;
        }
        materials.push(material);
    }
    if with_default {
        materials.push(Material::default());
    }
    Ok((materials, images.into_used()))
}

/// The specular-glossiness model where the material has it: its authors prefer that one.
fn specular_glossiness(source: &gltf::json::Material) -> Option<&PbrSpecularGlossiness> {
    source.extensions.as_ref()?.pbr_specular_glossiness.as_ref()
}

/// The texture that becomes the base colour's, and its place in the material.
fn base_texture(source: &gltf::json::Material) -> Option<(&Info, &'static str)> {
    if let Some(model) = specular_glossiness(source) {
        let place = "extensions.KHR_materials_pbrSpecularGlossiness.diffuseTexture";
        return Some((model.diffuse_texture.as_ref()?, place));
    }
    let texture = source.pbr_metallic_roughness.base_color_texture.as_ref();
    Some((texture?, "pbrMetallicRoughness.baseColorTexture"))
}

/// The set `N` of `TEXCOORD_N` that the base colour's texture uses; `None` without a texture.
pub(super) fn textured_uv_set(source: &gltf::json::Material) -> Option<u32> {
    let (info, _) = base_texture(source)?;
    let transform = info
        .extensions
        .as_ref()
        .and_then(|it| it.texture_transform.as_ref());
    let chosen = transform.and_then(|it| it.tex_coord);
    Some(chosen.unwrap_or(info.tex_coord))
}

/// The same, 0 without a texture.
pub(super) fn uv_set(source: &gltf::json::Material) -> u32 {
    textured_uv_set(source).unwrap_or(0)
}

fn note_other_textures(source: &gltf::json::Material, place: &str, warnings: &mut Warnings) {
    let pbr = &source.pbr_metallic_roughness;
    let textures = [
        (
            "metallicRoughnessTexture",
            pbr.metallic_roughness_texture.is_some(),
        ),
        ("normalTexture", source.normal_texture.is_some()),
        ("occlusionTexture", source.occlusion_texture.is_some()),
        ("emissiveTexture", source.emissive_texture.is_some()),
        (
            "specularGlossinessTexture",
            specular_glossiness(source).is_some_and(|it| it.specular_glossiness_texture.is_some()),
        ),
    ];
    for (name, present) in textures {
        warnings.add(format!("{name} left out"), u64::from(present), place);
    }
    let extensions = source.extensions.iter().flat_map(|it| it.others.keys());
    for name in extensions.filter(|name| features::LOOKS.contains(&name.as_str())) {
        warnings.add(format!("{name} left out"), 1, place);
    }
}

/// Factors of the metallic-roughness model.
struct Factors {
    base_color: [f32; 4],
    metallic: f32,
    roughness: f32,
}

fn factors(source: &gltf::json::Material) -> Factors {
    let pbr = &source.pbr_metallic_roughness;
    let Some(model) = specular_glossiness(source) else {
        return Factors {
            base_color: pbr.base_color_factor.0,
            // The factor multiplies a texture that is left out; taken alone, its default of 1 would make everything metal.
            metallic: match pbr.metallic_roughness_texture {
                Some(_) => 0.0,
                None => pbr.metallic_factor.0,
            },
            roughness: pbr.roughness_factor.0,
        };
    };
    let diffuse = model.diffuse_factor.0;
    let roughness = 1.0 - model.glossiness_factor.0;
    let textured = model.diffuse_texture.is_some() || model.specular_glossiness_texture.is_some();
    let (base_color, metallic) = match textured {
        // What is metal is for each texel to say; the surface is taken as none.
        true => (diffuse, 0.0),
        false => convert_specular(diffuse, model.specular_factor.0),
    };
    Factors {
        base_color,
        metallic,
        roughness,
    }
}

/// Base colour and metalness of a diffuse and a specular colour, as the extension's own converter has it (KhronosGroup/glTF,
/// `extensions/2.0/Archived/KHR_materials_pbrSpecularGlossiness/examples/convert-between-workflows`).
fn convert_specular(diffuse: [f32; 4], specular: [f32; 3]) -> ([f32; 4], f32) {
    /// Reflectance of a surface that is no metal.
    const DIELECTRIC: f32 = 0.04;
    let brightness = |[r, g, b]: [f32; 3]| (0.299 * r * r + 0.587 * g * g + 0.114 * b * b).sqrt();
    let [r, g, b, alpha] = diffuse;
    let (dark, bright) = (brightness([r, g, b]), brightness(specular));
    let rest = 1.0 - specular.into_iter().fold(0.0, f32::max);
    let metallic = match bright < DIELECTRIC {
        true => 0.0,
        false => {
            let b = dark * rest / (1.0 - DIELECTRIC) + bright - 2.0 * DIELECTRIC;
            let c = DIELECTRIC - bright;
            let root = (b * b - 4.0 * DIELECTRIC * c).max(0.0).sqrt();
            ((root - b) / (2.0 * DIELECTRIC)).clamp(0.0, 1.0)
        }
    };
    let blend = |diffuse: f32, specular: f32| {
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

fn read_factors(
    source: &gltf::json::Material,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Material> {
    let extensions = source.extensions.as_ref();
    let strength = extensions
        .and_then(|it| it.emissive_strength.as_ref())
        .map_or(1.0, |it| it.emissive_strength.0);
    let cutoff = source.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
    let emissive_factor = source.emissive_factor.0.map(|it| it * strength);
    let factors = factors(source);
    let mut numbers = [factors.metallic, factors.roughness, cutoff].to_vec();
    numbers.extend(factors.base_color);
    numbers.extend(emissive_factor);
    if !numbers.iter().all(|it| it.is_finite()) {
        return Err(malformed(
            place,
            "factors within f32",
            format!("{numbers:?}"),
        ));
    }
    let mut clamped = false;
    let mut unit = |it: f32| {
        clamped |= !(0.0..=1.0).contains(&it);
        it.clamp(0.0, 1.0)
    };
    let material = Material {
        name: short_name(source.name.as_deref().unwrap_or_default()),
        base_color_factor: factors.base_color.map(&mut unit),
        alpha_mode: match source.alpha_mode {
            Checked::Valid(JsonAlphaMode::Opaque) => AlphaMode::Opaque,
            // A cutoff above 1 is allowed: nothing is seen.
            Checked::Valid(JsonAlphaMode::Mask) => AlphaMode::Mask(cutoff.max(0.0)),
            Checked::Valid(JsonAlphaMode::Blend) => AlphaMode::Blend,
            Checked::Invalid => {
                let place = format!("{place}.alphaMode");
                return Err(malformed(place, "OPAQUE, MASK or BLEND", "another"));
            }
        },
        double_sided: source.double_sided,
        unlit: extensions.is_some_and(|it| it.unlit.is_some()),
        // Under a texture that is left out the factor alone would light the whole surface.
        emissive_factor: match source.emissive_texture {
            Some(_) => [0.0; 3],
            None => emissive_factor.map(|it| it.max(0.0)),
        },
        metallic: unit(factors.metallic),
        roughness: unit(factors.roughness),
        ..Material::default()
    };
    warnings.add(
        "materials with factors clamped to 0..1",
        u64::from(clamped),
        place,
    );
    Ok(material)
}

fn read_texture(
    document: &Document,
    info: &Info,
    place: &str,
    material: &mut Material,
    images: &mut Images,
    warnings: &mut Warnings,
) -> Read<()> {
    let root = document.root;
    let index = info.index.value();
    let Some(texture) = root.textures.get(index) else {
        let place = format!("{place}.index");
        return Err(out_of_range(&place, "textures", root.textures.len(), index));
    };
    let transform = info
        .extensions
        .as_ref()
        .and_then(|it| it.texture_transform.as_ref());
    let place = format!("textures[{index}]");
    // The crate's mark for a texture without a source: an extension holds it.
    if texture.source.value() == u32::MAX as usize {
        let others = texture.extensions.as_ref().map(|it| &it.others);
        let mut names = others.into_iter().flat_map(|it| it.keys());
        let what = match names.next() {
            None => "textures without an image left out".to_owned(),
            Some(name) => format!("textures that need {} left out", short(name)),
        };
        warnings.add(what, 1, &place);
        return Ok(());
    }
    material.base_color_image = images.find(texture.source.value(), &place, warnings)?;
    if material.base_color_image.is_none() {
        return Ok(());
    }
    material.uv_transform = transform.map(|it| read_transform(it, &place)).transpose()?;
    let Some(sampler) = texture.sampler else {
        return Ok(());
    };
    let Some(sampler) = root.samplers.get(sampler.value()) else {
        let place = format!("{place}.sampler");
        return Err(out_of_range(
            &place,
            "samplers",
            root.samplers.len(),
            sampler.value(),
        ));
    };
    let wrap = |mode, name: &str| match mode {
        Checked::Valid(WrappingMode::Repeat) => Ok(SamplerWrap::Repeat),
        Checked::Valid(WrappingMode::ClampToEdge) => Ok(SamplerWrap::Clamp),
        Checked::Valid(WrappingMode::MirroredRepeat) => Ok(SamplerWrap::Mirror),
        Checked::Invalid => {
            let place = format!("{place}.sampler.{name}");
            Err(malformed(place, "10497, 33071 or 33648", "another number"))
        }
    };
    material.wrap_u = wrap(sampler.wrap_s, "wrapS")?;
    material.wrap_v = wrap(sampler.wrap_t, "wrapT")?;
    material.nearest = match sampler.mag_filter {
        None | Some(Checked::Valid(MagFilter::Linear)) => false,
        Some(Checked::Valid(MagFilter::Nearest)) => true,
        Some(Checked::Invalid) => {
            let place = format!("{place}.sampler.magFilter");
            return Err(malformed(place, "9728 or 9729", "another number"));
        }
    };
    Ok(())
}

/// Offset after rotation after scale. The rotation is counter-clockwise as seen, and `v` points down: the sign of the
/// extension's prose and example. Its GLSL listing turns the other way (KhronosGroup/glTF issue 1563).
fn read_transform(transform: &TextureTransform, place: &str) -> Read<[f32; 6]> {
    let [scale_u, scale_v] = transform.scale.0.map(f64::from);
    let [offset_u, offset_v] = transform.offset.0.map(f64::from);
    let (sin, cos) = f64::from(transform.rotation.0).sin_cos();
    let rows = [
        cos * scale_u,
        sin * scale_v,
        offset_u,
        -sin * scale_u,
        cos * scale_v,
        offset_v,
    ]
    .map(|it| it as f32);
    match rows.iter().all(|it| it.is_finite()) {
        true => Ok(rows),
        false => {
            let place = format!("{place} under KHR_texture_transform");
            Err(malformed(place, "finite numbers", format!("{rows:?}")))
        }
    }
}

//! Materials: the metallic-roughness model with its base-colour texture.

use std::path::Path;

use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::AlphaMode as JsonAlphaMode;
use gltf::json::texture::{Info, MagFilter, WrappingMode};
use gltf::json::validation::Checked;

use super::Document;
use super::buffers::out_of_range;
use super::error::{Read, malformed};
use super::images::Images;
use super::scene::{AlphaMode, Image, Material, SamplerWrap};
use super::warnings::Warnings;

/// Every material of the document, the default one after them where asked, and the images that they use.
pub(super) fn read(
    document: &Document,
    folder: &Path,
    with_default: bool,
    warnings: &mut Warnings,
) -> Read<(Vec<Material>, Vec<Image>)> {
    let mut images = Images::new(document, folder);
    let mut materials = Vec::with_capacity(document.root.materials.len() + 1);
    for (at, source) in document.root.materials.iter().enumerate() {
        let place = format!("materials[{at}]");
        note_other_textures(source, &place, warnings);
        let mut material = read_factors(source, &place, warnings)?;
        if let Some(texture) = &source.pbr_metallic_roughness.base_color_texture {
            let place = format!("{place}.pbrMetallicRoughness.baseColorTexture");
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
    ];
    for (name, present) in textures {
        warnings.add(format!("{name} left out"), u64::from(present), place);
    }
}

fn read_factors(
    source: &gltf::json::Material,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Material> {
    let pbr = &source.pbr_metallic_roughness;
    let extensions = source.extensions.as_ref();
    let strength = extensions
        .and_then(|it| it.emissive_strength.as_ref())
        .map_or(1.0, |it| it.emissive_strength.0);
    let cutoff = source.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
    let emissive_factor = source.emissive_factor.0.map(|it| it * strength);
    let mut numbers = [pbr.metallic_factor.0, pbr.roughness_factor.0, cutoff].to_vec();
    numbers.extend(pbr.base_color_factor.0);
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
        name: source.name.clone().unwrap_or_default(),
        base_color_factor: pbr.base_color_factor.0.map(&mut unit),
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
        emissive_factor: match source.emissive_texture {
            Some(_) => [0.0; 3],
            None => emissive_factor.map(|it| it.max(0.0)),
        },
        // The factor multiplies a texture that is left out; taken alone, its default of 1 would make everything metal.
        // Likewise an emissive factor under a texture would light the whole surface.
        metallic: match pbr.metallic_roughness_texture {
            Some(_) => 0.0,
            None => unit(pbr.metallic_factor.0),
        },
        roughness: unit(pbr.roughness_factor.0),
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
    let uv_set = transform
        .and_then(|it| it.tex_coord)
        .unwrap_or(info.tex_coord);
    if uv_set != 0 {
        warnings.add(format!("textures on TEXCOORD_{uv_set} left out"), 1, place);
        return Ok(());
    }
    let place = format!("textures[{index}]");
    // The crate's mark for a texture without a source: an extension holds it.
    if texture.source.value() == u32::MAX as usize {
        let others = texture.extensions.as_ref().map(|it| &it.others);
        let names: Vec<_> = others
            .into_iter()
            .flat_map(|it| it.keys())
            .cloned()
            .collect();
        let what = match names.is_empty() {
            true => "textures without an image left out".to_owned(),
            false => format!("textures that need {} left out", names.join(", ")),
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

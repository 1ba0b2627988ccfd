//! Surface: what the statements of a material in an MTL come to. Diffuse and emitted colour,
//! opacity, the diffuse texture, and the metallic-roughness numbers that newer programs add.
//! Colours are read as sRGB, as those of the vertices.
//!
//! A statement that cannot be read is left out: no material costs the geometry. Statements hang on
//! each other in no order, so that they are gathered first: `d` counts beside `Tr`, and a factor
//! counts for nothing under a texture that is left out, since many programs write 1 there.

use crate::import::color::linear_from_srgb;
use crate::import::error::quoted;
use crate::import::plain;
use crate::import::scene::{AlphaMode, Material, SamplerWrap, short_name};
use crate::import::warnings::Warnings;

/// Textures that are left out by name; the name of any other may be text of a file that is no
/// library. In small letters: programs do not agree on the case.
const LEFT_OUT: &[&str] = &[
    "map_ka", "map_ks", "map_ns", "map_ni", "map_d", "map_tr", "map_kt", "map_kn", "map_bump",
    "map_ps", "map_refl", "map_disp", "map_aat", "bump", "norm", "disp", "decal", "refl",
];

/// A texture that a statement names.
#[derive(Clone)]
pub(super) struct Texture {
    pub(super) name: String,
    /// File and line of the statement.
    pub(super) place: String,
}

/// A material with all its statements.
#[derive(Clone)]
pub(super) struct Settled {
    pub(super) material: Material,
    /// Of its base colour.
    pub(super) texture: Option<Texture>,
}

/// Statements of a material, as far as they were read.
pub(super) struct Entry {
    material: Material,
    texture: Option<Texture>,
    /// `d` and `Tr`, with their places.
    opacity: Option<(f32, String)>,
    transparency: Option<(f32, String)>,
    /// Textures of emission, metalness and roughness, which are left out.
    emissive: Option<Texture>,
    metallic: Option<Texture>,
    roughness: Option<Texture>,
}

impl Entry {
    pub(super) fn new(name: &str) -> Self {
        let material = Material {
            name: short_name(name),
            ..plain::material()
        };
        Self {
            material,
            texture: None,
            opacity: None,
            transparency: None,
            emissive: None,
            metallic: None,
            roughness: None,
        }
    }

    /// Takes in a statement.
    pub(super) fn statement(
        &mut self,
        keyword: &str,
        rest: &str,
        place: &str,
        warnings: &mut Warnings,
    ) {
        let material = &mut self.material;
        let mut read = |rest: &str| {
            let number = number(rest);
            let what = format!("{keyword} without a number left out");
            warnings.add(what, u64::from(number.is_none()), place);
            number
        };
        let small = keyword.to_ascii_lowercase();
        match &*small {
            "kd" | "ke" => match color(rest) {
                None => {
                    let what = format!("{keyword} that is no red, green and blue left out");
                    warnings.add(what, 1, place);
                }
                Some(color) if small == "kd" => {
                    material.base_color_factor[..3].copy_from_slice(&color);
                }
                Some(color) => material.emissive_factor = color,
            },
            "d" => {
                let number = read(rest.trim_start_matches("-halo").trim());
                self.opacity = number.map(|it| (it, place.to_owned()));
            }
            "tr" => self.transparency = read(rest).map(|it| (it, place.to_owned())),
            "pr" => {
                material.roughness = read(rest).map_or(material.roughness, |it| it.clamp(0.0, 1.0));
            }
            "pm" => {
                material.metallic = read(rest).map_or(material.metallic, |it| it.clamp(0.0, 1.0));
            }
            "map_kd" => self.texture = texture(rest, material, place),
            // Their options must not move the base colour's texture.
            "map_ke" => self.emissive = texture(rest, &mut material.clone(), place),
            "map_pm" => self.metallic = texture(rest, &mut material.clone(), place),
            "map_pr" => self.roughness = texture(rest, &mut material.clone(), place),
            _ if LEFT_OUT.contains(&&*small) => {
                warnings.add(format!("{keyword} left out"), 1, place);
            }
            _ if small.starts_with("map_") => {
                warnings.add("textures of unknown kinds left out", 1, place);
            }
            // Ka, Ks, Ns, Ni, illum and the like: no part of the metallic-roughness model.
            _ => {}
        }
    }

    /// The material, now that all its statements are there.
    pub(super) fn settled(mut self, warnings: &mut Warnings) -> Settled {
        let plain = plain::material();
        let material = &mut self.material;
        // Black under a texture is what some programs write for "see the texture".
        if self.texture.is_some() && material.base_color_factor[..3] == [0.0; 3] {
            material.base_color_factor = plain.base_color_factor;
        }
        let mut leave_out = |map: &str, factor: &str, texture: Option<Texture>| {
            if let Some(texture) = &texture {
                let name = quoted(&texture.name);
                let what = format!("{map} {name} left out, and {factor} with it");
                warnings.add(what, 1, &texture.place);
            }
            texture.is_some()
        };
        if leave_out("map_Ke", "Ke", self.emissive) {
            material.emissive_factor = plain.emissive_factor;
        }
        if leave_out("map_Pm", "Pm", self.metallic) {
            material.metallic = plain.metallic;
        }
        if leave_out("map_Pr", "Pr", self.roughness) {
            material.roughness = plain.roughness;
        }
        let (opacity, place) = match (self.opacity, self.transparency) {
            (Some(opacity), _) => opacity,
            // Opaque to the programs that write it for opacity, and invisible to no author.
            (None, Some((1.0.., place))) => {
                warnings.add("Tr 1 without d read as opaque", 1, &place);
                (1.0, place)
            }
            (None, Some((transparency, place))) => (1.0 - transparency, place),
            (None, None) => (1.0, String::new()),
        };
        let opacity = opacity.clamp(0.0, 1.0);
        material.base_color_factor[3] = opacity;
        if opacity < 1.0 {
            material.alpha_mode = AlphaMode::Blend;
            let what = match opacity < 0.5 {
                true => "materials of an opacity below 0.5 not seen: blending is not drawn yet",
                false => "materials of an opacity below 1 drawn opaque: blending is not drawn yet",
            };
            warnings.add(what, 1, &place);
        }
        Settled {
            material: self.material,
            texture: self.texture,
        }
    }
}

fn number(text: &str) -> Option<f32> {
    let word = text.split_whitespace().next()?;
    word.parse::<f32>().ok().filter(|it| it.is_finite())
}

/// Linear RGB; one number stands for all three. `None` for the forms that are no RGB.
fn color(text: &str) -> Option<[f32; 3]> {
    let mut color = [number(text)?; 3];
    for (channel, word) in color.iter_mut().zip(text.split_whitespace()).skip(1) {
        *channel = number(word)?;
    }
    Some(color.map(|it| linear_from_srgb(f64::from(it.clamp(0.0, 1.0))) as f32))
}

fn texture(text: &str, material: &mut Material, place: &str) -> Option<Texture> {
    let name = texture_name(text, material);
    (!name.is_empty()).then(|| Texture {
        name,
        place: place.to_owned(),
    })
}

/// The file's name behind its options, of which scale, offset and clamping are read.
fn texture_name(text: &str, material: &mut Material) -> String {
    let (mut scale, mut offset) = ([1.0f32; 2], [0.0f32; 2]);
    let mut rest = text.trim_start();
    while let Some(option) = rest
        .split_whitespace()
        .next()
        .filter(|it| it.starts_with('-'))
    {
        let least = match option {
            "-blendu" | "-blendv" | "-cc" | "-clamp" | "-texres" | "-bm" | "-boost"
            | "-imfchan" | "-type" => 1,
            "-mm" => 2,
            "-s" | "-o" | "-t" => 3,
            _ => break,
        };
        rest = rest[option.len()..].trim_start();
        let mut numbers = [0.0f32; 3];
        for at in 0..least {
            let word = rest.split_whitespace().next().unwrap_or_default();
            let number = word.parse::<f32>().ok().filter(|it| it.is_finite());
            // Scale and offset may have one to three numbers.
            if least == 3 && number.is_none() {
                break;
            }
            if option == "-clamp" && word == "on" {
                (material.wrap_u, material.wrap_v) = (SamplerWrap::Clamp, SamplerWrap::Clamp);
            }
            if let Some(number) = number {
                match (option, at) {
                    ("-s", 0 | 1) => scale[at] = number,
                    ("-o", 0 | 1) => offset[at] = number,
                    _ => numbers[at] = number,
                }
            }
            rest = rest[word.len()..].trim_start();
        }
    }
    if (scale, offset) != ([1.0; 2], [0.0; 2]) {
        // Given for v upwards: 1 - v' = s (1 - v) + o.
        let down = 1.0 - scale[1] - offset[1];
        material.uv_transform = Some([scale[0], 0.0, offset[0], 0.0, scale[1], down]);
    }
    rest.trim().to_owned()
}

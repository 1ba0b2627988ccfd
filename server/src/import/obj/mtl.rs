//! MTL: the material library beside an OBJ. Diffuse and emitted colour, opacity, the diffuse texture, and the
//! metallic-roughness numbers that newer programs add. Colours are read as sRGB, as those of the vertices.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use crate::import::allowance::Allowance;
use crate::import::color::linear_from_srgb;
use crate::import::error::{Read, malformed, quoted, short};
use crate::import::images::Gauge;
use crate::import::plain;
use crate::import::scene::{AlphaMode, Image, Material, SamplerWrap, short_name};
use crate::import::warnings::Warnings;

/// Materials by name, from all libraries that a file names; the first of a name counts.
#[derive(Default)]
pub(super) struct Library {
    known: HashMap<String, Entry>,
    /// Files that were read.
    loaded: HashSet<PathBuf>,
    looked_for: usize,
}

/// Files that are looked for in a model; more would cost much and say little.
const MOST_LIBRARIES: usize = 1024;
/// Materials that are kept of all libraries; a mesh uses a quarter of them at most.
const MOST_MATERIALS: usize = 1 << 18;
/// Textures that are left out by name; the name of any other may be text of a file that is no
/// library.
const LEFT_OUT: &[&str] = &[
    "map_Ka", "map_Ks", "map_Ns", "map_Ni", "map_d", "map_Tr", "map_Ke", "map_Kt", "map_Kn",
    "map_Bump", "map_bump", "map_Pr", "map_Pm", "map_Ps", "map_refl", "map_disp", "map_aat",
    "bump", "norm", "disp", "decal", "refl",
];

#[derive(Clone)]
struct Entry {
    material: Material,
    texture: Option<Texture>,
}

#[derive(Clone)]
struct Texture {
    name: String,
    place: String,
}

impl Library {
    /// Loads the libraries in the line `mtllib NAMES`: one name, blanks included, where there is such a file, else several.
    pub(super) fn load(
        &mut self,
        names: &str,
        allowance: &Allowance,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        if allowance.is_self_contained() {
            let what = "material libraries left out (--self-contained)";
            warnings.add(what, 1, &format!("{place} {}", quoted(names)));
            return Ok(());
        }
        if !names.contains(char::is_whitespace) {
            return self.load_one(names, allowance, place, warnings);
        }
        match self.find(names, allowance, place) {
            Ok(path) => self.load_file(&path, names, allowance, place, warnings),
            Err(_) => names
                .split_whitespace()
                .take(MOST_LIBRARIES + 1)
                .try_for_each(|name| self.load_one(name, allowance, place, warnings)),
        }
    }

    fn find(&mut self, name: &str, allowance: &Allowance, place: &str) -> Read<PathBuf> {
        self.looked_for += 1;
        allowance.file(&name.replace('\\', "/"), place)
    }

    fn load_one(
        &mut self,
        name: &str,
        allowance: &Allowance,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        if self.looked_for >= MOST_LIBRARIES {
            let what = format!("material libraries beyond the first {MOST_LIBRARIES} left out");
            warnings.add(what, 1, place);
            return Ok(());
        }
        match self.find(name, allowance, place) {
            Ok(path) => self.load_file(&path, name, allowance, place, warnings),
            Err(fault) => {
                warnings.add(format!("material libraries left out ({fault})"), 1, place);
                Ok(())
            }
        }
    }

    fn load_file(
        &mut self,
        path: &Path,
        name: &str,
        allowance: &Allowance,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        // The first of a name counts, so that a library says nothing new the second time.
        if !self.loaded.insert(path.to_owned()) {
            return Ok(());
        }
        match allowance.read(path, name, place) {
            Ok(bytes) => {
                // The text and what it says.
                allowance.fits(3 * bytes.len() as u64, place)?;
                let file = name.rsplit(['/', '\\']).next().unwrap_or(name);
                self.parse(&String::from_utf8_lossy(&bytes), file, warnings)
            }
            Err(fault) => {
                warnings.add(format!("material libraries left out ({fault})"), 1, place);
                Ok(())
            }
        }
    }

    fn parse(&mut self, text: &str, file: &str, warnings: &mut Warnings) -> Read<()> {
        let mut current: Option<(String, Entry)> = None;
        for (number, line) in (1u64..).zip(text.lines()) {
            let place = format!("{file} line {number}");
            let line = line.trim();
            let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            let rest = rest.trim();
            if keyword == "newmtl" {
                self.keep(current.take());
                let material = Material {
                    name: short_name(rest),
                    ..plain::material()
                };
                let entry = Entry {
                    material,
                    texture: None,
                };
                current = Some((rest.to_owned(), entry));
                continue;
            }
            let Some((_, entry)) = &mut current else {
                continue;
            };
            entry.statement(keyword, rest, &place, warnings)?;
        }
        self.keep(current);
        Ok(())
    }

    fn keep(&mut self, entry: Option<(String, Entry)>) {
        if let Some((name, entry)) = entry
            && self.known.len() < MOST_MATERIALS
        {
            self.known.entry(name).or_insert(entry);
        }
    }

    /// The materials of `names`, with their images, each once. Textures are of no use to a mesh that is not `textured`.
    pub(super) fn materials(
        &self,
        names: &[Option<String>],
        allowance: &Allowance,
        textured: bool,
        warnings: &mut Warnings,
    ) -> Read<(Vec<Material>, Vec<Image>)> {
        let mut gauge = Gauge::new(allowance);
        let mut images = Vec::new();
        let mut image_of_name: HashMap<&str, Option<u32>> = HashMap::new();
        let mut materials = Vec::with_capacity(names.len());
        for name in names {
            let Some(name) = name else {
                materials.push(plain::material());
                continue;
            };
            let Some(entry) = self.known.get(name) else {
                let what = "materials that no library defines read as plain";
                warnings.add(what, 1, &format!("usemtl {}", short(name)));
                materials.push(Material {
                    name: short_name(name),
                    ..plain::material()
                });
                continue;
            };
            let mut material = entry.material.clone();
            if let Some(texture) = &entry.texture {
                if !textured {
                    let what = "textures of a mesh without texture coordinates left out";
                    warnings.add(what, 1, &texture.place);
                } else if let Some(known) = image_of_name.get(&*texture.name) {
                    material.base_color_image = *known;
                } else {
                    let image = gauge.beside(&texture.name, &texture.place, warnings)?;
                    let number = image.is_some().then_some(images.len() as u32);
                    images.extend(image);
                    image_of_name.insert(&texture.name, number);
                    material.base_color_image = number;
                }
            }
            // Black under a texture is what some programs write for "see the texture".
            if material.base_color_image.is_some() && material.base_color_factor[..3] == [0.0; 3] {
                let alpha = material.base_color_factor[3];
                material.base_color_factor = [1.0, 1.0, 1.0, alpha];
            }
            materials.push(material);
        }
        Ok((materials, images))
    }
}

impl Entry {
    fn statement(
        &mut self,
        keyword: &str,
        rest: &str,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        let material = &mut self.material;
        match keyword {
            "Kd" | "Ke" => {
                let Some(color) = color(rest, place)? else {
                    let what = format!("{keyword} given as a spectrum left out");
                    warnings.add(what, 1, place);
                    return Ok(());
                };
                match keyword {
                    "Kd" => material.base_color_factor[..3].copy_from_slice(&color),
                    _ => material.emissive_factor = color,
                }
            }
            "d" | "Tr" => {
                let number = number(rest.trim_start_matches("-halo").trim(), place)?;
                let opacity = if keyword == "d" { number } else { 1.0 - number };
                let opacity = opacity.clamp(0.0, 1.0);
                material.base_color_factor[3] = opacity;
                material.alpha_mode = match opacity < 1.0 {
                    true => AlphaMode::Blend,
                    false => AlphaMode::Opaque,
                };
            }
            "Pr" => material.roughness = number(rest, place)?.clamp(0.0, 1.0),
            "Pm" => material.metallic = number(rest, place)?.clamp(0.0, 1.0),
            "map_Kd" => {
                let name = texture_name(rest, material);
                self.texture = (!name.is_empty()).then(|| Texture {
                    name,
                    place: place.to_owned(),
                });
            }
            _ if LEFT_OUT.contains(&keyword) => {
                warnings.add(format!("{keyword} left out"), 1, place);
            }
            _ if keyword.starts_with("map_") => {
                warnings.add("textures of unknown kinds left out", 1, place);
            }
            // Ka, Ks, Ns, Ni, illum and the like: no part of the metallic-roughness model.
            _ => {}
        }
        Ok(())
    }
}

fn number(text: &str, place: &str) -> Read<f32> {
    let word = text.split_whitespace().next().unwrap_or_default();
    let number = word.parse::<f32>().ok().filter(|it| it.is_finite());
    // Not quoted: the file may be anything that the model names.
    let found = if word.is_empty() {
        "nothing"
    } else {
        "another word"
    };
    number.ok_or_else(|| malformed(place, "a number", found))
}

/// Linear RGB; one number stands for all three. `None` for the forms that are no RGB.
fn color(text: &str, place: &str) -> Read<Option<[f32; 3]>> {
    if text.starts_with("spectral") || text.starts_with("xyz") {
        return Ok(None);
    }
    let words: Vec<&str> = text.split_whitespace().collect();
    let mut color = [number(text, place)?; 3];
    for (channel, word) in color.iter_mut().zip(&words).skip(1) {
        *channel = number(word, place)?;
    }
    Ok(Some(color.map(|it| {
        linear_from_srgb(f64::from(it.clamp(0.0, 1.0))) as f32
    })))
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
    rest.trim().replace('\\', "/")
}

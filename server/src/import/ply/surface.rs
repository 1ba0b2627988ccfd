//! Surface: the plain one, with the textures that the header names (`comment TextureFile NAME`, the
//! habit of scanning programs).

use std::collections::{BTreeSet, HashMap};

use super::body::Body;
use super::header::Header;
use super::list::NO_TEXTURE;
use crate::import::allowance::Allowance;
use crate::import::error::Read;
use crate::import::images::Gauge;
use crate::import::plain;
use crate::import::scene::{Image, Material};
use crate::import::warnings::Warnings;

/// The number of a texture, as a face gives it.
pub(super) fn number(texture: f64, header: &Header) -> u16 {
    let named = texture >= 0.0 && texture < header.textures.len() as f64;
    match named && texture < f64::from(NO_TEXTURE) {
        true => texture as u16,
        false => NO_TEXTURE,
    }
}

/// A material for each texture that is used.
pub(super) fn materials(
    header: &Header,
    body: &Body,
    allowance: &Allowance,
    warnings: &mut Warnings,
) -> Read<(Vec<Material>, Vec<Image>)> {
    let place = "comment TextureFile";
    let mut gauge = Gauge::new(allowance);
    let mut images = Vec::new();
    let mut image_of_name: HashMap<&str, Option<u32>> = HashMap::new();
    let mut materials = Vec::with_capacity(body.textures.len());
    let is_textured = body.present.uvs && body.triangle_count > 0;
    for &texture in &body.textures {
        let mut material = plain::material();
        let name = header.textures.get(usize::from(texture));
        if let Some(name) = name.filter(|_| is_textured) {
            let image = match image_of_name.get(&**name) {
                Some(known) => *known,
                None => {
                    let image = gauge.beside(name, place, warnings)?;
                    let number = image.is_some().then_some(images.len() as u32);
                    images.extend(image);
                    image_of_name.insert(name, number);
                    number
                }
            };
            material.base_color_image = image;
        }
        materials.push(material);
    }
    let named = header.textures.len() as u64;
    if is_textured {
        let used: BTreeSet<u16> = body.textures.iter().copied().collect();
        let used = used.iter().filter(|&&it| u64::from(it) < named).count() as u64;
        warnings.add("textures that no face uses left out", named - used, place);
    } else {
        let what = "textures of a mesh without texture coordinates left out";
        warnings.add(what, named, place);
    }
    let images = gauge.decodable(images, &mut materials, warnings);
    Ok((materials, images))
}

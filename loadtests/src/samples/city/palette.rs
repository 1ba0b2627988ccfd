//! The materials of the city, by index, and their textures.

use crate::samples::glb::Material;
use crate::samples::textures;

pub(super) const BRICK: usize = 0;
pub(super) const STONE: usize = 1;
pub(super) const GLASS: usize = 2;
pub(super) const METAL: usize = 3;
pub(super) const ASPHALT: usize = 4;
pub(super) const PAVING: usize = 5;
pub(super) const GRASS: usize = 6;
pub(super) const TILES: usize = 7;
pub(super) const LEAVES: usize = 8;
pub(super) const BARK: usize = 9;
pub(super) const PAINT: usize = 10;
pub(super) const ROCK: usize = 11;

pub(super) const WHITE: [f64; 3] = [1.0; 3];

/// Textures by index: brick, stone, asphalt, paving, grass.
pub(super) fn textures() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("brick", textures::bricks()),
        ("stone", textures::stone()),
        ("asphalt", textures::asphalt()),
        ("paving", textures::paving()),
        ("grass", textures::grass()),
    ]
}

/// In the order of the constants above; a test holds them together.
pub(super) fn materials() -> Vec<Material> {
    let material = |name, base_colour, roughness, metallic, texture| Material {
        name,
        base_colour,
        roughness,
        metallic,
        texture,
        double_sided: name == "leaves",
    };
    vec![
        material("brick", WHITE, 0.9, 0.0, Some(0)),
        material("stone", WHITE, 0.85, 0.0, Some(1)),
        material("glass", WHITE, 0.08, 0.0, None),
        material("metal", WHITE, 0.45, 0.6, None),
        material("asphalt", WHITE, 0.95, 0.0, Some(2)),
        material("paving", WHITE, 0.9, 0.0, Some(3)),
        material("grass", WHITE, 1.0, 0.0, Some(4)),
        material("tiles", WHITE, 0.8, 0.0, None),
        material("leaves", WHITE, 0.8, 0.0, None),
        material("bark", WHITE, 0.95, 0.0, None),
        material("paint", WHITE, 0.25, 0.0, None),
        material("rock", WHITE, 0.9, 0.0, None),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_name_their_materials() {
        let names: Vec<_> = materials().iter().map(|m| m.name).collect();
        for (index, name) in [
            (BRICK, "brick"),
            (STONE, "stone"),
            (GLASS, "glass"),
            (METAL, "metal"),
            (ASPHALT, "asphalt"),
            (PAVING, "paving"),
            (GRASS, "grass"),
            (TILES, "tiles"),
            (LEAVES, "leaves"),
            (BARK, "bark"),
            (PAINT, "paint"),
            (ROCK, "rock"),
        ] {
            assert_eq!(names.get(index), Some(&name));
        }
    }
}

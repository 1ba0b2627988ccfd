//! Scene materials as glTF JSON.

use lodestream_format::scene::{AlphaMode, Material, Scene, TextureUse, Wrap};
use serde_json::{Map, Value, json};

/// `materials`, `textures` and `samplers` of a document, and the extensions that they use.
#[derive(Debug, Default)]
pub(super) struct Materials {
    pub materials: Vec<Value>,
    pub textures: Vec<Value>,
    pub samplers: Vec<Value>,
    pub extensions: Vec<&'static str>,
}

impl Materials {
    /// Image `i` of the document is texture `i` of the scene.
    pub(super) fn of(scene: &Scene) -> Self {
        let mut all = Self::default();
        for material in &scene.materials {
            let json = all.material(material);
            all.materials.push(json);
        }
        all
    }

    fn material(&mut self, material: &Material) -> Value {
        let mut surface = json!({
            "baseColorFactor": material.base_color_factor,
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        });
        if let Some(used) = &material.base_color {
            surface["baseColorTexture"] = self.texture(used);
        }
        let mut extensions = Map::new();
        if material.unlit {
            self.uses("KHR_materials_unlit");
            extensions.insert("KHR_materials_unlit".to_owned(), json!({}));
        }
        let strength = material.emissive_factor.iter().copied().fold(1.0, f32::max);
        if strength > 1.0 {
            let name = "KHR_materials_emissive_strength";
            self.uses(name);
            extensions.insert(name.to_owned(), json!({ "emissiveStrength": strength }));
        }
        let mut json = json!({
            "name": material.name,
            "pbrMetallicRoughness": surface,
            "emissiveFactor": material.emissive_factor.map(|value| value / strength),
            "doubleSided": material.double_sided,
        });
        match material.alpha_mode {
            AlphaMode::Opaque => {}
            AlphaMode::Mask { cutoff } => {
                json["alphaMode"] = json!("MASK");
                json["alphaCutoff"] = json!(cutoff);
            }
            AlphaMode::Blend => json["alphaMode"] = json!("BLEND"),
        }
        if !extensions.is_empty() {
            json["extensions"] = Value::Object(extensions);
        }
        json
    }

    fn texture(&mut self, used: &TextureUse) -> Value {
        let wrap = used.wrap.map(|wrap| match wrap {
            Wrap::Repeat => 10497,
            Wrap::Clamp => 33071,
            Wrap::Mirror => 33648,
        });
        let filter = if used.nearest { 9728 } else { 9729 };
        let sampler = json!({ "wrapS": wrap[0], "wrapT": wrap[1], "magFilter": filter });
        let sampler = index_of(&mut self.samplers, sampler);
        let texture = json!({ "source": used.texture, "sampler": sampler });
        let mut info = json!({ "index": index_of(&mut self.textures, texture) });
        if used.uv_transform != TextureUse::IDENTITY {
            self.uses("KHR_texture_transform");
            info["extensions"] = json!({ "KHR_texture_transform": transform(&used.uv_transform) });
        }
        info
    }

    fn uses(&mut self, extension: &'static str) {
        if !self.extensions.contains(&extension) {
            self.extensions.push(extension);
        }
    }
}

fn index_of(list: &mut Vec<Value>, value: Value) -> usize {
    list.iter()
        .position(|known| *known == value)
        .unwrap_or_else(|| {
            list.push(value);
            list.len() - 1
        })
}

/// Rows `[a b c; d e f]` as offset, rotation and scale of KHR_texture_transform:
/// `a = cos s, d = -sin s, b = sin t, e = cos t` for the angle and the scales s and t.
fn transform(rows: &[[f32; 3]; 2]) -> Value {
    let [[a, b, x], [d, e, y]] = rows.map(|row| row.map(f64::from));
    let angle = match (a, d) {
        (0.0, 0.0) => b.atan2(e),
        _ => (-d).atan2(a),
    };
    let (sin, cos) = angle.sin_cos();
    json!({
        "offset": [x, y],
        "rotation": angle,
        "scale": [a * cos - d * sin, b * sin + e * cos],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_come_back() {
        for (angle, s, t) in [
            (0.0, 2.0, 3.0),
            (0.7, 2.0, -3.0),
            (-2.5, 0.5, 1.0),
            (3.0, 0.0, 2.0),
        ] {
            let (sin, cos) = f64::sin_cos(angle);
            let rows = [
                [cos * s, sin * t, 0.25].map(|value| value as f32),
                [-sin * s, cos * t, -4.0].map(|value| value as f32),
            ];
            let json = transform(&rows);
            let number = |value: &Value| value.as_f64().expect("a number");
            let (sin, cos) = number(&json["rotation"]).sin_cos();
            let (s, t) = (number(&json["scale"][0]), number(&json["scale"][1]));
            let again = [[cos * s, sin * t], [-sin * s, cos * t]];
            for row in 0..2 {
                for column in 0..2 {
                    let difference = again[row][column] - rows[row][column] as f64;
                    assert!(difference.abs() < 1e-6, "{angle} {s} {t}");
                }
            }
            assert_eq!(json["offset"], json!([0.25, -4.0]));
        }
    }
}

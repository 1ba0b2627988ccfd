//! Instancing: one node in many places, by `EXT_mesh_gpu_instancing`.

use glam::DAffine3;

use super::super::Document;
use super::super::accessor::ComponentType::{F32, I8, I16};
use super::super::accessor::{Accessor, Component};
use super::super::buffers::demand;
use super::super::document::Node;
use super::super::error::{Read, malformed, short};
use super::super::features;
use super::super::warnings::Warnings;
use super::transform::compose;

/// The transforms of `EXT_mesh_gpu_instancing`.
pub(super) struct Instancing {
    pub(super) count: usize,
    translation: Option<Vec<[f32; 3]>>,
    rotation: Option<Vec<[f32; 4]>>,
    scale: Option<Vec<[f32; 3]>>,
}

const FLOAT: &[Component] = &[(F32, None)];
const ROTATION: &[Component] = &[(F32, None), (I8, Some(true)), (I16, Some(true))];

/// Reads the extension of `node`, where it has it.
pub(super) fn instancing(
    document: &Document,
    node: &Node,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Option<Instancing>> {
    let extensions = node.extensions.as_ref();
    let Some(extension) = extensions.and_then(|it| it.instancing.as_ref()) else {
        return Ok(None);
    };
    let place = format!("{place}.extensions.{}.attributes", features::INSTANCING);
    let attributes = demand(extension.attributes.as_ref(), &place)?;
    let mut instancing = Instancing {
        count: 0,
        translation: None,
        rotation: None,
        scale: None,
    };
    let mut count = None;
    for (name, index) in &attributes.0 {
        let name = short(name);
        let place = format!("{place}.{name}");
        let (lanes, components) = match name.as_str() {
            "TRANSLATION" | "SCALE" => (3, FLOAT),
            "ROTATION" => (4, ROTATION),
            _ => {
                warnings.add(format!("instance attributes {name} left out"), 1, &place);
                continue;
            }
        };
        let accessor = Accessor::open(document, index.value(), &place)?;
        accessor.expect(&[lanes], components)?;
        if *count.get_or_insert(accessor.count) != accessor.count {
            let expected = "as many elements as the other attributes";
            return Err(malformed(place, expected, accessor.count));
        }
        // An accessor without a buffer view has few elements, any other its bytes in the file.
        match name.as_str() {
            "TRANSLATION" => instancing.translation = Some(accessor.all_floats()?),
            "SCALE" => instancing.scale = Some(accessor.all_floats()?),
            _ => instancing.rotation = Some(accessor.all_floats()?),
        }
    }
    match count {
        Some(count) => {
            instancing.count = count;
            Ok(Some(instancing))
        }
        None => Err(malformed(place, "TRANSLATION, ROTATION or SCALE", "none")),
    }
}

impl Instancing {
    /// `node_from_instance` of instance `at < count`.
    pub(super) fn get(&self, at: usize, place: &str) -> Read<DAffine3> {
        let translation = self.translation.as_ref().map(|it| it[at]);
        let rotation = self.rotation.as_ref().map(|it| it[at]);
        let scale = self.scale.as_ref().map(|it| it[at]);
        let node_from_instance = compose(
            translation.map_or([0.0; 3], |it| it.map(f64::from)),
            rotation.map_or([0.0, 0.0, 0.0, 1.0], |it| it.map(f64::from)),
            scale.map_or([1.0; 3], |it| it.map(f64::from)),
        );
        match node_from_instance.is_finite() {
            true => Ok(node_from_instance),
            false => {
                let place = format!("{place}.extensions.{}", features::INSTANCING);
                Err(malformed(
                    place,
                    "finite transforms",
                    format!("others at instance {at}"),
                ))
            }
        }
    }
}

//! Transform: of a node into its parent, in f64 as the document writes it.

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::super::document::Node;
use super::super::error::{Read, malformed};
use super::super::warnings::Warnings;

/// `parent_from_node`.
pub(super) fn parent_from_node(
    node: &Node,
    place: &str,
    warnings: &mut Warnings,
) -> Read<DAffine3> {
    // Every renderer goes to f32 in the end.
    let within = |values: &[f64], name: &str| {
        let fits = |value: &f64| value.abs() <= f64::from(f32::MAX);
        match values.iter().all(fits) {
            true => Ok(()),
            false => {
                let place = format!("{place}.{name}");
                let found = format!("{values:?}");
                Err(malformed(place, "numbers within f32", found))
            }
        }
    };
    if let Some(matrix) = &node.matrix {
        within(&matrix[..], "matrix")?;
        let place = format!("{place}.matrix");
        let both = node.translation.is_some() || node.rotation.is_some() || node.scale.is_some();
        let what = "translations, rotations and scales beside a matrix left out";
        warnings.add(what, u64::from(both), &place);
        let last_row = [matrix[3], matrix[7], matrix[11], matrix[15]];
        // Exporters multiply in f32, so the last row may be off by a rounding.
        let off = |(found, expected): (&f64, f64)| (found - expected).abs() > 1e-5;
        if last_row.iter().zip([0.0, 0.0, 0.0, 1.0]).any(off) {
            let found = format!("{last_row:?}");
            return Err(malformed(place, "a last row of 0 0 0 1", found));
        }
        return Ok(DAffine3::from_mat4(DMat4::from_cols_array(matrix)));
    }
    let translation = node.translation.unwrap_or([0.0; 3]);
    let scale = node.scale.unwrap_or([1.0; 3]);
    let rotation = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    within(&translation, "translation")?;
    within(&scale, "scale")?;
    within(&rotation, "rotation")?;
    if rotation == [0.0; 4] {
        warnings.add("rotations of no length read as none", 1, place);
    }
    Ok(compose(translation, rotation, scale))
}

/// Translation after rotation after scale; the quaternion is x, y, z, w and need not have unit
/// length.
pub(super) fn compose(translation: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) -> DAffine3 {
    let rotation = DQuat::from_array(rotation);
    let rotation = match rotation.length_squared() > 0.0 {
        true => rotation.normalize(),
        false => DQuat::IDENTITY,
    };
    DAffine3::from_scale_rotation_translation(
        DVec3::from(scale),
        rotation,
        DVec3::from(translation),
    )
}

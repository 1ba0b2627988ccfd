//! Attributes: positions, normals, texture coordinates and colours out of their accessors, checked or mended.

use glam::DVec3;
use gltf::json::accessor::ComponentType::{F32, I8, I16, U8, U16};

use super::Document;
use super::accessor::{Accessor, Component};
use super::error::{Read, malformed};
use super::warnings::Warnings;

const FLOAT: Component = (F32, None);
const NORMALIZED: &[Component] = &[FLOAT, (U8, Some(true)), (U16, Some(true))];
/// `KHR_mesh_quantization`.
const QUANTIZED: &[Component] = &[FLOAT, (I8, None), (U8, None), (I16, None), (U16, None)];
const QUANTIZED_NORMAL: &[Component] = &[FLOAT, (I8, Some(true)), (I16, Some(true))];

/// Which attributes a mesh has beside positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Present {
    pub(super) normals: bool,
    pub(super) uvs: bool,
    pub(super) colors: bool,
}

/// Warning for what [`unit_normal`] counts.
pub(super) const RESCALED: &str = "normals brought to unit length";
/// Warning for what [`finite_uv`] counts.
pub(super) const REPLACED_UVS: &str = "texture coordinates that are not finite set to 0";

/// `normal` at unit length, zero where that cannot be; counts those that were far from it.
pub(super) fn unit_normal(normal: [f64; 3], rescaled: &mut u64) -> [f32; 3] {
    /// The specification's validator allows this much; quantised normals stay below it.
    const LENGTH_TOLERANCE: f64 = 0.02;
    // In f64 no length of finite f32 overflows or vanishes.
    let normal = DVec3::from(normal);
    let length = normal.length();
    if !length.is_finite() || length == 0.0 {
        return [0.0; 3];
    }
    *rescaled += u64::from((length - 1.0).abs() > LENGTH_TOLERANCE);
    (normal / length).as_vec3().to_array()
}

/// `uv`, zero where it is not finite; counts those.
pub(super) fn finite_uv(uv: [f32; 2], replaced: &mut u64) -> [f32; 2] {
    let finite = uv.iter().all(|it| it.is_finite());
    *replaced += u64::from(!finite);
    if finite { uv } else { [0.0; 2] }
}

/// Positions of the vertices `used`, all finite.
pub(super) fn positions(
    document: &Document,
    accessor: usize,
    used: &[u32],
    place: &str,
) -> Read<Vec<[f32; 3]>> {
    let user = format!("{place}.attributes.POSITION");
    let accessor = Accessor::open(document, accessor, &user)?;
    let components = if document.quantized {
        QUANTIZED
    } else {
        &[FLOAT]
    };
    accessor.expect(&[3], components)?;
    let mut positions = Vec::with_capacity(used.len());
    for &vertex in used {
        let position: [f32; 3] = accessor.floats(vertex as usize);
        if !position.iter().all(|it| it.is_finite()) {
            let found = format!("{position:?} at element {vertex}");
            return Err(malformed(&accessor.place, "finite numbers", found));
        }
        positions.push(position);
    }
    Ok(positions)
}

/// Normals of the vertices `used`, brought to unit length; zero where the file's cannot be.
pub(super) fn normals(
    document: &Document,
    accessor: usize,
    used: &[u32],
    place: &str,
    warnings: &mut Warnings,
) -> Read<Vec<[f32; 3]>> {
    let user = format!("{place}.attributes.NORMAL");
    let accessor = Accessor::open(document, accessor, &user)?;
    let components = if document.quantized {
        QUANTIZED_NORMAL
    } else {
        &[FLOAT]
    };
    accessor.expect(&[3], components)?;
    let mut rescaled = 0;
    let read = |&vertex: &u32| {
        let normal = accessor.floats(vertex as usize).map(f64::from);
        unit_normal(normal, &mut rescaled)
    };
    let normals = used.iter().map(read).collect();
    warnings.add(RESCALED, rescaled, place);
    Ok(normals)
}

/// Texture coordinates of the vertices `used`.
pub(super) fn uvs(
    document: &Document,
    accessor: usize,
    used: &[u32],
    place: &str,
    warnings: &mut Warnings,
) -> Read<Vec<[f32; 2]>> {
    let user = format!("{place}.attributes.TEXCOORD_0");
    let accessor = Accessor::open(document, accessor, &user)?;
    let components = if document.quantized {
        QUANTIZED
    } else {
        NORMALIZED
    };
    accessor.expect(&[2], components)?;
    let mut replaced = 0;
    let uvs = used
        .iter()
        .map(|&vertex| finite_uv(accessor.floats(vertex as usize), &mut replaced))
        .collect();
    warnings.add(REPLACED_UVS, replaced, place);
    Ok(uvs)
}

/// Colours of the vertices `used` as linear RGBA; alpha is 1 where the file has three components.
pub(super) fn colors(
    document: &Document,
    accessor: usize,
    used: &[u32],
    place: &str,
    warnings: &mut Warnings,
) -> Read<Vec<[u8; 4]>> {
    let user = format!("{place}.attributes.COLOR_0");
    let accessor = Accessor::open(document, accessor, &user)?;
    accessor.expect(&[3, 4], NORMALIZED)?;
    let (mut replaced, mut clamped) = (0, 0);
    let colors = used
        .iter()
        .map(|&vertex| {
            let mut color = [1.0; 4];
            match accessor.lanes {
                3 => color[..3].copy_from_slice(&accessor.floats::<3>(vertex as usize)),
                _ => color = accessor.floats(vertex as usize),
            }
            if !color.iter().all(|it| it.is_finite()) {
                replaced += 1;
                return [u8::MAX; 4];
            }
            clamped += u64::from(!color.iter().all(|it| (0.0..=1.0).contains(it)));
            color.map(|it| (it.clamp(0.0, 1.0) * 255.0).round() as u8)
        })
        .collect();
    warnings.add(
        "vertex colours that are not finite set to white",
        replaced,
        place,
    );
    warnings.add("vertex colours clamped to 0..1", clamped, place);
    Ok(colors)
}

//! Attributes: positions, normals, texture coordinates and colours out of their accessors, checked or mended.

use super::Document;
use super::accessor::ComponentType::{F32, I8, I16, U8, U16};
use super::accessor::{Accessor, Component};
use super::error::{Read, malformed};
use super::pose::{Pose, Posing};
use super::primitive::VertexSource;
use super::scene::Mesh;
use super::used::Used;
use super::warnings::Warnings;
use glam::DVec3;

const FLOAT: Component = (F32, None);
/// Some exporters forget `normalized`, without which integers have no meaning here.
const NORMALIZED: &[Component] = &[FLOAT, (U8, None), (U16, None)];
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

/// An attribute that shades a surface and never moves it: a primitive is read without one that is
/// broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shading {
    Normal,
    /// Of this set.
    Uv(usize),
    Color,
}

impl Shading {
    /// The attribute of this name, where it is read beside the texture coordinates `uv_set`.
    pub(super) fn of(name: &str, uv_set: usize) -> Option<Self> {
        [Self::Normal, Self::Uv(uv_set), Self::Color]
            .into_iter()
            .find(|it| it.name() == name)
    }

    fn name(self) -> String {
        match self {
            Self::Normal => "NORMAL".to_owned(),
            Self::Uv(set) => format!("TEXCOORD_{set}"),
            Self::Color => "COLOR_0".to_owned(),
        }
    }

    /// Opens `accessors[index]`, of a type that the attribute may have; `place` is the primitive's.
    pub(super) fn open(self, document: &Document, index: usize, place: &str) -> Read<Accessor> {
        let user = format!("{place}.attributes.{}", self.name());
        let mut accessor = Accessor::open(document, index, &user)?;
        match self {
            Self::Normal if document.quantized => accessor.expect(&[3], QUANTIZED_NORMAL)?,
            Self::Normal => accessor.expect(&[3], &[FLOAT])?,
            Self::Uv(_) if document.quantized => accessor.expect(&[2], QUANTIZED)?,
            Self::Uv(_) => {
                accessor.expect(&[2], NORMALIZED)?;
                accessor.normalized = true;
            }
            Self::Color => {
                accessor.expect(&[3, 4], NORMALIZED)?;
                accessor.normalized = true;
            }
        }
        Ok(accessor)
    }
}

/// The accessors of a [`VertexSource`], each of a type that its attribute may have.
pub(super) struct Attributes {
    position: Accessor,
    normal: Option<Accessor>,
    uv: Option<Accessor>,
    color: Option<Accessor>,
    posing: Option<Posing>,
}

impl Attributes {
    /// Opens and checks them; `place` is the primitive's.
    pub(super) fn open(
        document: &Document,
        source: &VertexSource,
        pose: Option<&Pose>,
        place: &str,
    ) -> Read<Self> {
        let user = format!("{place}.attributes.POSITION");
        let position = Accessor::open(document, source.position, &user)?;
        let components = if document.quantized {
            QUANTIZED
        } else {
            &[FLOAT]
        };
        position.expect(&[3], components)?;
        let open = |shading: Shading, index: Option<usize>| {
            let accessor = index.map(|index| shading.open(document, index, place));
            accessor.transpose()
        };
        let normal = open(Shading::Normal, source.normal)?;
        let (uv_set, uv) = source.uv.unzip();
        let uv = open(Shading::Uv(uv_set.unwrap_or_default()), uv)?;
        let color = open(Shading::Color, source.color)?;
        let posing = source.pose.as_ref().zip(pose);
        let vertices = position.count;
        let open = |(source, pose)| Posing::open(document, source, pose, vertices, place);
        let posing = posing
            .map(|(source, pose)| open((source, pose)))
            .transpose()?;
        Ok(Self {
            position,
            normal,
            uv,
            color,
            posing,
        })
    }

    /// Appends the vertices `used` to the arrays of `mesh` that `present` asks for. Normals that are not there, or have no
    /// length, are zero; texture coordinates are (0, 0), colours white.
    pub(super) fn read(
        &self,
        used: &Used,
        present: Present,
        mesh: &mut Mesh,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        let first = mesh.positions.len();
        self.read_positions(used, mesh)?;
        let length = mesh.positions.len();
        if present.normals {
            let normals = mesh.normals.get_or_insert_default();
            let base = normals.len();
            normals.resize(length, [0.0; 3]);
            if let Some(accessor) = &self.normal {
                let mut rescaled = 0;
                accessor.visit_floats(&used.ascending, |at, normal: [f32; 3]| {
                    let normal = unit_normal(normal.map(f64::from), &mut rescaled);
                    normals[base + used.slot(at)] = normal;
                })?;
                warnings.add(RESCALED, rescaled, place);
            }
        }
        if let Some(posing) = &self.posing {
            let positions = &mut mesh.positions[first..];
            let normals = mesh.normals.as_mut().filter(|_| self.normal.is_some());
            let normals = normals.map(|normals| &mut normals[first..]);
            posing.apply(used, positions, normals, place, warnings)?;
        }
        if present.uvs {
            let uvs = mesh.uvs.get_or_insert_default();
            let base = uvs.len();
            uvs.resize(length, [0.0; 2]);
            if let Some(accessor) = &self.uv {
                let mut replaced = 0;
                accessor.visit_floats(&used.ascending, |at, uv| {
                    uvs[base + used.slot(at)] = finite_uv(uv, &mut replaced);
                })?;
                warnings.add(REPLACED_UVS, replaced, place);
            } else {
                let what =
                    "vertices without texture coordinates beside others with them set to (0, 0)";
                warnings.add(what, used.len() as u64, place);
            }
        }
        if present.colors {
            let colors = mesh.colors.get_or_insert_default();
            let base = colors.len();
            colors.resize(length, [u8::MAX; 4]);
            if let Some(accessor) = &self.color {
                read_colors(accessor, used, &mut colors[base..], place, warnings)?;
            }
        }
        Ok(())
    }

    fn read_positions(&self, used: &Used, mesh: &mut Mesh) -> Read<()> {
        let base = mesh.positions.len();
        mesh.positions.resize(base + used.len(), [0.0; 3]);
        let positions = &mut mesh.positions[base..];
        let mut not_finite = None;
        self.position
            .visit_floats(&used.ascending, |at, position: [f32; 3]| {
                if !position.iter().all(|it| it.is_finite()) {
                    not_finite.get_or_insert((at, position));
                }
                positions[used.slot(at)] = position;
            })?;
        match not_finite {
            None => Ok(()),
            Some((at, position)) => {
                let found = format!("{position:?} at element {}", used.ascending[at]);
                Err(malformed(&self.position.place, "finite numbers", found))
            }
        }
    }
}

/// Linear RGBA; alpha is 1 where the file has three components.
fn read_colors(
    accessor: &Accessor,
    used: &Used,
    colors: &mut [[u8; 4]],
    place: &str,
    warnings: &mut Warnings,
) -> Read<()> {
    let (mut replaced, mut clamped) = (0, 0);
    let mut set = |at: usize, color: [f32; 4]| {
        if !color.iter().all(|it| it.is_finite()) {
            replaced += 1;
            return;
        }
        clamped += u64::from(!color.iter().all(|it| (0.0..=1.0).contains(it)));
        colors[used.slot(at)] = color.map(|it| (it.clamp(0.0, 1.0) * 255.0).round() as u8);
    };
    match accessor.lanes {
        3 => accessor.visit_floats(&used.ascending, |at, [r, g, b]| set(at, [r, g, b, 1.0]))?,
        _ => accessor.visit_floats(&used.ascending, set)?,
    }
    warnings.add(
        "vertex colours that are not finite set to white",
        replaced,
        place,
    );
    warnings.add("vertex colours clamped to 0..1", clamped, place);
    Ok(())
}

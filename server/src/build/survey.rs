//! The first look at a mesh: its promises checked, its extent, its edges, its spread in space.

use lodestream_format::cluster::Attributes;

use super::error::BuildError;
use crate::import::{ImportError, Mesh, MeshSource};

/// Triangles looked at more closely: at least half of this many where the mesh has them.
const MOST_SAMPLES: usize = 1 << 18;
/// Triangles whose edges are measured; more would not move the quantiles.
const MOST_EDGE_SAMPLES: usize = 1 << 14;
/// Normals this near to their triangle's own are the triangle's own. Cosine of 1 degree.
const FLAT_COSINE: f32 = 0.99985;

/// What the whole mesh is like.
#[derive(Debug)]
pub(super) struct Survey {
    pub triangles: u64,
    pub attributes: Attributes,
    /// Every normal is its triangle's own, so that none need be stored.
    pub flat: bool,
    pub low: [f64; 3],
    pub high: [f64; 3],
    pub uv_low: [f64; 2],
    pub uv_high: [f64; 2],
    /// Lengths of some edges, metres, ascending; none is 0.
    pub edges: Vec<f64>,
    /// Centroids of every n-th triangle.
    pub centroids: Vec<[f32; 3]>,
}

impl Survey {
    /// Longest side of the bounds, metres.
    pub fn extent(&self) -> f64 {
        (0..3).fold(0.0, |most, axis| most.max(self.high[axis] - self.low[axis]))
    }

    /// Largest absolute coordinate, metres.
    pub fn largest(&self) -> f64 {
        (0..3).fold(0.0, |most, axis| {
            most.max(self.low[axis].abs()).max(self.high[axis].abs())
        })
    }
}

/// Looks at every piece once.
pub(super) fn survey(source: &impl MeshSource) -> Result<Survey, BuildError> {
    let mut survey = Survey {
        triangles: 0,
        attributes: Attributes(0),
        flat: true,
        low: [f64::MAX; 3],
        high: [f64::MIN; 3],
        uv_low: [f64::MAX; 2],
        uv_high: [f64::MIN; 2],
        edges: Vec::new(),
        centroids: Vec::new(),
    };
    let mut samples = Samples::default();
    let mut attributes = None;
    for index in 0..source.piece_count() {
        let piece = source.piece(index).map_err(unreadable)?;
        check(&piece, source)?;
        let own = attributes_of(&piece);
        if *attributes.get_or_insert(own) != own {
            return Err(wrong(
                source,
                format!("piece {index}"),
                "the attributes of the first piece".into(),
                "others".into(),
            ));
        }
        survey.add(&piece);
        samples.add(&piece);
    }
    if survey.triangles == 0 {
        return Err(BuildError::NoTriangles {
            mesh: source.name().to_owned(),
        });
    }
    survey.attributes = attributes.unwrap_or_default();
    survey.flat &= survey.attributes.has(Attributes::NORMAL);
    if survey.flat {
        survey.attributes.0 &= !Attributes::NORMAL;
    }
    survey.edges = samples.edges();
    survey.centroids = samples.taken.iter().map(centroid).collect();
    Ok(survey)
}

pub(super) fn unreadable(cause: ImportError) -> BuildError {
    BuildError::Source(cause.to_string())
}

/// Sum of the corners over three.
pub(super) fn centroid(corners: &[[f32; 3]; 3]) -> [f32; 3] {
    let [a, b, c] = corners;
    std::array::from_fn(|axis| a[axis] / 3.0 + b[axis] / 3.0 + c[axis] / 3.0)
}

impl Survey {
    fn add(&mut self, piece: &Mesh) {
        self.triangles += piece.triangles.len() as u64;
        let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
        for position in &piece.positions {
            for axis in 0..3 {
                low[axis] = low[axis].min(position[axis]);
                high[axis] = high[axis].max(position[axis]);
            }
        }
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(low[axis] as f64);
            self.high[axis] = self.high[axis].max(high[axis] as f64);
        }
        for uv in piece.uvs.iter().flatten() {
            for axis in 0..2 {
                self.uv_low[axis] = self.uv_low[axis].min(uv[axis] as f64);
                self.uv_high[axis] = self.uv_high[axis].max(uv[axis] as f64);
            }
        }
        self.flat = self.flat && is_flat(piece);
    }
}

/// Whether every normal of the piece is its triangle's own; triangles without area have none.
fn is_flat(piece: &Mesh) -> bool {
    let Some(normals) = &piece.normals else {
        return false;
    };
    piece.triangles.iter().all(|corners| {
        let [a, b, c] = corners.map(|index| glam::Vec3::from(normals[index as usize]));
        if a.dot(b) < FLAT_COSINE || a.dot(c) < FLAT_COSINE {
            return false;
        }
        let [p, q, r] =
            corners.map(|index| glam::DVec3::from(piece.positions[index as usize].map(f64::from)));
        let own = (q - p).cross(r - p);
        let length = own.length();
        length == 0.0 || own.dot(a.as_dvec3()) >= FLAT_COSINE as f64 * length
    })
}

/// Every 2^n-th triangle, n as small as the room allows: the same whatever the pieces.
#[derive(Default)]
struct Samples {
    taken: Vec<[[f32; 3]; 3]>,
    seen: u64,
    shift: u32,
}

impl Samples {
    fn add(&mut self, piece: &Mesh) {
        let mut index = self.seen.next_multiple_of(1 << self.shift) - self.seen;
        while (index as usize) < piece.triangles.len() {
            let corners = piece.triangles[index as usize];
            self.taken
                .push(corners.map(|index| piece.positions[index as usize]));
            if self.taken.len() == MOST_SAMPLES {
                let mut place = 0;
                self.taken.retain(|_| {
                    place += 1;
                    place % 2 == 1
                });
                self.shift += 1;
            }
            let after = self.seen + index + 1;
            index = after.next_multiple_of(1 << self.shift) - self.seen;
        }
        self.seen += piece.triangles.len() as u64;
    }

    fn edges(&self) -> Vec<f64> {
        let stride = self.taken.len().div_ceil(MOST_EDGE_SAMPLES).max(1);
        let mut edges = Vec::new();
        for corners in self.taken.iter().step_by(stride) {
            for side in 0..3 {
                let (a, b) = (corners[side], corners[(side + 1) % 3]);
                let squared: f64 = (0..3)
                    .map(|axis| (a[axis] as f64 - b[axis] as f64).powi(2))
                    .sum();
                if squared > 0.0 {
                    edges.push(squared.sqrt());
                }
            }
        }
        edges.sort_unstable_by(f64::total_cmp);
        edges
    }
}

fn attributes_of(mesh: &Mesh) -> Attributes {
    let has = |present: bool, flag: u32| if present { flag } else { 0 };
    Attributes(
        has(mesh.normals.is_some(), Attributes::NORMAL)
            | has(mesh.uvs.is_some(), Attributes::UV)
            | has(mesh.colors.is_some(), Attributes::COLOR),
    )
}

fn wrong(source: &impl MeshSource, at: String, expected: String, found: String) -> BuildError {
    BuildError::InvalidMesh {
        mesh: source.name().to_owned(),
        at,
        expected,
        found,
    }
}

/// The promises of [`Mesh`], which unchecked foreign code relies on further down.
fn check(mesh: &Mesh, source: &impl MeshSource) -> Result<(), BuildError> {
    let vertices = mesh.positions.len();
    let lengths = [
        ("normals", mesh.normals.as_ref().map(Vec::len), vertices),
        ("uvs", mesh.uvs.as_ref().map(Vec::len), vertices),
        ("colors", mesh.colors.as_ref().map(Vec::len), vertices),
        (
            "triangle materials",
            Some(mesh.triangle_materials.len()),
            mesh.triangles.len(),
        ),
    ];
    for (name, length, expected) in lengths {
        if let Some(found) = length.filter(|&length| length != expected) {
            return Err(wrong(
                source,
                name.into(),
                expected.to_string(),
                found.to_string(),
            ));
        }
    }
    let inside = |corners: &[u32; 3]| corners.iter().all(|&index| (index as usize) < vertices);
    if let Some(triangle) = mesh.triangles.iter().position(|corners| !inside(corners)) {
        let found = format!("{:?}", mesh.triangles[triangle]);
        let at = format!("triangle {triangle}");
        return Err(wrong(
            source,
            at,
            format!("indices below {vertices}"),
            found,
        ));
    }
    let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    if let Some(index) = mesh.positions.iter().position(|position| !finite(position)) {
        let found = format!("{:?}", mesh.positions[index]);
        let at = format!("position {index}");
        return Err(wrong(source, at, "finite numbers".into(), found));
    }
    let uvs = mesh.uvs.as_deref().unwrap_or(&[]);
    if let Some(index) = uvs.iter().position(|uv| !finite(uv)) {
        let found = format!("{:?}", uvs[index]);
        return Err(wrong(
            source,
            format!("uv {index}"),
            "finite numbers".into(),
            found,
        ));
    }
    let slots = source.material_slot_count().max(1);
    let materials = &mesh.triangle_materials;
    if let Some(triangle) = materials.iter().position(|&slot| slot as usize >= slots) {
        let found = materials[triangle].to_string();
        let at = format!("material of triangle {triangle}");
        return Err(wrong(source, at, format!("below {slots}"), found));
    }
    Ok(())
}

//! Lattices: one position step for meshes that share vertices.

use std::collections::{BTreeSet, HashMap};

use glam::{DAffine3, DMat3};

use super::{IngestError, MergedMesh, Options, Placed, Sharing};
use crate::build::{self, MOST_EXTENT_STEPS};

/// Steps that a mesh spans at least where it shares vertices that no common lattice keeps equal:
/// they part by less than f32 rounds the place of a vertex in the picture.
const ODD_EXTENT_STEPS: f64 = (1 << 20) as f64;
/// Relative difference of linear parts and scales that counts as none.
const SAME: f64 = 1e-9;
/// Part of a step by which an offset may miss the lattice, beside the rounding of the offset.
const WHOLE: f64 = 1e-6;

/// Exponents of the steps of the meshes that share vertices.
pub(super) fn exponents(
    meshes: &[&MergedMesh],
    extents: &[f64],
    placed: &[Placed],
    sharing: &Sharing,
    options: &Options,
) -> Result<HashMap<usize, i32>, IngestError> {
    if sharing.pairs.is_empty() || !options.steps_are_free {
        return Ok(HashMap::new());
    }
    let mesh_of = |instance: u32| placed[instance as usize].mesh;
    let involved: BTreeSet<usize> = sharing
        .pairs
        .iter()
        .flatten()
        .map(|&instance| mesh_of(instance))
        .collect();
    let mut exponents: HashMap<usize, i32> = HashMap::new();
    for &mesh in &involved {
        let MergedMesh {
            file, mesh: own, ..
        } = meshes[mesh];
        let usual = build::usual_step_exponent(own).map_err(|error| IngestError::Build {
            file: file.to_path_buf(),
            error,
        });
        exponents.insert(mesh, usual?);
    }
    let finest = |mesh: usize| (extents[mesh] / MOST_EXTENT_STEPS).log2().ceil() as i32;
    let links: BTreeSet<[usize; 2]> = sharing
        .pairs
        .iter()
        .filter(|pair| same_scale(placed, **pair))
        .map(|&[a, b]| [mesh_of(a), mesh_of(b)])
        .filter(|[a, b]| a != b)
        .collect();
    unify(&links, &mut exponents, finest);
    let mut odd = false;
    for &pair in &sharing.pairs {
        let [a, b] = pair.map(mesh_of);
        let step = exponents[&a].max(exponents[&b]);
        if is_whole(placed, pair, 2f64.powi(step)) {
            continue;
        }
        odd = true;
        for mesh in [a, b] {
            let least = (extents[mesh] / ODD_EXTENT_STEPS).log2().floor() as i32;
            exponents.entry(mesh).and_modify(|it| *it = least.min(*it));
        }
    }
    if odd {
        unify(&links, &mut exponents, finest);
    }
    Ok(exponents)
}

/// Gives the smallest exponent of each connected part to all of it, as far as a mesh can span it.
fn unify(
    links: &BTreeSet<[usize; 2]>,
    exponents: &mut HashMap<usize, i32>,
    finest: impl Fn(usize) -> i32,
) {
    let mut parent: HashMap<usize, usize> = exponents.keys().map(|&mesh| (mesh, mesh)).collect();
    fn root(parent: &mut HashMap<usize, usize>, mesh: usize) -> usize {
        let mut at = mesh;
        while parent[&at] != at {
            let above = parent[&parent[&at]];
            parent.insert(at, above);
            at = above;
        }
        at
    }
    for &[a, b] in links {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent.insert(a.max(b), a.min(b));
    }
    let mut smallest: HashMap<usize, i32> = HashMap::new();
    let meshes: BTreeSet<usize> = exponents.keys().copied().collect();
    for &mesh in &meshes {
        let least = smallest.entry(root(&mut parent, mesh)).or_insert(i32::MAX);
        *least = exponents[&mesh].min(*least);
    }
    for &mesh in &meshes {
        let least = smallest[&root(&mut parent, mesh)];
        exponents.insert(mesh, least.max(finest(mesh)));
    }
}

/// Whether both instances show a metre equally long.
fn same_scale(placed: &[Placed], [a, b]: [u32; 2]) -> bool {
    let scale = |instance: u32| {
        let linear = placed[instance as usize].world_from_object.matrix3;
        linear.determinant().abs().cbrt()
    };
    let (a, b) = (scale(a), scale(b));
    (a - b).abs() <= SAME * a.max(b)
}

/// Whether the lattices of both instances are one: equal linear parts up to turns that map the
/// axes onto each other, and an offset of whole steps.
fn is_whole(placed: &[Placed], [a, b]: [u32; 2], step_metres: f64) -> bool {
    let [a, b] = [a, b].map(|instance| &placed[instance as usize]);
    // Of b's object space in a's.
    let DAffine3 {
        matrix3,
        translation,
    } = a.object_from_world * b.world_from_object;
    let is_turn = |linear: DMat3| {
        let values = linear.to_cols_array();
        let near = |value: f64| (value.abs() - value.abs().round()).abs() <= SAME;
        let ones = values.iter().filter(|value| value.abs() > 0.5).count();
        values.into_iter().all(near) && ones == 3
    };
    let far = a.world_from_object.translation.abs().max_element();
    let rounding = 8.0 * f64::EPSILON * far / step_metres;
    let whole = |value: f64| (value - value.round()).abs() <= WHOLE + rounding;
    let steps = translation / step_metres;
    is_turn(matrix3) && steps.is_finite() && steps.to_array().into_iter().all(whole)
}

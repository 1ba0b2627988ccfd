//! A group's triangles to half as many, its border locked.
//!
//! Each attempt is checked afterwards: a result whose boundary chain differs is thrown away, so no fault or
//! freedom of a simplifier can open a crack.

use lodestream_format::cluster::Attributes;
use lodestream_format::octahedral;

use super::boundary::{Chain, OpenEdges, chain};
use super::local::LocalMesh;
use super::measure;
use super::merge::merge;
use super::meshopt_seam::{self, SimplifyInput, VertexRule};
use super::quantize::{QuantizedMesh, Triangle};
use super::seams::Seams;

/// A result with more of the triangles left is not worth a level.
const MOST_LEFT: f64 = 0.85;
/// A result with at most this share of the triangles left needs no freer attempt.
const GOOD_ENOUGH: f64 = 0.6;
/// Share of the group's extent that a normal turned by one radian counts for.
const NORMAL_WEIGHT: f32 = 0.5;
/// Share of a texture's slide over the surface that counts as error.
const UV_WEIGHT: f32 = 0.5;
/// Share of the group's extent that a full step of one colour channel counts for.
const COLOR_WEIGHT: f32 = 0.25;

/// What a group may not touch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Locks<'a> {
    /// Places that another group shares.
    pub shared: &'a [bool],
    /// Open edges of the surface.
    pub open: &'a OpenEdges,
    /// Whether open edges may move. Never so unless nothing else gets further.
    pub release_open_edges: bool,
    /// Places where attributes or materials jump.
    pub seams: &'a Seams,
}

/// A group's replacement.
#[derive(Debug)]
pub(super) struct Simplified {
    pub triangles: Vec<Triangle>,
    /// Distance between the old and the new surface, metres.
    pub distance_metres: f64,
    /// The simplifier's own error, metres, attributes weighed in.
    pub weighed_error_metres: f64,
    /// Whether open edges moved.
    pub open_edges_moved: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Attempt {
    /// Edge collapses; seams of texture coordinates and materials stay seams.
    KeepSeams,
    /// Edge collapses that may cross texture seams; small loose parts may vanish.
    CrossSeams,
    /// Vertex clustering.
    Merge,
}

/// Halves `triangles`, or gives `None` where nothing allowed removes enough. `floor_metres` is an error that does
/// not matter, since the group's clusters have more already.
pub(super) fn simplify(
    mesh: &QuantizedMesh,
    triangles: &[Triangle],
    locks: Locks,
    floor_metres: f64,
) -> Option<Simplified> {
    let local = LocalMesh::new(mesh, triangles);
    let places: Vec<u32> = local
        .vertices
        .iter()
        .map(|&vertex| mesh.place_of[vertex as usize])
        .collect();
    let at = |corners: &[u32; 3]| corners.map(|vertex| places[vertex as usize]);
    let before = chain(local.triangles.iter().map(at));
    let left = |share: f64| (triangles.len() as f64 * share) as usize;

    let mut best: Option<(Vec<[u32; 3]>, f64, bool)> = None;
    for attempt in [Attempt::KeepSeams, Attempt::CrossSeams, Attempt::Merge] {
        let fewest = best
            .as_ref()
            .map_or(left(MOST_LEFT) + 1, |(kept, ..)| kept.len());
        let enough = if attempt == Attempt::Merge {
            left(MOST_LEFT)
        } else {
            left(GOOD_ENOUGH)
        };
        if fewest <= enough {
            break;
        }
        let (result, error) = run(attempt, mesh, &local, &places, locks, triangles.len() / 2);
        if result.is_empty() || result.len() >= fewest {
            continue;
        }
        if let Some(moved) = verdict(&before, &chain(result.iter().map(at)), locks) {
            best = Some((result, error, moved));
        }
    }
    let (result, error, open_edges_moved) = best?;
    // What is wrong with a triangle's normal or texture is wrong over that triangle and no farther: it cannot be seen
    // from where the triangle is smaller than the error allowed.
    let attributes = error.min(typical_edge(&local, &result));
    let weighed_error_metres =
        attributes.max(material_error(&local, &result)) * local.metres_per_unit;
    let floor = (weighed_error_metres - floor_metres).max(0.0) / local.metres_per_unit;
    let distance = measure::distance(&local.positions, &local.triangles, &result, floor);
    Some(Simplified {
        triangles: local.to_whole(&result),
        distance_metres: distance * local.metres_per_unit,
        weighed_error_metres,
        open_edges_moved,
    })
}

/// How far a material's surface moved, in the group's units, but no farther than its triangles are large: a stripe on a
/// road lies on the road when it is gone, and yet its colour is missed, over the stripe.
fn material_error(local: &LocalMesh, result: &[[u32; 3]]) -> f64 {
    let mut slots = local.materials.clone();
    slots.sort_unstable();
    slots.dedup();
    if slots.len() < 2 {
        return 0.0;
    }
    let of = |triangles: &[[u32; 3]], slot: u16| -> Vec<[u32; 3]> {
        let own = |corners: &&[u32; 3]| local.materials[corners[0] as usize] == slot;
        triangles.iter().filter(own).copied().collect()
    };
    let moved = |slot: u16| {
        let (before, after) = (of(&local.triangles, slot), of(result, slot));
        let size = typical_edge(local, &before).max(typical_edge(local, &after));
        match before.is_empty() || after.is_empty() {
            true => size,
            false => measure::distance(&local.positions, &before, &after, 0.0).min(size),
        }
    };
    slots.into_iter().map(moved).fold(0.0, f64::max)
}

/// Root of the mean square of the edges of `triangles`, in the group's units.
fn typical_edge(local: &LocalMesh, triangles: &[[u32; 3]]) -> f64 {
    let at = |vertex: u32| glam::DVec3::from(local.positions[vertex as usize].map(f64::from));
    let squares = triangles.iter().flat_map(|&[a, b, c]| {
        [(a, b), (b, c), (c, a)].map(|(from, to)| at(from).distance_squared(at(to)))
    });
    let mean = squares.sum::<f64>() / (3 * triangles.len()).max(1) as f64;
    mean.sqrt()
}

/// Whether the new boundary may replace the old one: `Some(whether open edges moved)`, `None` if not.
fn verdict(before: &Chain, after: &Chain, locks: Locks) -> Option<bool> {
    if before == after {
        return Some(false);
    }
    (locks.release_open_edges && locks.open.only_open_edges_moved(before, after)).then_some(true)
}

fn run(
    attempt: Attempt,
    mesh: &QuantizedMesh,
    local: &LocalMesh,
    places: &[u32],
    locks: Locks,
    target: usize,
) -> (Vec<[u32; 3]>, f64) {
    let target = target.max(1);
    let locked = |place: u32| {
        locks.shared[place as usize]
            || !locks.release_open_edges && locks.open.on_open_edge[place as usize]
    };
    if attempt == Attempt::Merge {
        let fixed: Vec<bool> = places
            .iter()
            .map(|&place| locked(place) || locks.seams.material[place as usize])
            .collect();
        // It knows nothing of attributes: all of them may be wrong, over a triangle each.
        return (merge(local, places, &fixed, target), f64::INFINITY);
    }
    let keep_uv = attempt == Attempt::KeepSeams;
    let rules: Vec<VertexRule> = places
        .iter()
        .map(|&place| {
            if locked(place) {
                VertexRule::Lock
            } else if locks.seams.material[place as usize]
                || keep_uv && locks.seams.uv[place as usize]
            {
                VertexRule::KeepSeam
            } else {
                VertexRule::Free
            }
        })
        .collect();
    let (attributes, weights) = attributes(mesh, local);
    let input = SimplifyInput {
        positions: &local.positions,
        attributes: &attributes,
        weights: &weights,
        rules: &rules,
        triangles: &local.triangles,
    };
    meshopt_seam::simplify(&input, target, attempt == Attempt::CrossSeams)
}

/// Attributes of every local vertex and their weights.
fn attributes(mesh: &QuantizedMesh, local: &LocalMesh) -> (Vec<f32>, Vec<f32>) {
    let has = |flag| mesh.attributes.has(flag);
    let mut weights = Vec::new();
    if has(Attributes::NORMAL) {
        weights.extend([NORMAL_WEIGHT; 3]);
    }
    let vertices = || {
        local
            .vertices
            .iter()
            .map(|&vertex| &mesh.vertices[vertex as usize])
    };
    let mut uv_base = [0; 2];
    if has(Attributes::UV) {
        uv_base =
            std::array::from_fn(|axis| vertices().map(|vertex| vertex.uv[axis]).min().unwrap_or(0));
        weights.extend([UV_WEIGHT * extents_per_uv_step(mesh, local); 2]);
    }
    if has(Attributes::COLOR) {
        weights.extend([COLOR_WEIGHT / 255.0; 4]);
    }
    let mut attributes = Vec::with_capacity(local.vertices.len() * weights.len());
    for vertex in vertices() {
        if has(Attributes::NORMAL) {
            attributes.extend(octahedral::decode(vertex.normal));
        }
        if has(Attributes::UV) {
            attributes.extend([0, 1].map(|axis| (vertex.uv[axis] - uv_base[axis]) as f32));
        }
        if has(Attributes::COLOR) {
            attributes.extend(vertex.color.map(f32::from));
        }
    }
    (attributes, weights)
}

/// Length on the surface, in extents of the group, that a step of the texture grid stands for on average. 0 where the
/// texture coordinates span no area.
fn extents_per_uv_step(mesh: &QuantizedMesh, local: &LocalMesh) -> f32 {
    let (mut surface, mut texture) = (0.0, 0.0);
    let mut bounds = ([f32::MAX; 3], [f32::MIN; 3]);
    for corners in &local.triangles {
        let [a, b, c] = corners.map(|vertex| local.positions[vertex as usize].map(f64::from));
        let side = |to: [f64; 3]| glam::DVec3::from(to) - glam::DVec3::from(a);
        surface += side(b).cross(side(c)).length();
        let [a, b, c] = corners.map(|vertex| {
            mesh.vertices[local.vertices[vertex as usize] as usize]
                .uv
                .map(f64::from)
        });
        let side = |to: [f64; 2]| glam::DVec2::from(to) - glam::DVec2::from(a);
        texture += side(b).perp_dot(side(c)).abs();
    }
    for position in &local.positions {
        for axis in 0..3 {
            bounds.0[axis] = bounds.0[axis].min(position[axis]);
            bounds.1[axis] = bounds.1[axis].max(position[axis]);
        }
    }
    let extent = (0..3)
        .map(|axis| bounds.1[axis] - bounds.0[axis])
        .fold(0.0, f32::max);
    if texture > 0.0 && extent > 0.0 {
        ((surface / texture).sqrt() / extent as f64) as f32
    } else {
        0.0
    }
}

//! Placement: what is left after the collapses moves to where its quadric is least, attributes and all.

use super::super::borders::FREE;
use super::super::vertex::Grids;
use super::collapse::{Collapser, flips};
use super::group::{GroupMesh, Weights};
use super::quadric::{Quadric, dot, sub};

/// Share of the mean of the diagonal that holds a place where the surface is flat or straight.
const HOLD: f32 = 1e-3;
/// A place moves no farther than this share of its shortest edge.
const FARTHEST: f32 = 0.5;

/// Share of the places that something collapsed onto that move: those that gain most. What stays is a vertex of the
/// finer level too and need not be stored again. Half of them give nine tenths of what all give.
const MOVED: f64 = 0.5;

/// A place that may move.
struct Candidate {
    place: u16,
    /// By how much its quadric is less there.
    gain: f32,
    offset: [f32; 3],
}

/// Moves places that something collapsed onto, where it gains most; seams, open edges and locked places stay.
pub(super) fn place<const L: usize>(
    state: &mut Collapser<L>,
    mesh: &mut GroupMesh,
    grids: &Grids,
    weights: &Weights,
) {
    let uv_base = mesh.uv_base();
    let mut star: Vec<[[f32; 3]; 2]> = Vec::new();
    for Candidate { place, offset, .. } in worth_most(candidates(state, mesh)) {
        let vertex = mesh.welder.first_vertex(place as u32) as usize;
        let at = mesh.positions[place as usize];
        star.clear();
        star.extend(state.star(place).map(|(triangle, k)| {
            let vertices = state.corners[triangle];
            [1, 2].map(|step| {
                let vertex = vertices[(k + step) % 3] as usize;
                mesh.positions[mesh.welder.place_of[vertex] as usize]
            })
        }));
        let nearest = star.iter().flatten().map(|&other| {
            let side = sub(other, at);
            dot(side, side)
        });
        let most = FARTHEST * nearest.fold(f32::INFINITY, f32::min).sqrt();
        let length = dot(offset, offset).sqrt();
        let share = if length > most { most / length } else { 1.0 };
        let wanted = std::array::from_fn(|axis| at[axis] + share * offset[axis]);
        let q = mesh.on_grid(wanted);
        let moved = mesh.local(q);
        if q == mesh.welder.vertices[vertex].0.position
            || star.iter().any(|&others| flips(at, moved, others))
        {
            continue;
        }
        if L > 0 {
            let change = state.attribute_quadrics[vertex].best_change(sub(moved, at));
            let own = &mut state.attributes[vertex];
            (0..L).for_each(|k| own[k] += change[k]);
            let value = *own;
            mesh.set_attributes(grids, weights, uv_base, vertex, &value);
        }
        mesh.welder.vertices[vertex].0.position = q;
        mesh.positions[place as usize] = moved;
    }
}

fn candidates<const L: usize>(state: &Collapser<L>, mesh: &GroupMesh) -> Vec<Candidate> {
    let candidate = |place: usize| {
        let vertex = mesh.welder.first_vertex(place as u32) as usize;
        let alone = state.ring[vertex] as usize == vertex && state.uses[vertex] > 0;
        if !alone || mesh.rules[place] != FREE || !state.has_taken(place as u16) {
            return None;
        }
        let mut quadric = state.quadrics[place];
        if L > 0 {
            quadric.add(&state.attribute_quadrics[vertex].following());
        }
        let offset = least(&quadric)?;
        Some(Candidate {
            place: place as u16,
            gain: quadric.at([0.0; 3]) - quadric.at(offset),
            offset,
        })
    };
    (0..mesh.positions.len()).filter_map(candidate).collect()
}

/// The [`MOVED`] share of the candidates with the largest gains, by place.
fn worth_most(mut candidates: Vec<Candidate>) -> Vec<Candidate> {
    candidates.sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain).then(a.place.cmp(&b.place)));
    candidates.truncate((candidates.len() as f64 * MOVED).ceil() as usize);
    candidates.sort_unstable_by_key(|candidate| candidate.place);
    candidates
}

/// Where a quadric is least, held a little at its own point; `None` where it says nothing.
fn least(quadric: &Quadric) -> Option<[f32; 3]> {
    let [xx, yy, zz, xy, xz, yz] = quadric.matrix().map(f64::from);
    let hold = HOLD as f64 * (xx + yy + zz) / 3.0;
    let (xx, yy, zz) = (xx + hold, yy + hold, zz + hold);
    // Adjugate over determinant, in f64: the matrix may be nearly singular.
    let cofactors = [
        yy * zz - yz * yz,
        xz * yz - xy * zz,
        xy * yz - xz * yy,
        xx * zz - xz * xz,
        xy * xz - xx * yz,
        xx * yy - xy * xy,
    ];
    let determinant = xx * cofactors[0] + xy * cofactors[1] + xz * cofactors[2];
    if determinant.is_nan() || determinant <= 0.0 {
        return None;
    }
    let [x, y, z] = quadric.linear().map(|value| -(value as f64) / determinant);
    let offset = [
        cofactors[0] * x + cofactors[1] * y + cofactors[2] * z,
        cofactors[1] * x + cofactors[3] * y + cofactors[4] * z,
        cofactors[2] * x + cofactors[4] * y + cofactors[5] * z,
    ]
    .map(|value| value as f32);
    offset
        .iter()
        .all(|value| value.is_finite())
        .then_some(offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_in_a_point_and_one_plane_holds() {
        let mut corner = Quadric::default();
        for axis in 0..3 {
            let mut normal = [0.0; 3];
            normal[axis] = 1.0;
            let through = [0.25, -0.5, 0.125];
            // A plane through `through`, seen from the origin.
            corner.add(&Quadric::plane(normal, 1.0).moved(through.map(|value| -value)));
        }
        let [x, y, z] = least(&corner).expect("regular");
        assert!((x - 0.25).abs() < 1e-2 && (y + 0.5).abs() < 1e-2 && (z - 0.125).abs() < 1e-2);
        let plane = Quadric::plane([0.0, 0.0, 1.0], 1.0).moved([0.0, 0.0, -0.5]);
        let [x, y, z] = least(&plane).expect("held");
        assert!(x.abs() < 1e-6 && y.abs() < 1e-6 && (z - 0.5).abs() < 1e-2);
        assert_eq!(least(&Quadric::default()), None);
    }
}

//! Materials: how far their outlines have moved and how large the lost ones were, which no distance
//! between surfaces says.

use std::collections::HashMap;

use foldhash::fast::RandomState;

use super::group::GroupMesh;
use super::nearest::{middle, to_segment};
use super::quadric::{cross, dot, sub};

/// An edge at the outline of a material, with its slot.
type Edge = (u16, [[f32; 3]; 2]);

/// Farthest distance between the outlines of the materials of a group over `origins` and those of
/// `after`, both ways at ends and middles, units, but at most `size`: a wrong material is wrong
/// over a triangle and no farther. 0 where there is one material.
pub(super) fn outlines_moved(
    mesh: &GroupMesh,
    origins: &[[f32; 3]],
    after: &[[u16; 3]],
    size: f32,
) -> f32 {
    let slots = mesh.welder.vertices.iter().map(|vertex| vertex.1);
    let first = slots.clone().next();
    if slots.clone().all(|slot| Some(slot) == first) {
        return 0.0;
    }
    let old = outlines(mesh, &mesh.gathered, origins);
    let new = outlines(mesh, after, &mesh.positions);
    let by_slot = |a: &Edge, b: &Edge| a.0 == b.0;
    let slot_of = |corners: &[u16; 3]| mesh.welder.vertices[corners[0] as usize].1;
    let is_left = |slot: u16| after.iter().any(|corners| slot_of(corners) == slot);
    let mut worst = 0.0f32;
    for [from, to] in [[&old, &new], [&new, &old]] {
        for own in from.chunk_by(by_slot) {
            let slot = own[0].0;
            let first = to.partition_point(|edge| edge.0 < slot);
            let end = to.partition_point(|edge| edge.0 <= slot);
            // A material that is gone is charged by `lost`.
            if first < end || is_left(slot) {
                worst = worst.max(farthest(own, &to[first..end], size));
            }
        }
    }
    worst
}

/// The size of what is gone of a material that no triangle of `after` has: a stripe on a road lies on the road when it is
/// gone, and yet its colour is missed, over the stripe. The root of its area over `origins`, units.
pub(super) fn lost(mesh: &GroupMesh, origins: &[[f32; 3]], after: &[[u16; 3]]) -> f32 {
    let slot = |corners: &[u16; 3]| mesh.welder.vertices[corners[0] as usize].1;
    let mut slots: Vec<u16> = after.iter().map(slot).collect();
    slots.sort_unstable();
    slots.dedup();
    let mut areas: Vec<(u16, f32)> = Vec::new();
    for corners in &mesh.gathered {
        let own = slot(corners);
        if slots.binary_search(&own).is_ok() {
            continue;
        }
        let [a, b, c] = mesh.places(*corners).map(|place| origins[place]);
        let across = cross(sub(b, a), sub(c, a));
        let area = 0.5 * dot(across, across).sqrt();
        match areas.iter_mut().find(|(slot, _)| *slot == own) {
            Some((_, sum)) => *sum += area,
            None => areas.push((own, area)),
        }
    }
    areas
        .iter()
        .fold(0.0, |most: f32, &(_, area)| most.max(area.sqrt()))
}

/// Edges where the triangles of a material along and against them do not balance, by slot.
fn outlines(mesh: &GroupMesh, triangles: &[[u16; 3]], positions: &[[f32; 3]]) -> Vec<Edge> {
    let mut balances: HashMap<(u16, usize, usize), i32, RandomState> = HashMap::default();
    for &triangle in triangles {
        let slot = mesh.welder.vertices[triangle[0] as usize].1;
        let places = mesh.places(triangle);
        for side in 0..3 {
            let (a, b) = (places[side], places[(side + 1) % 3]);
            let turn = if a < b { 1 } else { -1 };
            *balances.entry((slot, a.min(b), a.max(b))).or_default() += turn;
        }
    }
    balances.retain(|_, balance| *balance != 0);
    let mut edges: Vec<(u16, usize, usize)> = balances.into_keys().collect();
    edges.sort_unstable();
    let segment = |(slot, a, b): (u16, usize, usize)| (slot, [positions[a], positions[b]]);
    edges.into_iter().map(segment).collect()
}

fn farthest(from: &[Edge], to: &[Edge], size: f32) -> f32 {
    let most = size * size;
    let mut worst = 0.0f32;
    // Edges that follow each other are near the same ones.
    let mut first = 0;
    for &(_, [a, b]) in from {
        for at in [a, middle(a, b)] {
            let (start, mut least) = (first, most);
            for turn in 0..to.len() {
                let number = (start + turn) % to.len();
                let (_, [from, to]) = to[number];
                let squared = to_segment(at, from, to);
                if squared < least {
                    (least, first) = (squared, number);
                }
                if least <= worst {
                    break;
                }
            }
            worst = worst.max(least);
        }
        if worst >= most {
            return size;
        }
    }
    worst.sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::super::vertex::Vertex;
    use super::*;

    #[test]
    fn an_outline_is_where_a_material_ends() {
        let mut mesh = GroupMesh::default();
        mesh.welder.clear(8);
        // A strip of three squares of two triangles, the last one of another material.
        let mut number = |x: i32, y: i32, slot: u16| {
            let vertex = Vertex {
                position: [8 * x, 8 * y, 0],
                ..Vertex::default()
            };
            mesh.welder.number(&vertex, slot) as u16
        };
        for (x, slot) in [(0, 0), (1, 0), (2, 1)] {
            let corners = [(x, 0), (x + 1, 0), (x + 1, 1), (x, 1)];
            let [a, b, c, d] = corners.map(|(x, y)| number(x, y, slot));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
        mesh.place_positions();
        let found = outlines(&mesh, &mesh.triangles, &mesh.positions);
        let of_slot = |slot: u16| found.iter().filter(move |edge| edge.0 == slot);
        // Round two squares and round one, without the diagonals and the edge between the two.
        assert_eq!([of_slot(0).count(), of_slot(1).count()], [6, 4]);
        let ends = [[16, 0, 0], [16, 8, 0]].map(|at| mesh.local(at));
        for slot in [0, 1] {
            let between = |edge: &&Edge| edge.1.iter().all(|end| ends.contains(end));
            assert_eq!(of_slot(slot).filter(between).count(), 1, "material {slot}");
        }
    }
}

//! Materials: how far the borders between them have moved, and what is gone of them, which no distance between surfaces tells.

use std::collections::HashMap;

use foldhash::fast::RandomState;

use super::group::GroupMesh;
use super::nearest::{middle, to_segment};
use super::quadric::{cross, dot, sub};

type Segment = [[f32; 3]; 2];

/// Farthest distance between the borders of the group's triangles over `origins` and those of `after`, both ways at ends and
/// middles, units, but at most `size`: what is wrong with a triangle's material is wrong over that triangle and no farther.
/// 0 where there is one material.
pub(super) fn borders_moved(
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
    let old = borders(mesh, &mesh.triangles, origins);
    let new = borders(mesh, after, &mesh.positions);
    farthest(&old, &new, size).max(farthest(&new, &old, size))
}

/// The size of what is gone of a material that no triangle of `after` has: a stripe on a road lies on the road when it is
/// gone, and yet its colour is missed, over the stripe. The root of its area over `origins`, units.
pub(super) fn lost(mesh: &GroupMesh, origins: &[[f32; 3]], after: &[[u16; 3]]) -> f32 {
    let slot = |corners: &[u16; 3]| mesh.welder.vertices[corners[0] as usize].1;
    let mut slots: Vec<u16> = after.iter().map(slot).collect();
    slots.sort_unstable();
    slots.dedup();
    let mut areas: Vec<(u16, f32)> = Vec::new();
    for corners in &mesh.triangles {
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

/// Edges with different materials on their sides.
fn borders(mesh: &GroupMesh, triangles: &[[u16; 3]], positions: &[[f32; 3]]) -> Vec<Segment> {
    let several = places_of_several(mesh);
    let mut sides: HashMap<(usize, usize), (u16, bool), RandomState> = HashMap::default();
    for &triangle in triangles {
        let slot = mesh.welder.vertices[triangle[0] as usize].1;
        let places = mesh.places(triangle);
        for side in 0..3 {
            let (a, b) = (places[side], places[(side + 1) % 3]);
            if !several[a] || !several[b] {
                continue;
            }
            sides
                .entry((a.min(b), a.max(b)))
                .and_modify(|known| known.1 = known.0 != slot)
                .or_insert((slot, false));
        }
    }
    let mut borders: Vec<(usize, usize)> = sides
        .into_iter()
        .filter(|&(_, (_, border))| border)
        .map(|(edge, _)| edge)
        .collect();
    borders.sort_unstable();
    let segments = borders
        .into_iter()
        .map(|(a, b)| [positions[a], positions[b]]);
    segments.collect()
}

/// Whether each place has vertices of several materials, as both ends of a border have.
fn places_of_several(mesh: &GroupMesh) -> Vec<bool> {
    let mut first = vec![None; mesh.positions.len()];
    let mut several = vec![false; mesh.positions.len()];
    for (&(_, slot), &place) in mesh.welder.vertices.iter().zip(&mesh.welder.place_of) {
        several[place as usize] |= *first[place as usize].get_or_insert(slot) != slot;
    }
    several
}

fn farthest(from: &[Segment], to: &[Segment], size: f32) -> f32 {
    let most = size * size;
    let mut worst = 0.0f32;
    for &[a, b] in from {
        for at in [a, middle(a, b)] {
            let mut least = most;
            for &[from, to] in to {
                least = least.min(to_segment(at, from, to));
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
    fn a_border_is_an_edge_with_two_materials_and_no_other() {
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
        let found = borders(&mesh, &mesh.triangles, &mesh.positions);
        let place = |at: [i32; 3]| {
            let vertices = mesh.welder.vertices.iter();
            let number = vertices.zip(&mesh.welder.place_of);
            let own = number.filter(|((vertex, _), _)| vertex.position == at);
            own.map(|(_, &place)| place as usize).next()
        };
        let ends = [[16, 0, 0], [16, 8, 0]].map(|at| place(at).expect("a corner"));
        assert_eq!(found, [ends.map(|place| mesh.positions[place])]);
        assert_eq!(
            borders(&mesh, &mesh.triangles[..4], &mesh.positions),
            [[[0.0; 3]; 2]; 0]
        );
    }
}

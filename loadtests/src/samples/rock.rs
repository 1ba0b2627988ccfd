//! A fractal rock: a sphere of quads pushed by layered noise; one closed surface.

use std::collections::HashMap;

use glam::DVec3;

use super::Glb;
use super::glb::{Material, Node, Scene};
use super::noise::{fractal, noise, ridged};
use super::number::{lerp, rgb, smoothstep};
use super::surface::{Model, Surface};

/// Metres from the rock's middle to its mean surface.
const RADIUS_METRES: f64 = 8.0;

/// A closed fractal rock of about `triangles` triangles (12 n², the nearest), with normals and vertex colours
/// and without texture coordinates.
///
/// The same arguments give the same bytes on every machine.
pub fn rock(triangles: u32, seed: u64) -> Glb {
    let mut model = Model::new("rock", false, true);
    *model.part(0, [1.0; 3]) = sculpt(triangles, seed, RADIUS_METRES);
    Scene {
        title: format!("fractal rock, seed {seed}"),
        materials: vec![Material {
            name: "stone",
            base_colour: [1.0; 3],
            roughness: 0.9,
            metallic: 0.0,
            texture: None,
            double_sided: false,
        }],
        textures: Vec::new(),
        models: vec![model],
        nodes: vec![Node {
            name: Some("rock".into()),
            mesh: Some(0),
            ..Node::default()
        }],
    }
    .finish()
}

/// The rock's surface about the origin.
pub(super) fn sculpt(triangles: u32, seed: u64, radius_metres: f64) -> Surface {
    let edge = ((f64::from(triangles) / 12.0).sqrt().round() as i32).max(2);
    let (lattice, quads) = cube(edge);
    let seed = (seed ^ seed >> 32) as u32;
    let shaped: Vec<(DVec3, f64)> = lattice
        .iter()
        .map(|&p| displace(on_sphere(p, edge), seed))
        .collect();

    let mut surface = Surface::default();
    for &(at, _) in &shaped {
        surface.vertex(at * radius_metres, DVec3::Y, DVec3::Y);
    }
    for [a, b, c, d] in quads {
        // The shorter diagonal follows ridges and crevices better.
        let place = |index: u32| shaped[index as usize].0;
        if place(a).distance_squared(place(c)) <= place(b).distance_squared(place(d)) {
            surface.triangle(a, b, c);
            surface.triangle(a, c, d);
        } else {
            surface.triangle(a, b, d);
            surface.triangle(b, c, d);
        }
    }
    shade(&mut surface, &shaped, seed);
    surface
}

/// The lattice points on a cube's surface, each once, and its quads, counter-clockwise from outside.
fn cube(edge: i32) -> (Vec<[i32; 3]>, Vec<[u32; 4]>) {
    let mut points = Vec::new();
    let mut known: HashMap<[i32; 3], u32> = HashMap::new();
    let mut quads = Vec::new();
    for axis in 0..3 {
        for side in [0, edge] {
            for row in 0..edge {
                for column in 0..edge {
                    let mut quad = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| {
                        let mut at = [0; 3];
                        at[axis] = side;
                        at[(axis + 1) % 3] = column + x;
                        at[(axis + 2) % 3] = row + y;
                        *known.entry(at).or_insert_with(|| {
                            points.push(at);
                            points.len() as u32 - 1
                        })
                    });
                    if side == 0 {
                        quad.reverse();
                    }
                    quads.push(quad);
                }
            }
        }
    }
    (points, quads)
}

/// A lattice point of the cube on the unit sphere, spread evenly.
fn on_sphere(at: [i32; 3], edge: i32) -> DVec3 {
    let [x, y, z] = at.map(|value| f64::from(2 * value - edge) / f64::from(edge));
    let (x2, y2, z2) = (x * x, y * y, z * z);
    let part = |value: f64, a: f64, b: f64| {
        value * (1.0 - a / 2.0 - b / 2.0 + a * b / 3.0).max(0.0).sqrt()
    };
    DVec3::new(part(x, y2, z2), part(y, z2, x2), part(z, x2, y2))
}

/// Where a point of the unit sphere goes, and how deep in a crevice it lies (0 to 1).
fn displace(direction: DVec3, seed: u32) -> (DVec3, f64) {
    let vector = |at: DVec3, s: u32| {
        DVec3::new(
            fractal(at, s, 3),
            fractal(at, s + 71, 3),
            fractal(at, s + 143, 3),
        )
    };
    // Bent space keeps ridges and cracks from running straight.
    let bent = direction + vector(direction * 1.3, seed.wrapping_add(1)) * 0.55;
    let massif = 0.62 * fractal(bent * 0.85, seed.wrapping_add(2), 2);
    let crests = 0.22 * ridged(bent * 1.7, seed.wrapping_add(3), 6);
    let grain = 0.05 * fractal(bent * 9.0, seed.wrapping_add(4), 4);
    // Strata: tilted beds, some harder than others, so that they stand out as ledges.
    let bed =
        (direction.y + 0.25 * direction.x + 0.16 * fractal(bent * 1.6, seed.wrapping_add(5), 3))
            * 7.0;
    let within = bed - bed.floor();
    let ledge = smoothstep(0.0, 0.22, within) * (1.0 - smoothstep(0.72, 1.0, within));
    let hardness = 0.035
        + 0.03
            * noise(
                DVec3::new(bed.floor() * 0.73, 0.5, 0.5),
                seed.wrapping_add(6),
            );
    // Cracks: narrow valleys along the zeros of a noise.
    let crack = 1.0
        - smoothstep(
            0.0,
            0.05,
            fractal(bent * 2.3, seed.wrapping_add(7), 3).abs(),
        );
    let height = 0.9 + massif + crests + grain + hardness * ledge - 0.13 * crack;
    let sideways = vector(direction * 5.0, seed.wrapping_add(8)) * 0.05;
    // Taller than wide, wider than deep.
    (
        (direction * height + sideways) * DVec3::new(1.06, 1.18, 0.92),
        crack,
    )
}

/// Normals from the triangles, colours from bed, slope and cracks.
fn shade(surface: &mut Surface, shaped: &[(DVec3, f64)], seed: u32) {
    let at = |index: u32, surface: &Surface| {
        DVec3::from(surface.positions[index as usize].map(f64::from))
    };
    let mut normals = vec![DVec3::ZERO; shaped.len()];
    for triangle in surface.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|corner| at(triangle[corner], surface));
        for &corner in triangle {
            normals[corner as usize] += (b - a).cross(c - a);
        }
    }
    for (index, (&(place, crack), normal)) in shaped.iter().zip(normals).enumerate() {
        let normal = normal.normalize_or(DVec3::Y);
        surface.normals[index] = normal.as_vec3().to_array();
        let bands = 0.5
            + 0.5
                * noise(
                    DVec3::new(place.y * 9.0 + place.x * 2.0, 0.5, 0.5),
                    seed.wrapping_add(9),
                );
        let blotch = 0.5 + 0.5 * fractal(place * 4.0, seed.wrapping_add(10), 4);
        let light = lerp(0.75, 1.15, blotch) * lerp(1.0, 0.45, crack);
        let ochre = [0.27, 0.19, 0.125];
        let grey = [0.22, 0.215, 0.205];
        // Moss settles where the stone looks up.
        let moss = smoothstep(0.55, 0.85, normal.y + 0.35 * (blotch - 0.5)) * 0.75;
        let green = [0.085, 0.13, 0.03];
        surface.colours[index] = rgb(std::array::from_fn(|channel| {
            lerp(
                lerp(grey[channel], ochre[channel], bands) * light,
                green[channel],
                moss,
            )
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rock_is_one_closed_surface_facing_outward() {
        let surface = sculpt(12_000, 7, RADIUS_METRES);
        let places: std::collections::HashSet<_> = surface
            .positions
            .iter()
            .map(|p| p.map(f32::to_bits))
            .collect();
        assert_eq!(
            places.len(),
            surface.positions.len(),
            "two vertices share a place"
        );
        let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
        let mut volume = 0.0;
        for triangle in surface.indices.chunks_exact(3) {
            for (from, to) in [(0, 1), (1, 2), (2, 0)] {
                *edges.entry((triangle[from], triangle[to])).or_default() += 1;
            }
            let [a, b, c] = [0, 1, 2].map(|corner| {
                DVec3::from(surface.positions[triangle[corner] as usize].map(f64::from))
            });
            volume += a.dot(b.cross(c)) / 6.0;
        }
        for (&(from, to), &count) in &edges {
            assert_eq!(count, 1, "edge {from} {to} runs twice the same way");
            assert_eq!(edges.get(&(to, from)), Some(&1), "edge {from} {to} is open");
        }
        let (vertices, faces) = (surface.positions.len(), surface.indices.len() / 3);
        assert_eq!(
            vertices + faces,
            edges.len() / 2 + 2,
            "not a sphere's topology"
        );
        assert!(volume > 100.0, "inside out, or empty: {volume} m3");
    }

    #[test]
    fn rock_has_the_nearest_count_that_a_cube_divides_into() {
        for (wanted, nearest) in [(0, 48), (12_000, 12_288), (300_000, 299_568)] {
            assert_eq!(rock(wanted, 1).unique_triangles, nearest);
        }
    }

    #[test]
    fn normals_are_of_unit_length_and_colours_vary() {
        let surface = sculpt(12_000, 3, RADIUS_METRES);
        for normal in &surface.normals {
            let length = normal.iter().map(|v| v * v).sum::<f32>().sqrt();
            assert!((length - 1.0).abs() < 1e-4, "{normal:?}");
        }
        let colours: std::collections::HashSet<_> = surface.colours.iter().collect();
        assert!(colours.len() > 100);
    }
}

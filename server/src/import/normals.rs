//! Normals: made where a file has none.
//!
//! Corners meet where positions are bit for bit equal, whatever the vertices between. A corner's normal is the mean of the
//! face normals around that position that lie within the crease angle of its own face, weighted by the angle that each
//! face takes there (Thürmer and Wüthrich, "Computing vertex normals from polygonal facets", 1998): independent of how a flat
//! polygon was cut. A vertex whose corners disagree is split.
//!
//! All in f64 on differences of f32, which are exact or nearly so: no length over- or underflows between 1e-45 and
//! 1e38, slivers have directions, and coordinates of 1e7 lose nothing that the file still had.

use std::collections::HashMap;

use foldhash::fast::RandomState;
use glam::DVec3;
use rayon::prelude::*;

use super::scene::Mesh;

/// Cosine of 40 degrees: sharper edges than this stay sharp.
const CREASE_COS: f64 = 0.766_044_443_118_978;
/// Up to here every face around a position is compared with every other; beyond, by cells of like direction.
const EXACT_VALENCE: usize = 64;
/// Cells along one side of the octahedral map: each 3 to 4 degrees wide.
const CELLS_PER_SIDE: f64 = 32.0;
/// Positions one task handles; fixed, so that the order of new vertices does not hang on the thread count.
const POSITIONS_PER_TASK: usize = 8192;
/// What a corner gets that touches no face with an area.
pub(super) const NO_FACE: [f32; 3] = [0.0, 0.0, 1.0];

/// New vertices, each a copy of an old one with a normal.
#[derive(Default)]
pub(super) struct MadeNormals {
    /// The old vertex of each.
    pub(super) sources: Vec<u32>,
    /// Unit length.
    pub(super) normals: Vec<[f32; 3]>,
}

/// Makes creased normals for `triangles` over `positions` and points the triangles at the new vertices.
///
/// Every new vertex is used. `triangles.len() * 3` must fit in 32 bits.
pub(super) fn make(positions: &[[f32; 3]], triangles: &mut [[u32; 3]]) -> MadeNormals {
    let faces: Vec<[f32; 3]> = triangles
        .par_iter()
        .map(|triangle| face_normal(positions, triangle))
        .collect();
    let fans = Fans::gather(positions, triangles);
    let tasks: Vec<Task> = (0..fans.count())
        .into_par_iter()
        .step_by(POSITIONS_PER_TASK)
        .map(|first| {
            let last = (first + POSITIONS_PER_TASK).min(fans.count());
            Task::run(first..last, &fans, positions, triangles, &faces)
        })
        .collect();

    let mut made = MadeNormals::default();
    let mut corners = fans.corners.iter();
    for task in tasks {
        let base = made.sources.len() as u32;
        for (&vertex, &corner) in task.vertex_of_corner.iter().zip(corners.by_ref()) {
            triangles[corner as usize / 3][corner as usize % 3] = base + vertex;
        }
        made.sources.extend(task.made.sources);
        made.normals.extend(task.made.normals);
    }
    made
}

/// Fills the zero entries of `normals` with the mean over the vertex's own triangles, weighted by angle; gives their number.
pub(super) fn mend(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    normals: &mut [[f32; 3]],
) -> u64 {
    // The sum, and one face in case the sum cancels.
    let mut around: HashMap<u32, (DVec3, DVec3)> = (0..normals.len() as u32)
        .filter(|&vertex| normals[vertex as usize] == [0.0; 3])
        .map(|vertex| (vertex, Default::default()))
        .collect();
    if around.is_empty() {
        return 0;
    }
    for triangle in triangles {
        for corner in 0..3 {
            if let Some((sum, any)) = around.get_mut(&triangle[corner]) {
                let face = DVec3::from(face_normal(positions, triangle).map(f64::from));
                *sum += face * angle(positions, triangle, corner);
                *any = if *any == DVec3::ZERO { face } else { *any };
            }
        }
    }
    let mended = around.len() as u64;
    for (vertex, (sum, any)) in around {
        let normal = if sum == DVec3::ZERO { any } else { sum };
        normals[vertex as usize] = unit(normal);
    }
    mended
}

/// Replaces the vertices, normals apart, by copies of `sources`.
pub(super) fn gather(mesh: &mut Mesh, sources: &[u32]) {
    fn pick<T: Copy>(values: &[T], sources: &[u32]) -> Vec<T> {
        sources.iter().map(|&at| values[at as usize]).collect()
    }
    mesh.positions = pick(&mesh.positions, sources);
    mesh.uvs = mesh.uvs.take().map(|it| pick(&it, sources));
    mesh.colors = mesh.colors.take().map(|it| pick(&it, sources));
}

/// Corners by position. A corner is `3 * triangle + place in it`.
struct Fans {
    /// Corners of position `p` are `corners[starts[p]..starts[p + 1]]`, ascending.
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl Fans {
    fn gather(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let mut ids: HashMap<[u32; 3], u32, RandomState> =
            HashMap::with_capacity_and_hasher(positions.len(), RandomState::default());
        let id_of_vertex: Vec<u32> = positions
            .iter()
            .map(|position| {
                // Adding zero turns -0 into 0.
                let bits = position.map(|it| (it + 0.0).to_bits());
                let next = ids.len() as u32;
                *ids.entry(bits).or_insert(next)
            })
            .collect();
        let mut starts = vec![0; ids.len() + 1];
        let corner_ids = || {
            triangles
                .iter()
                .flatten()
                .map(|&v| id_of_vertex[v as usize] as usize)
        };
        for id in corner_ids() {
            starts[id + 1] += 1;
        }
        for id in 0..ids.len() {
            starts[id + 1] += starts[id];
        }
        let mut next = starts.clone();
        let mut corners = vec![0; triangles.len() * 3];
        for (corner, id) in corner_ids().enumerate() {
            corners[next[id] as usize] = corner as u32;
            next[id] += 1;
        }
        Self { starts, corners }
    }

    fn count(&self) -> usize {
        self.starts.len() - 1
    }

    fn of(&self, position: usize) -> &[u32] {
        &self.corners[self.starts[position] as usize..self.starts[position + 1] as usize]
    }
}

/// One corner of a fan.
struct Spoke {
    vertex: u32,
    /// Unit normal of the face; zero where it has no area.
    face: DVec3,
    /// The face's normal times its angle here.
    weighted: DVec3,
}

/// The new vertices of a range of positions.
#[derive(Default)]
struct Task {
    made: MadeNormals,
    /// For every corner of the range, in order, its new vertex, counted from the range's first.
    vertex_of_corner: Vec<u32>,
}

impl Task {
    fn run(
        range: std::ops::Range<usize>,
        fans: &Fans,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        faces: &[[f32; 3]],
    ) -> Self {
        let mut task = Self::default();
        let mut vertices: HashMap<(u32, [u32; 3]), u32, RandomState> = HashMap::default();
        for position in range {
            let spoke = |&corner: &u32| {
                let (triangle, place) = (corner as usize / 3, corner as usize % 3);
                let face = DVec3::from(faces[triangle].map(f64::from));
                Spoke {
                    vertex: triangles[triangle][place],
                    face,
                    weighted: face * angle(positions, &triangles[triangle], place),
                }
            };
            let fan: Vec<Spoke> = fans.of(position).iter().map(spoke).collect();
            vertices.clear();
            let mut last = None;
            for (spoke, normal) in fan.iter().zip(shade(&fan)) {
                let new = || {
                    task.made.sources.push(spoke.vertex);
                    task.made.normals.push(normal);
                    task.made.sources.len() as u32 - 1
                };
                let key = (spoke.vertex, normal.map(f32::to_bits));
                let vertex = match last {
                    Some((same, vertex)) if same == key => vertex,
                    _ => *vertices.entry(key).or_insert_with(new),
                };
                last = Some((key, vertex));
                task.vertex_of_corner.push(vertex);
            }
        }
        task
    }
}

/// A normal for every spoke. Spokes that average over the same faces get the same bits.
fn shade(fan: &[Spoke]) -> Vec<[f32; 3]> {
    if fan.len() <= EXACT_VALENCE && is_smooth(fan) {
        let mean = unit(fan.iter().map(|spoke| spoke.weighted).sum());
        return vec![mean; fan.len()];
    }
    let mut normals = match fan.len() <= EXACT_VALENCE {
        true => fan
            .iter()
            .map(|spoke| mean_within_crease(spoke.face, fan))
            .collect(),
        false => shade_by_cells(fan),
    };
    let with_area = || (0..fan.len()).filter(|&at| fan[at].face != DVec3::ZERO);
    if with_area().count() < fan.len() {
        // A face without area takes its vertex's normal, so as not to split it, else any of the fan.
        let any = with_area().next();
        let of_vertex: HashMap<u32, usize> = with_area().map(|at| (fan[at].vertex, at)).collect();
        for at in 0..fan.len() {
            if fan[at].face == DVec3::ZERO {
                let other = of_vertex.get(&fan[at].vertex).copied().or(any);
                normals[at] = other.map_or(NO_FACE, |other| normals[other]);
            }
        }
    }
    normals
}

/// Whether all faces lie within the crease angle of each other.
fn is_smooth(fan: &[Spoke]) -> bool {
    let is_near = |a: &Spoke, b: &Spoke| a.face.dot(b.face) >= CREASE_COS;
    let mut faces = fan.iter().enumerate();
    faces.all(|(at, own)| fan[at..].iter().all(|other| is_near(own, other)))
}

fn mean_within_crease(face: DVec3, fan: &[Spoke]) -> [f32; 3] {
    let near = fan
        .iter()
        .filter(|other| other.face.dot(face) >= CREASE_COS);
    unit(near.map(|spoke| spoke.weighted).sum())
}

/// The same with the fan's faces summed by direction first, so that a hundred thousand faces around one position take
/// a thousand squared steps and not their own number squared. The crease is then sharp to a cell's width.
fn shade_by_cells(fan: &[Spoke]) -> Vec<[f32; 3]> {
    let mut cell_ids: HashMap<u32, usize> = HashMap::new();
    let mut cells: Vec<Spoke> = Vec::new();
    let mut cell_of_spoke = Vec::with_capacity(fan.len());
    for spoke in fan {
        let cell = *cell_ids
            .entry(octahedral_cell(spoke.face))
            .or_insert(cells.len());
        if cell == cells.len() {
            cells.push(Spoke {
                vertex: 0,
                face: spoke.face,
                weighted: DVec3::ZERO,
            });
        }
        cells[cell].weighted += spoke.weighted;
        cell_of_spoke.push(cell);
    }
    let normals: Vec<_> = cells
        .iter()
        .map(|cell| mean_within_crease(cell.face, &cells))
        .collect();
    cell_of_spoke
        .into_iter()
        .map(|cell| normals[cell])
        .collect()
}

/// A number for a direction's neighbourhood; one of its own for zero.
fn octahedral_cell(direction: DVec3) -> u32 {
    if direction == DVec3::ZERO {
        return u32::MAX;
    }
    let on_octahedron = direction / direction.abs().element_sum();
    let (mut x, mut y) = (on_octahedron.x, on_octahedron.y);
    if on_octahedron.z < 0.0 {
        (x, y) = (
            (1.0 - y.abs()) * 1f64.copysign(x),
            (1.0 - x.abs()) * 1f64.copysign(y),
        );
    }
    let cell =
        |it: f64| ((it * 0.5 + 0.5) * CELLS_PER_SIDE).clamp(0.0, CELLS_PER_SIDE - 1.0) as u32;
    cell(y) * CELLS_PER_SIDE as u32 + cell(x)
}

/// Unit normal, counter-clockwise; zero where the area is zero.
pub(super) fn face_normal(positions: &[[f32; 3]], triangle: &[u32; 3]) -> [f32; 3] {
    let [a, b, c] = triangle.map(|vertex| position(positions, vertex));
    let normal = (b - a).cross(c - a);
    match normal == DVec3::ZERO {
        true => [0.0; 3],
        false => unit(normal),
    }
}

/// Radians at a corner of a triangle; 0 where a side has no length.
pub(super) fn angle(positions: &[[f32; 3]], triangle: &[u32; 3], corner: usize) -> f64 {
    let at = |step: usize| position(positions, triangle[(corner + step) % 3]);
    let (left, right) = (at(1) - at(0), at(2) - at(0));
    left.cross(right).length().atan2(left.dot(right))
}

fn position(positions: &[[f32; 3]], vertex: u32) -> DVec3 {
    DVec3::from(positions[vertex as usize].map(f64::from))
}

/// `vector` at unit length, `NO_FACE` where it has none.
pub(super) fn unit(vector: DVec3) -> [f32; 3] {
    // Scaled first: the square of a cross product of f32 denormals would vanish.
    let largest = vector.abs().max_element();
    if largest == 0.0 {
        return NO_FACE;
    }
    (vector / largest).normalize().as_vec3().to_array()
}

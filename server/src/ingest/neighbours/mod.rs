//! Neighbours: meshes of a scene that touch, and what each keeps for the others.
//!
//! ```text
//! boxes of the instances -> where they meet (`meetings`) -> vertices and open edges there (`rims`)
//! -> equal places in the world (`coincidence`) -> common borders, and common steps (`lattice`)
//! ```
//!
//! A vertex of an open border that another instance's border shares is fixed: it stays at every
//! level, so the surface stays closed whatever cut each side takes. Two surfaces that lie on each
//! other (the inner and the outer side of a leaf) share borders too, but close nothing: an edge
//! whose triangles lie on the same side in both fixes nothing.

mod coincidence;
mod lattice;
mod meetings;
mod rims;
pub(super) mod stored;

use std::collections::{BTreeSet, HashSet};

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use super::IngestError;
use super::arrange::Freedom;
use super::merge::MergedMesh;
use crate::build::Neighbours;
use coincidence::{ENTRY_BYTES, Entry, Places, size_of};
use meetings::{Box3, Meetings};
use rims::Rim;

/// Bytes that the comparison takes where no limit is set.
const USUAL_BYTES: u64 = 2 << 30;
/// Share of the memory limit that it may take.
const MEMORY_SHARE: u64 = 4;
/// Share of all compared vertices that one mesh may have. Not by threads: the same scene must give
/// the same neighbours.
const RIM_SHARE: usize = 4;
/// Bytes that an instance takes here, whatever it has of vertices.
const INSTANCE_BYTES: u64 = 512;
/// Pairs of instances whose offsets are looked at.
const MOST_PAIRS: usize = 1 << 18;
/// Cosine above which the triangles of two edges lie on the same side: they cover each other.
const SAME_SIDE: f64 = 0.996;

/// An instance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    /// Index of its mesh.
    pub mesh: usize,
    pub world_from_object: DAffine3,
    pub object_from_world: DAffine3,
    /// Of its box; set by [`find`].
    size: Option<i16>,
}

impl Placed {
    /// `None` for an instance without volume: no border of it can be followed.
    pub(super) fn new(mesh: usize, rows: &[[f64; 4]; 3]) -> Option<Self> {
        let row = |row: usize| DVec3::new(rows[row][0], rows[row][1], rows[row][2]);
        let linear = DMat3::from_cols(row(0), row(1), row(2)).transpose();
        let offset = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
        let world_from_object = DAffine3::from_mat3_translation(linear, offset);
        let object_from_world = world_from_object.inverse();
        let values = object_from_world.to_cols_array();
        values
            .iter()
            .all(|value| value.is_finite())
            .then_some(Self {
                mesh,
                world_from_object,
                object_from_world,
                size: None,
            })
    }
}

impl Placed {
    fn in_world(&self, position: [f32; 3]) -> DVec3 {
        let point = DVec3::from(position.map(f64::from));
        self.world_from_object.transform_point3(point)
    }
}

/// How the search goes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Options {
    /// The meshes' steps are not chosen by the user.
    pub steps_are_free: bool,
    /// `--memory-limit`.
    pub memory_limit_bytes: Option<u64>,
}

/// The neighbours of each mesh, and warnings.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub neighbours: Vec<Neighbours>,
    /// Which instances of each mesh may move a little.
    pub freedoms: Vec<Freedom>,
    pub warnings: Vec<String>,
}

/// Finds the neighbours of `meshes`, which stand in the world as `instances`; `None` is one without
/// volume. The same scene gives the same neighbours, whatever the thread count.
///
/// # Errors
/// Those of reading a mesh.
pub(super) fn find(
    meshes: &[&MergedMesh],
    instances: impl ExactSizeIterator<Item = Option<Placed>>,
    options: &Options,
) -> Result<Found, IngestError> {
    let mut found = Found {
        neighbours: vec![Neighbours::default(); meshes.len()],
        freedoms: vec![Freedom::All; meshes.len()],
        warnings: vec![],
    };
    let bytes = options.memory_limit_bytes;
    let bytes = bytes.map_or(USUAL_BYTES, |limit| USUAL_BYTES.min(limit / MEMORY_SHARE));
    let count = instances.len();
    if count < 2 {
        return Ok(found);
    }
    if count as u64 * INSTANCE_BYTES > bytes {
        let line = format!("{count} instances are too many to compare: gaps may show between them");
        found.warnings.push(line);
        found.freedoms.fill(Freedom::Own);
        return Ok(found);
    }
    let mut placed: Vec<Placed> = instances.flatten().collect();
    let bounds: Vec<Box3> = meshes
        .par_iter()
        .map(|mesh| meetings::bounds(&mesh.mesh))
        .collect::<Result<_, _>>()?;
    let extents: Vec<f64> = bounds.iter().map(Box3::extent).collect();
    for placed in &mut placed {
        let stretch = placed.world_from_object.matrix3.determinant().abs().cbrt();
        placed.size = size_of(extents[placed.mesh] * stretch);
    }
    let placed = &placed[..];
    let meetings = meetings::meetings(placed, &bounds);
    let most = (bytes / ENTRY_BYTES / 2) as usize;
    let rims: Vec<Option<Rim>> = meshes
        .par_iter()
        .zip(&meetings.of_mesh)
        .map(|(mesh, meeting)| Rim::new(&mesh.mesh, meeting, most / RIM_SHARE))
        .collect::<Result<_, _>>()?;
    let chosen = choose(placed, &rims, most);
    let skipped = placed
        .iter()
        .zip(&chosen)
        .filter(|(placed, part)| **part == Part::None && !meetings.of_mesh[placed.mesh].is_empty());
    let skipped = skipped.count();
    if skipped > 0 {
        found.warnings.push(format!(
            "{skipped} instances have too many vertices beside others to compare: gaps may show between them"
        ));
    }
    for (placed, part) in placed.iter().zip(&chosen) {
        let is_alone = meetings.of_mesh[placed.mesh].is_empty();
        if !is_alone && (*part != Part::All || placed.size.is_none()) {
            found.freedoms[placed.mesh] = Freedom::Own;
        }
    }
    let rims: Vec<Rim> = rims.into_iter().map(Option::unwrap_or_default).collect();
    let sharing = share(placed, &meetings, &rims, &chosen);
    for &mesh in &sharing.touching {
        found.freedoms[mesh] = Freedom::None;
    }
    for (mesh, fixed) in sharing.fixed.iter().enumerate() {
        let mut vertices: Vec<u32> = fixed.iter().copied().collect();
        vertices.sort_unstable();
        let at = |vertex: u32| rims[mesh].positions[vertex as usize];
        found.neighbours[mesh].fixed = vertices.into_iter().map(at).collect();
    }
    for (mesh, exponent) in lattice::exponents(meshes, &extents, placed, &sharing, options)? {
        found.neighbours[mesh].step_exponent = Some(exponent);
    }
    Ok(found)
}

/// Vertices of an instance that are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    None,
    /// Those of open edges.
    Open,
    All,
}

/// Chooses what fits: the open borders of all instances go before other vertices, and instances of
/// few vertices before those of many.
fn choose(placed: &[Placed], rims: &[Option<Rim>], most: usize) -> Vec<Part> {
    let mut chosen = vec![Part::None; placed.len()];
    let counts: Vec<Option<[usize; 2]>> = rims
        .iter()
        .map(|rim| {
            let rim = rim.as_ref()?;
            let open = rim.is_open.iter().filter(|open| **open).count();
            Some([open, rim.positions.len() - open])
        })
        .collect();
    let mut left = most;
    for (class, part) in [Part::Open, Part::All].into_iter().enumerate() {
        let before = chosen.clone();
        let count = |instance: usize| counts[placed[instance].mesh].map(|count| count[class]);
        let mut order: Vec<usize> = (0..placed.len()).collect();
        order.retain(|&instance| class == 0 || before[instance] == Part::Open);
        order.sort_by_key(|&instance| count(instance));
        for instance in order {
            if let Some(rest) = count(instance).and_then(|count| left.checked_sub(count)) {
                left = rest;
                chosen[instance] = part;
            }
        }
    }
    chosen
}

/// Equal places of the world.
#[derive(Debug, Default)]
pub(super) struct Sharing {
    /// For each mesh the vertices of its rim that stay.
    fixed: Vec<HashSet<u32>>,
    /// Meshes with a vertex in common with another instance.
    touching: BTreeSet<usize>,
    /// Pairs of instances with a vertex in common.
    pub(super) pairs: BTreeSet<[u32; 2]>,
}

/// Two vertices at one place.
type Match = (Entry, Entry);

fn share(placed: &[Placed], meetings: &Meetings, rims: &[Rim], chosen: &[Part]) -> Sharing {
    let entries = |instance: usize, size: i16| {
        let rim = &rims[placed[instance].mesh];
        let part = chosen[instance];
        let wanted = move |vertex: &u32| match part {
            Part::None => false,
            Part::Open => rim.is_open[*vertex as usize],
            Part::All => true,
        };
        let vertices = (0..rim.positions.len() as u32).filter(wanted);
        vertices.map(move |vertex| Entry {
            in_world: placed[instance].in_world(rim.positions[vertex as usize]),
            size,
            instance: instance as u32,
            vertex,
        })
    };
    let open_of = |rim: &Rim| rim.is_open.iter().filter(|open| **open).count();
    let open: Vec<usize> = rims.iter().map(open_of).collect();
    let count = (0..placed.len()).map(|instance| match chosen[instance] {
        Part::None => 0,
        Part::Open => open[placed[instance].mesh],
        Part::All => rims[placed[instance].mesh].positions.len(),
    });
    let mut places = Places::with_capacity(count.sum());
    for (instance, own) in placed.iter().enumerate() {
        if let Some(size) = own.size {
            places.add(entries(instance, size));
        }
    }
    // One instance after another: all matches together may be many times the vertices.
    let found: Vec<(usize, Vec<u32>, Vec<[u32; 2]>)> = (0..placed.len())
        .into_par_iter()
        .filter_map(|instance| {
            let size = placed[instance].size?;
            let met = |other: &i16| meetings.sizes[instance].holds(meetings.smallest_size, *other);
            let sizes: Vec<i16> = places.sizes().filter(met).collect();
            let mut own: Vec<Match> = vec![];
            for entry in entries(instance, size) {
                places.look(&sizes, &entry, |other| own.push((entry, *other)));
            }
            let pair = |(own, other): &Match| {
                let [a, b] = [own.instance, other.instance];
                [a.min(b), a.max(b)]
            };
            let mut pairs: Vec<[u32; 2]> = own.iter().map(pair).collect();
            pairs.sort_unstable();
            pairs.dedup();
            let fixed = fixed_of(placed, rims, instance, &own);
            (!own.is_empty()).then_some((placed[instance].mesh, fixed, pairs))
        })
        .collect();
    let mut sharing = Sharing {
        fixed: vec![HashSet::new(); rims.len()],
        touching: BTreeSet::new(),
        pairs: BTreeSet::new(),
    };
    for (mesh, fixed, pairs) in found {
        sharing.fixed[mesh].extend(fixed);
        sharing.touching.insert(mesh);
        let room = MOST_PAIRS.saturating_sub(sharing.pairs.len());
        sharing.pairs.extend(pairs.into_iter().take(room));
    }
    sharing
}

/// Vertices of an instance that stay. `own` are all its matches, ascending by its vertices. A vertex
/// stays where it lies on an open border that another instance's border shares, and at least one of
/// its open edges is not covered.
fn fixed_of(placed: &[Placed], rims: &[Rim], instance: usize, own: &[Match]) -> Vec<u32> {
    let rim = &rims[placed[instance].mesh];
    let matches_of = |vertex: u32| {
        let from = own.partition_point(|it| it.0.vertex < vertex);
        own[from..]
            .iter()
            .take_while(move |it| it.0.vertex == vertex)
    };
    let is_border = |it: &&Match| {
        let other = &rims[placed[it.1.instance as usize].mesh];
        other.is_open[it.1.vertex as usize]
    };
    let mut fixed = vec![];
    for edge in &rim.edges {
        let [a, b] = edge.ends;
        let shared = edge
            .ends
            .map(|end| matches_of(end).any(|it| is_border(&it)));
        if shared == [false, false] {
            continue;
        }
        // Whether each open edge of another instance between the same places covers this one.
        let mut covers = matches_of(a).flat_map(|first| {
            let same = matches_of(b).filter(|it| it.1.instance == first.1.instance);
            same.filter_map(|second| {
                let other = &placed[first.1.instance as usize];
                let theirs = rims[other.mesh].edge(first.1.vertex, second.1.vertex)?;
                let ends = [first.0.in_world, second.0.in_world];
                let ours = inward(ends, placed[instance].in_world(edge.third));
                let theirs = inward(ends, other.in_world(theirs.third));
                Some(ours.dot(theirs) > SAME_SIDE)
            })
        });
        let is_covered = match covers.next() {
            None => false,
            Some(first) => first && covers.all(|it| it),
        };
        if !is_covered {
            let ends = edge.ends.into_iter().zip(shared);
            fixed.extend(ends.filter(|(_, shared)| *shared).map(|(end, _)| end));
        }
    }
    fixed
}

/// Direction from an edge into its triangle, at a right angle to the edge.
fn inward([a, b]: [DVec3; 2], third: DVec3) -> DVec3 {
    let along = (b - a).normalize_or_zero();
    let side = third - a;
    (side - along * along.dot(side)).normalize_or_zero()
}

#[cfg(test)]
mod tests;

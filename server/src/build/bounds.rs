//! Spheres and errors that only grow toward the root, so that one predicate picks exactly one cut.

use lodestream_format::Sphere;
use lodestream_format::bounds::round_up;
use lodestream_format::hierarchy::ROOT_ERROR;

use super::cluster::{Birth, ClusterInfo, ClusterView};
use super::clusterize::Clusters;
use super::simplify::{HANDED_ON, Simplified};
use super::vertex::Grids;

/// Sphere around the box of a cluster, local metres.
pub(super) fn around(grids: &Grids, info: &ClusterInfo) -> Sphere {
    let (low, high) = (grids.local_metres(info.low), grids.local_metres(info.high));
    let center: [f32; 3] = std::array::from_fn(|axis| 0.5 * low[axis] + 0.5 * high[axis]);
    let corner = |point: [f32; 3]| {
        (0..3)
            .map(|axis| (point[axis] as f64 - center[axis] as f64).powi(2))
            .sum::<f64>()
    };
    let radius = corner(low).max(corner(high)).sqrt();
    Sphere {
        center,
        radius: round_up(radius * (1.0 + 1e-6)),
    }
}

/// The lod sphere of a group: around the lod spheres that its clusters were born with, which hold their geometry.
pub(super) fn lod_sphere(births: &[Birth]) -> Sphere {
    let mut spheres: Vec<Sphere> = births.iter().map(|birth| birth.lod_sphere).collect();
    // Clusters of one finer group were born with one sphere.
    spheres.sort_unstable_by_key(key);
    spheres.dedup();
    Sphere::enclosing(&spheres)
}

fn key(sphere: &Sphere) -> [u32; 4] {
    let [x, y, z] = sphere.center.map(f32::to_bits);
    [x, y, z, sphere.radius.to_bits()]
}

/// The sphere with its radius large enough for the vertices of a replacement, which may have moved outwards.
pub(super) fn grown(sphere: Sphere, grids: &Grids, clusters: &Clusters) -> Sphere {
    let center = sphere.center.map(f64::from);
    let mut squared = 0.0f64;
    for info in &clusters.infos {
        let words = &clusters.words[info.first_word as usize..][..info.words as usize];
        for vertex in ClusterView::new(words).vertices {
            let at = grids.local_metres(vertex.position);
            let away = (0..3).map(|axis| (at[axis] as f64 - center[axis]).powi(2));
            squared = squared.max(away.sum());
        }
    }
    let needed = round_up(squared.sqrt() * (1.0 + 1e-6));
    Sphere {
        radius: sphere.radius.max(needed),
        ..sphere
    }
}

/// An error that was measured against the rounded source, with the rounding of the source itself.
/// A constant added to all keeps their order.
pub(super) fn with_rounding(error_metres: f32, grids: &Grids) -> f32 {
    if error_metres >= ROOT_ERROR {
        return error_metres;
    }
    round_up(error_metres as f64 + grids.rounding_metres()).min(ROOT_ERROR / 2.0)
}

/// Error of a group's replacement, metres, term by term.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Terms {
    /// Distance of the source from the replacement.
    pub forward: f64,
    /// Distance of the replacement from the source; 0 where it is not above the other distances.
    pub back: f64,
    /// Distance of parts that vanished from what is left.
    pub lost: f64,
    /// Share of normals, texture coordinates and colours.
    pub attributes: f64,
    /// Share of materials.
    pub materials: f64,
    /// Largest error of a member.
    pub members: f64,
    /// Largest distance of a member from the source.
    pub members_surface: f64,
}

impl Terms {
    /// Of a replacement, but for `back`.
    pub fn new(births: &[Birth], simplified: &Simplified) -> Self {
        let most = |of: fn(&Birth) -> f32| {
            let all = births.iter().map(|birth| of(birth) as f64);
            all.fold(0.0, f64::max)
        };
        let members_surface = most(|birth| birth.surface_metres);
        // Where parts vanish, points that were near to them, and so were not handed on, are as far
        // off as those now.
        let lost = match simplified.lost_metres > 0.0 {
            true => simplified.lost_metres + HANDED_ON as f64 * members_surface,
            false => 0.0,
        };
        Self {
            forward: simplified.distance_metres,
            back: 0.0,
            lost,
            attributes: simplified.attribute_metres,
            materials: simplified.material_metres,
            members: most(|birth| birth.error_metres),
            members_surface,
        }
    }

    /// Bound of the distance of the replacement from the source.
    pub fn surface_metres(&self) -> f64 {
        self.forward.max(self.back).max(self.members_surface)
    }

    /// The largest term. Nothing is farther off than the lod sphere is wide, which holds both
    /// surfaces and only grows toward the root.
    pub fn error_metres(&self, lod_sphere: &Sphere) -> f64 {
        let others = self.lost.max(self.attributes).max(self.materials);
        let error = self.surface_metres().max(others);
        // Below the root's, whatever the size of the mesh.
        let most = self.members.max(2.0 * lod_sphere.radius as f64);
        error
            .max(self.members)
            .min(most)
            .min(ROOT_ERROR as f64 / 2.0)
    }

    /// The term that decides; of equal ones the first.
    pub fn largest(&self) -> Term {
        let all = [
            (Term::Source, self.forward),
            (Term::Surface, self.back),
            (Term::Members, self.members.max(self.members_surface)),
            (Term::Lost, self.lost),
            (Term::Attributes, self.attributes),
            (Term::Materials, self.materials),
        ];
        let larger = |best: (Term, f64), own: (Term, f64)| if own.1 > best.1 { own } else { best };
        all.into_iter().fold(all[0], larger).0
    }
}

/// A term of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Term {
    Source,
    Surface,
    Members,
    Lost,
    Attributes,
    Materials,
}

//! Curves of measured error over triangles, and what one builder needs for the error of another.

use lodestream_server::build::TriangleTree;
use serde::Serialize;

use super::dag::ClusterDag;
use super::distance::one_way;
use super::edges::SourceBorder;

/// A cut, measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct CutFigures {
    /// What the cut was chosen by: the level, or the stored error in metres.
    pub by: f64,
    /// Triangles.
    pub triangles: u64,
    /// Clusters.
    pub clusters: u64,
    /// Largest stored error, metres.
    pub stored_metres: f64,
    /// Largest measured distance to the source, both ways, metres.
    pub max_metres: f64,
    /// Root mean square of it, the worse way, metres.
    pub rms_metres: f64,
    /// Edges open that the source does not excuse.
    pub opened_edges: u64,
}

/// The mesh as it came, in local places.
pub struct SourceSurface {
    places: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    tree: TriangleTree,
}

impl SourceSurface {
    /// Holds what [`super::dag::source_places`] gave.
    pub fn new((places, triangles): (Vec<[f32; 3]>, Vec<[u32; 3]>)) -> Self {
        let tree = TriangleTree::new(&places, &triangles);
        Self {
            places,
            triangles,
            tree,
        }
    }
}

/// How one DAG is measured.
pub struct Measuring<'a> {
    /// The DAG.
    pub dag: &'a ClusterDag,
    /// The truth.
    pub source: &'a SourceSurface,
    /// Its border.
    pub border: SourceBorder<'a>,
    /// Grid step, metres; 0 without a grid.
    pub step_metres: f64,
    /// Samples each way at most, about.
    pub most_samples: usize,
}

impl Measuring<'_> {
    /// Measures a cut.
    pub fn cut(&self, by: f64, cut: &[u32]) -> CutFigures {
        let triangles = self.dag.gather(cut.iter().copied());
        let tree = TriangleTree::new(&self.dag.places, &triangles);
        let there = one_way(
            &self.dag.places,
            &triangles,
            &self.source.tree,
            self.most_samples,
        );
        let back = one_way(
            &self.source.places,
            &self.source.triangles,
            &tree,
            self.most_samples,
        );
        let distance = there.worse(back);
        let stored = cut.iter().map(|&cluster| self.dag.error_metres(cluster));
        CutFigures {
            by,
            triangles: triangles.len() as u64,
            clusters: cut.len() as u64,
            stored_metres: stored.fold(0.0, f64::max),
            max_metres: distance.max_metres,
            rms_metres: distance.rms_metres,
            opened_edges: self.border.opened(cut, self.step_metres),
        }
    }

    /// Every level above the source.
    pub fn levels(&self) -> Vec<CutFigures> {
        (1..self.dag.levels())
            .map(|level| self.cut(level.into(), &self.dag.level_cut(level)))
            .collect()
    }

    /// Uniform-error cuts, fine to coarse.
    pub fn ladder(&self, most: usize) -> Vec<CutFigures> {
        let errors = self.dag.ladder(most);
        let cuts = errors
            .iter()
            .map(|&error| (error, self.dag.error_cut(error)));
        cuts.map(|(error, cut)| self.cut(error, &cut)).collect()
    }
}

/// A figure of a cut that is compared.
pub type Figure = fn(&CutFigures) -> f64;

/// What a cut of the rival costs us.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EqualError {
    /// What the rival's cut was chosen by.
    pub by: f64,
    /// Its triangles.
    pub rival_triangles: u64,
    /// Its largest distance, metres.
    pub rival_max_metres: f64,
    /// Its root mean square, metres.
    pub rival_rms_metres: f64,
    /// Our triangles at its largest distance, over its own.
    pub ratio_at_max: Option<f64>,
    /// Our triangles at its root mean square, over its own.
    pub ratio_at_rms: Option<f64>,
}

/// Our triangles at the error of each cut of the rival.
pub fn at_equal_error(ours: &[CutFigures], rival: &[CutFigures]) -> Vec<EqualError> {
    let ratio = |cut: &CutFigures, figure: Figure| {
        let triangles = triangles_at(ours, figure, figure(cut))?;
        Some(triangles / cut.triangles as f64)
    };
    rival
        .iter()
        .map(|cut| EqualError {
            by: cut.by,
            rival_triangles: cut.triangles,
            rival_max_metres: cut.max_metres,
            rival_rms_metres: cut.rms_metres,
            ratio_at_max: ratio(cut, |it| it.max_metres),
            ratio_at_rms: ratio(cut, |it| it.rms_metres),
        })
        .collect()
}

/// Triangles that a curve (fine to coarse) needs for `error`, on straight lines between its logarithms; `None` outside
/// the curve. Where the curve crosses the error more than once, the coarsest crossing counts: nobody would draw more.
pub fn triangles_at(curve: &[CutFigures], figure: Figure, error: f64) -> Option<f64> {
    let at = |cut: &CutFigures| (figure(cut), cut.triangles as f64);
    // From coarse to fine, the first stretch that comes down to the error.
    let pairs = curve
        .windows(2)
        .rev()
        .map(|pair| (at(&pair[1]), at(&pair[0])));
    for ((coarse_error, coarse), (fine_error, fine)) in pairs {
        if !(fine_error..=coarse_error).contains(&error) || fine_error <= 0.0 {
            continue;
        }
        let span = (coarse_error / fine_error).ln();
        let share = if span > 0.0 {
            (error / fine_error).ln() / span
        } else {
            1.0
        };
        return Some((fine.ln() + share * (coarse / fine).ln()).exp());
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[(u64, f64)]) -> Vec<CutFigures> {
        let cuts = points.iter().map(|&(triangles, max_metres)| CutFigures {
            triangles,
            max_metres,
            rms_metres: max_metres / 10.0,
            ..CutFigures::default()
        });
        cuts.collect()
    }

    #[test]
    fn lines_between_logarithms() {
        let ours = curve(&[(10_000, 0.01), (100, 1.0)]);
        let at = |error| triangles_at(&ours, |it| it.max_metres, error);
        assert!((at(0.1).unwrap() - 1000.0).abs() < 1e-6);
        assert!((at(1.0).unwrap() - 100.0).abs() < 1e-6);
        assert_eq!((at(0.001), at(2.0)), (None, None));
        // The rival's cut at that error has twice as many triangles.
        let rows = at_equal_error(&ours, &curve(&[(2000, 0.1), (50, 5.0)]));
        assert!((rows[0].ratio_at_max.unwrap() - 0.5).abs() < 1e-9);
        assert!((rows[0].ratio_at_rms.unwrap() - 0.5).abs() < 1e-9);
        assert_eq!(rows[1].ratio_at_max, None);
    }

    #[test]
    fn a_bump_in_the_curve_gives_the_coarsest_cut_that_is_good_enough() {
        let ours = curve(&[(8000, 0.1), (4000, 0.5), (2000, 0.2), (1000, 0.8)]);
        let at = |error| triangles_at(&ours, |it| it.max_metres, error).unwrap();
        assert!(at(0.4) < 2000.0);
    }
}

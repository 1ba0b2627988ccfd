//! The stability table: stiff and extreme inputs, what was measured against an f64 reference, and whether it held.

mod cases;
mod claims;
mod pixels;
mod solids;

use std::panic::{AssertUnwindSafe, catch_unwind};

use lodestream_server::build::{BuildOptions, BuiltAsset, TriangleTree, build};
use lodestream_server::import::Mesh;
use serde::Serialize;

pub use cases::{Case, Expected, Sizes, all};
pub use claims::Claim;

use super::dag::{ClusterDag, center_metres, source_places};
use super::distance::one_way;
use super::edges::SourceBorder;
use super::groups::{self, GroupFigures};
use super::process::spent;
use super::rows::Shape;

/// Share of groups whose stored error must bound the measured one.
const BOUNDED_SHARE: f64 = 0.999;
const LADDER: usize = 10;
/// Loss by f32 in local metres and by the measuring, as a share of the mesh's largest side.
const LOST_SHARE: f64 = 1.0 / (1 << 24) as f64;
/// Steps that a mesh spans at least.
const LEAST_STEPS: f64 = (1 << 14) as f64;
const MOST_GROUPS: usize = 300;

/// A row of the table.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Row {
    /// The case.
    pub case: &'static str,
    /// Input triangles.
    pub triangles: u64,
    /// The shape of what was built.
    #[serde(flatten)]
    pub shape: Shape,
    /// Groups that nothing replaces.
    pub root_groups: u64,
    /// Open edges of the source clusters.
    pub source_open_edges: u64,
    /// Most edges that a cut opens, over all levels and uniform-error cuts.
    pub opened_edges: u64,
    /// Distance, both ways, between the input and the source clusters: what the grid changed, metres.
    pub grid_metres: f64,
    /// Error that the report states for the source clusters, metres.
    pub grid_stated_metres: f64,
    /// Most that a level's distance from the input, both ways, is of the error stated for it.
    pub level_excess: f64,
    /// Position step, metres.
    pub step_metres: f64,
    /// The groups' promises.
    #[serde(flatten)]
    pub promises: GroupFigures,
    /// Build and encode, wall-clock seconds.
    pub build_secs: f64,
    /// What measuring took, seconds.
    pub measure_secs: f64,
    /// `built`, the refusal, or what went wrong.
    pub outcome: String,
    /// What does not hold; empty in a row that passes.
    pub faults: Vec<String>,
    /// What the input holds.
    pub note: String,
}

impl Row {
    /// Whether everything holds.
    pub fn passed(&self) -> bool {
        self.faults.is_empty()
    }
}

/// The table.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Stability {
    /// Rows that pass.
    pub passed: usize,
    /// Rows that do not.
    pub failed: usize,
    /// A row a case.
    pub rows: Vec<Row>,
    /// The second table.
    pub claims: Vec<Claim>,
}

/// Builds and measures the cases whose names contain `named`; `each` hears of a case when its row is there.
pub fn table(
    sizes: Sizes,
    named: &str,
    options: &BuildOptions,
    mut each: impl FnMut(&Row),
) -> Stability {
    let claims = claims::claims(named);
    let mut table = Stability {
        passed: claims.iter().filter(|claim| claim.holds).count(),
        failed: claims.iter().filter(|claim| !claim.holds).count(),
        rows: Vec::new(),
        claims,
    };
    for make in all(sizes) {
        let case = make();
        if !case.name.contains(named) {
            continue;
        }
        let row = row(case, options);
        each(&row);
        table.passed += usize::from(row.passed());
        table.failed += usize::from(!row.passed());
        table.rows.push(row);
    }
    table
}

/// Builds and measures one case.
pub fn row(case: Case, options: &BuildOptions) -> Row {
    let mut row = Row {
        case: case.name,
        triangles: case.mesh.triangles.len() as u64,
        note: case.note,
        ..Row::default()
    };
    // A panic is an outcome like another: the rows after it still count.
    let (result, cost) = spent(|| catch_unwind(AssertUnwindSafe(|| build(&case.mesh, options))));
    row.build_secs = cost.wall_secs;
    match (result, case.expected) {
        (Ok(Ok(built)), Expected::Built) => {
            row.outcome = "built".into();
            let (measured, cost) = spent(|| row.measure(&case.mesh, &built, case.most_samples));
            row.measure_secs = cost.wall_secs;
            if let Err(error) = measured {
                row.faults.push(format!("does not read back: {error}"));
            }
        }
        (Ok(Ok(_)), Expected::Refused(part)) => {
            row.outcome = "built".into();
            row.faults.push(format!("not refused by {part:?}"));
        }
        (Ok(Err(error)), expected) => {
            row.outcome = error.to_string();
            match expected {
                Expected::Refused(part) if row.outcome.contains(part) => {}
                expected => row.faults.push(format!("expected {expected:?}")),
            }
        }
        (Err(_), _) => {
            row.outcome = "panicked".into();
            row.faults.push("panicked".into());
        }
    }
    row
}

impl Row {
    /// The input itself is the reference, not the source clusters: rounding is part of the error.
    fn check_rounding(
        &mut self,
        dag: &ClusterDag,
        built: &BuiltAsset,
        places: &[[f32; 3]],
        triangles: &[[u32; 3]],
        most_samples: usize,
    ) {
        let side = largest_side(places);
        let lost = LOST_SHARE * side;
        let levels = &built.report.levels_table;
        self.grid_stated_metres = levels.first().map_or(0.0, |level| level.error_max);
        if self.grid_metres > self.grid_stated_metres + lost {
            self.faults.push(format!(
                "source clusters lie {:.3e} m from the input, {:.3e} m stated",
                self.grid_metres, self.grid_stated_metres
            ));
        }
        if self.step_metres * LEAST_STEPS > side && side > 0.0 {
            let steps = side / self.step_metres;
            self.faults.push(format!("the mesh spans {steps:.0} steps"));
        }
        let tree = TriangleTree::new(places, triangles);
        for level in 1..dag.levels() {
            let cut = dag.level_cut(level);
            let stated = cut
                .iter()
                .map(|&it| dag.clusters[it as usize].child_group)
                .map(|group| match group {
                    Some(group) => dag.groups[group as usize].parent_error_metres,
                    None => self.grid_stated_metres,
                })
                .fold(0.0, f64::max);
            let drawn = dag.gather(cut);
            let there = one_way(&dag.places, &drawn, &tree, most_samples);
            let drawn_tree = TriangleTree::new(&dag.places, &drawn);
            let back = one_way(places, triangles, &drawn_tree, most_samples);
            let measured = (there.worse(back).max_metres - lost).max(0.0);
            self.level_excess = self.level_excess.max(measured / stated);
        }
        if self.level_excess > 1.0 {
            self.faults.push(format!(
                "a level lies {:.3} times as far from the input as stated",
                self.level_excess
            ));
        }
    }

    fn measure(
        &mut self,
        mesh: &Mesh,
        built: &BuiltAsset,
        most_samples: usize,
    ) -> Result<(), lodestream_format::FormatError> {
        let dag = ClusterDag::of_asset(built)?;
        self.shape = Shape::of(&dag);
        self.root_groups = dag.groups.iter().filter(|it| it.is_root()).count() as u64;
        self.step_metres = built.asset.position_grid.step();

        let (places, triangles) = source_places(mesh, center_metres(built));
        let leaves = dag.gather(dag.level_cut(0));
        let leaf_tree = TriangleTree::new(&dag.places, &leaves);
        let tree = TriangleTree::new(&places, &triangles);
        let there = one_way(&dag.places, &leaves, &tree, most_samples);
        let back = one_way(&places, &triangles, &leaf_tree, most_samples);
        self.grid_metres = there.worse(back).max_metres;
        self.check_rounding(&dag, built, &places, &triangles, most_samples);

        let border = SourceBorder::new(&dag);
        self.source_open_edges = border.open.len() as u64;
        let levels = (1..dag.levels()).map(|level| dag.level_cut(level));
        let uniform = dag.ladder(LADDER).into_iter().map(|it| dag.error_cut(it));
        let opened = levels
            .chain(uniform)
            .map(|cut| border.opened(&cut, self.step_metres));
        self.opened_edges = opened.max().unwrap_or(0);

        let errors = groups::measure(&dag, MOST_GROUPS, most_samples);
        self.promises = groups::figures(&dag, &errors, self.step_metres);
        if self.promises.bounded_share < BOUNDED_SHARE {
            self.faults.push(format!(
                "{} of {} groups lie farther than they say, by {:.3} at most",
                self.promises.unbounded, self.promises.measured, self.promises.worst_excess
            ));
        }
        if self.opened_edges > 0 {
            self.faults
                .push(format!("{} edges opened", self.opened_edges));
        }
        if self.root_groups != 1 {
            self.faults
                .push(format!("{} root groups", self.root_groups));
        }
        Ok(())
    }
}

/// Largest side of the box around the places, metres.
fn largest_side(places: &[[f32; 3]]) -> f64 {
    let side = |axis: usize| {
        let values = places.iter().map(|place| f64::from(place[axis]));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), it| {
            (low.min(it), high.max(it))
        });
        high - low
    };
    [0, 1, 2].map(side).into_iter().fold(0.0, f64::max)
}

//! Budgets: the distance from the source that the groups of a round may reach.
//!
//! The first is the smallest that removes enough triangles of a few groups. Each next one is
//! chosen so that its round halves the triangles again: how the last one did says how fast they
//! fall with the distance.

use rayon::prelude::*;

use super::borders::{Borders, ChunkBounds};
use super::cluster::ClusterView;
use super::dag::{Dag, Plan};
use super::error::BuildError;
use super::partition::{self, USUAL_GROUP_CLUSTERS};
use super::simplify::{Job, Workspace};

/// Groups that the first budget is taken from.
const PROBES: usize = 8;
/// Chunks for each that is looked at: all of them would take the time of half a round.
const CHUNKS_A_PROBE: usize = 4;
/// The first budget leaves at most this share of the triangles of the probes.
const FIRST_LEFT: f64 = 0.7;
/// Halvings or doublings at most in the search for the first budget.
const MOST_TRIALS: usize = 4;
/// Share of the triangles that a round should leave.
const WANTED_LEFT: f64 = 0.5;
/// Factor that the first round is taken to have grown by.
const FACTOR: f64 = 2.0;
/// Least and largest factor from one budget to the next.
const FACTORS: [f64; 2] = [1.5, 2.5];

/// Budgets of a build.
#[derive(Debug, Clone, Copy)]
pub(super) struct Budgets {
    metres: f64,
    factor: f64,
    /// Above this, any distance is allowed.
    most_metres: f64,
}

impl Budgets {
    /// Those of the clusters of `pool`, from a few groups of them.
    ///
    /// # Errors
    /// A store that cannot be read.
    pub fn of(dag: &Dag, plan: Plan, pool: &[u32]) -> Result<Self, BuildError> {
        let all = partition::bounds(&dag.clusters, pool);
        let side = |axis: usize| all.high[axis] as i64 - all.low[axis] as i64;
        let extent = (0..3).map(side).max().unwrap_or(0).max(0);
        let probes = probes(dag, plan, pool)?;
        let mut found: Vec<f64> = probes
            .par_iter()
            .map_init(Workspace::default, |workspace, probe| {
                probe.ask(plan, f64::INFINITY, |job, views| {
                    workspace.typical_metres(job, views)
                })
            })
            .collect();
        found.sort_by(f64::total_cmp);
        let typical_metres = found.get(found.len() / 2).copied().unwrap_or(0.0);
        let least_metres = plan.grids.rounding_metres();
        let first_metres = first(typical_metres, least_metres, |metres| {
            left(&probes, plan, metres)
        });
        Ok(Self {
            metres: first_metres,
            factor: FACTOR,
            most_metres: extent as f64 * plan.grids.step_metres(),
        })
    }

    /// Budget of the next round, metres.
    pub fn metres(&self) -> f64 {
        match self.is_limited() {
            true => self.metres,
            false => f64::INFINITY,
        }
    }

    /// Whether some distance is too large.
    pub fn is_limited(&self) -> bool {
        self.metres < self.most_metres
    }

    /// Chooses the next budget after a round that left this share of the triangles.
    pub fn advance(&mut self, left: f64) {
        let falls = (1.0 / left.clamp(0.05, 0.999)).ln() / self.factor.ln();
        let wanted = ((1.0 / WANTED_LEFT).ln() / falls).exp();
        self.factor = wanted.clamp(FACTORS[0], FACTORS[1]);
        self.metres *= self.factor;
    }
}

/// A group of the first round.
struct Probe {
    parts: Vec<Vec<u32>>,
    rules: Vec<Vec<u8>>,
}

/// Some groups of the first round, evenly spread over one in [`CHUNKS_A_PROBE`] chunks.
fn probes(dag: &Dag, plan: Plan, pool: &[u32]) -> Result<Vec<Probe>, BuildError> {
    let chunks = partition::chunks(&dag.clusters, pool, 0);
    let bounds: Vec<ChunkBounds> = chunks
        .iter()
        .map(|chunk| partition::bounds(&dag.clusters, chunk))
        .collect();
    let asked = (chunks.len() / CHUNKS_A_PROBE).clamp(1, PROBES);
    let mut probes = Vec::new();
    for turn in 0..asked.min(chunks.len()) {
        let own = (2 * turn + 1) * chunks.len() / (2 * asked);
        let meets = |&other: &usize| other != own && bounds[other].meets(&bounds[own]);
        let others: Vec<ChunkBounds> = (0..bounds.len())
            .filter(meets)
            .map(|other| bounds[other])
            .collect();
        probes.extend(Probe::some(
            dag,
            plan,
            &chunks[own],
            &others,
            PROBES / asked,
        )?);
    }
    Ok(probes)
}

impl Probe {
    /// Some groups of a chunk.
    fn some(
        dag: &Dag,
        plan: Plan,
        chunk: &[u32],
        others: &[ChunkBounds],
        wanted: usize,
    ) -> Result<Vec<Self>, BuildError> {
        let parts = dag.parts(chunk)?;
        let views: Vec<ClusterView> = parts.iter().map(|part| ClusterView::new(part)).collect();
        let borders = Borders::new(&views);
        let groups = partition::partition(&views, &borders, USUAL_GROUP_CLUSTERS);
        let rules = borders.rules(&groups, others, plan.fixed);
        let rules_of = |&local: &u32| {
            let number = local as usize;
            borders.rules_of(number, &views[number], &rules)
        };
        let wanted = wanted.min(groups.len());
        let asked = (0..wanted).map(|turn| &groups[(2 * turn + 1) * groups.len() / (2 * wanted)]);
        Ok(asked
            .map(|group| Self {
                parts: group
                    .iter()
                    .map(|&own| parts[own as usize].clone())
                    .collect(),
                rules: group.iter().map(rules_of).collect(),
            })
            .collect())
    }

    /// Asks about the group with a budget.
    fn ask<'a, T>(
        &'a self,
        plan: Plan,
        budget_metres: f64,
        question: impl FnOnce(&Job, Group<'a>) -> T,
    ) -> T {
        let job = Job {
            grids: plan.grids,
            placement: plan.placement,
            level: 1,
            members_metres: &[],
            merge: false,
            budget_metres,
        };
        let parts = self.parts.iter().zip(&self.rules);
        let views = parts.map(|(part, rules)| (ClusterView::new(part), &rules[..]));
        question(&job, views.collect::<Vec<_>>().into_iter())
    }
}

type Group<'a> = std::vec::IntoIter<(ClusterView<'a>, &'a [u8])>;

/// Share of the triangles that some probes leave within a budget.
fn left(probes: &[Probe], plan: Plan, budget_metres: f64) -> f64 {
    let counts = probes
        .par_iter()
        .map_init(Workspace::default, |workspace, probe| {
            probe.ask(plan, budget_metres, |job, views| {
                workspace.counts(job, views)
            })
        });
    let add = |a: [usize; 2], b: [usize; 2]| [a[0] + b[0], a[1] + b[1]];
    let [before, left] = counts.reduce(|| [0, 0], add);
    left as f64 / before.max(1) as f64
}

/// About the smallest budget, `least_metres` at least, that leaves [`FIRST_LEFT`] of the triangles
/// by `left`: searched by factors of two, then by a root of two.
fn first(typical_metres: f64, least_metres: f64, left: impl Fn(f64) -> f64) -> f64 {
    let removes_enough = |metres: f64| metres >= least_metres && left(metres) <= FIRST_LEFT;
    let mut metres = typical_metres.max(least_metres);
    if removes_enough(metres) {
        for _ in 0..MOST_TRIALS {
            if !removes_enough(0.5 * metres) {
                break;
            }
            metres *= 0.5;
        }
    } else {
        for _ in 0..MOST_TRIALS {
            metres *= 2.0;
            if removes_enough(metres) {
                break;
            }
        }
    }
    let between = std::f64::consts::FRAC_1_SQRT_2 * metres;
    if removes_enough(between) {
        between
    } else {
        metres
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_grow_until_any_distance_is_allowed() {
        let mut budgets = Budgets {
            metres: 1e-6,
            factor: FACTOR,
            most_metres: 10.0,
        };
        let mut rounds = 0;
        while budgets.is_limited() {
            let before = budgets.metres();
            // All kinds of headway, none at all among them.
            budgets.advance([1.0, 0.5, 0.9, 0.0, 0.2][rounds % 5]);
            let factor = budgets.metres() / before;
            assert!(
                factor >= FACTORS[0] - 1e-9
                    && (factor <= FACTORS[1] + 1e-9 || factor.is_infinite()),
                "{factor}"
            );
            rounds += 1;
        }
        assert!(budgets.metres().is_infinite() && rounds < 40, "{rounds}");
    }

    #[test]
    fn the_first_budget_is_the_smallest_that_removes_enough() {
        // Half of the triangles go at a metre; a steep and a flat fall round it.
        let left = |fall: f64| move |metres: f64| 1.0 / (1.0 + metres.powf(fall));
        for fall in [0.5, 1.0, 3.0] {
            for typical in [0.2, 1.0, 2.5] {
                let found = first(typical, 1e-9, left(fall));
                assert!(
                    left(fall)(found) <= FIRST_LEFT,
                    "{fall} from {typical}: {found}"
                );
                assert!(
                    left(fall)(0.7 * found) > FIRST_LEFT,
                    "{fall} from {typical}: {found}"
                );
            }
        }
        // No budget removes a triangle, and every budget removes all.
        assert_eq!(first(1.0, 1e-9, |_| 1.0), 2f64.powi(MOST_TRIALS as i32));
        let between = std::f64::consts::FRAC_1_SQRT_2 * 0.5;
        assert_eq!(first(1.0, 0.3, |_| 0.0), between);
    }

    #[test]
    fn a_round_that_leaves_half_goes_on_as_it_was() {
        let mut budgets = Budgets {
            metres: 1.0,
            factor: 2.0,
            most_metres: 1e9,
        };
        budgets.advance(0.5);
        assert!((budgets.metres() - 2.0).abs() < 1e-9);
        // Triangles that fall more slowly ask for larger steps.
        budgets.advance(0.7);
        assert!(budgets.metres() > 2.0 * 2.2);
    }
}

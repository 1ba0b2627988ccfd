//! Answers: how far places and witnesses lie from the triangles that answer for them.
//!
//! The trials of the budget know the triangle nearest to each. Since then places have moved, by
//! less than triangles are large, so it is the nearest still, or nearly: its distance is a bound
//! that is seldom loose. Only a point that would set the scale is held against what lies round it.

use super::super::super::borders::OPEN;
use super::super::budget::Source;
use super::super::collapse::Collapser;
use super::super::group::GroupMesh;
use super::{Court, HANDED_ON, to_open_edge};

impl Court {
    /// Hears every place that went and every witness handed on, each from the triangle that was
    /// nearest to it before places moved; gives the largest squared distance.
    pub(super) fn hear_answered<const L: usize>(
        &mut self,
        state: &Collapser<L>,
        mesh: &GroupMesh,
    ) -> f32 {
        // Numbers of the live triangles in `left`.
        let mut live = 0;
        let numbers = state.alive.iter().map(|&alive| {
            live += usize::from(alive);
            live.wrapping_sub(1)
        });
        let numbers: Vec<usize> = numbers.collect();
        self.answered.clear();
        self.answered
            .extend(state.budget.points.answered().map(|mut own| {
                own.triangle = numbers[own.triangle];
                (own, 0.0)
            }));
        for four in self.answered.chunks_mut(4) {
            let lanes = [0, 1, 2, 3].map(|lane| four[lane.min(four.len() - 1)].0);
            let squared = self
                .left
                .to_own(lanes.map(|own| own.at), lanes.map(|own| own.triangle));
            for ((_, own), squared) in four.iter_mut().zip(squared) {
                *own = squared;
            }
        }
        let answered = std::mem::take(&mut self.answered);
        // The farthest first: it sets the scale.
        let first = answered.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let mut worst = 0.0f32;
        for (own, squared) in first.into_iter().chain(&answered) {
            let mut found = (*squared, own.triangle);
            if *squared > worst {
                let near = self.left.places(own.triangle);
                let walked = self.left.nearest(own.at, &near, worst, worst);
                found = walked.unwrap_or(found);
            }
            let (mut squared, triangle) = found;
            let position = match own.source {
                Source::Witness(number) => mesh.witnesses[number as usize].position,
                // Its part hands on its outermost points.
                Source::Place(place) if mesh.answered[place as usize] => continue,
                Source::Place(place) => {
                    if mesh.rules[place as usize] == OPEN {
                        let went_to = self.went[place as usize];
                        squared = squared.max(to_open_edge(state, mesh, own.at, went_to));
                    }
                    mesh.on_grid(own.at)
                }
            };
            worst = worst.max(squared);
            if squared > HANDED_ON * HANDED_ON * worst {
                self.keep(triangle, squared, position);
            }
        }
        self.answered = answered;
        worst
    }
}

//! Cost: what it takes to collapse an edge, in distance and in attributes, whichever way is cheaper.

use glam::Vec4;

use super::collapse::{Collapser, Freedom, NONE, may_move, turned};
use super::group::GroupMesh;
use super::quadric::{dot, sub, sum};

/// Share of an edge's length that counts as an error between edges that cost nothing else, so that flat parts keep
/// triangles of good shape.
const LENGTH_WEIGHT: f32 = 1e-6;

impl<const L: usize> Collapser<L> {
    /// The cheaper way to collapse an edge, its cost and whether it is backwards.
    #[inline]
    pub(super) fn cheaper(
        &self,
        mesh: &GroupMesh,
        ends: [u16; 2],
        freedom: Freedom,
    ) -> Option<(f32, bool)> {
        let vertices = ends.map(|end| self.only[end as usize]);
        if vertices[0] == NONE || vertices[1] == NONE {
            return self.cheaper_of_many(mesh, ends, freedom);
        }
        let offset = sub(
            mesh.positions[ends[1] as usize],
            mesh.positions[ends[0] as usize],
        );
        // One vertex at each end, as nearly always: both ways at once, without a branch.
        let length = LENGTH_WEIGHT * dot(offset, offset);
        let back = offset.map(|x| -x);
        let [here, there] = ends.map(|end| &self.quadrics[end as usize]);
        let mut both = here.c + there.c;
        let mut lanes = [here.lanes(offset), there.lanes(back)];
        let far = lanes.map(|lanes| sum(lanes) + both);
        let mut may = [0, 1].map(|way| {
            let [from, to] = turned(ends, way == 1);
            may_move(mesh, from, to) && !self.is_dear(far[way], from, to)
        });
        if may == [false; 2] {
            return None;
        }
        if L > 0 {
            let change = self.change(vertices[0], vertices[1]);
            let [here, there] = vertices.map(|vertex| &self.attribute_quadrics[vertex as usize]);
            let own = [
                here.lanes(offset, &change),
                there.lanes(back, &change.map(|x| -x)),
            ];
            let constant = here.base.c + there.base.c;
            let weight = here.base.weight + there.base.weight;
            both += constant;
            for way in 0..2 {
                may[way] &= !self.budget.is_exceeded(sum(own[way]) + constant, weight);
                lanes[way] += own[way];
            }
        }
        let costs = [
            sum(lanes[0]) + both + length * here.weight,
            sum(lanes[1]) + both + length * there.weight,
        ];
        let costs = [0, 1].map(|way| if may[way] { costs[way] } else { f32::INFINITY });
        let back = costs[1] < costs[0];
        let cost = costs[0].min(costs[1]);
        (cost < f32::INFINITY).then_some((cost, back))
    }

    fn cheaper_of_many(
        &self,
        mesh: &GroupMesh,
        ends: [u16; 2],
        freedom: Freedom,
    ) -> Option<(f32, bool)> {
        let bound = |backwards: bool| {
            let [from, to] = turned(ends, backwards);
            self.distance_cost(mesh, from, to)
        };
        let bounds = [bound(false), bound(true)];
        let first = bounds[1] < bounds[0];
        let cost = |backwards: bool| {
            let [from, to] = turned(ends, backwards);
            match bounds[usize::from(backwards)] {
                f32::INFINITY => None,
                distance => self.with_attributes(mesh, from, to, freedom, distance),
            }
        };
        let own = cost(first);
        let other_bound = bounds[usize::from(!first)];
        if own.is_some_and(|own| own <= other_bound) {
            return own.map(|own| (own, first));
        }
        match (own, cost(!first)) {
            (Some(own), Some(other)) if own <= other => Some((own, first)),
            (_, Some(other)) => Some((other, !first)),
            (own, None) => own.map(|own| (own, first)),
        }
    }

    /// Least cost of moving `from` onto `to`: attributes come on top. Infinite where that is not
    /// allowed whatever lies round it, or too dear.
    #[inline]
    fn distance_cost(&self, mesh: &GroupMesh, from: u16, to: u16) -> f32 {
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let quadric = &self.quadrics[from as usize];
        let far = quadric.at(offset) + self.quadrics[to as usize].c;
        match may_move(mesh, from, to) && !self.is_dear(far, from, to) {
            true => far + LENGTH_WEIGHT * quadric.weight * dot(offset, offset),
            false => f32::INFINITY,
        }
    }

    /// Cost of moving all of `from` onto `to`; `None` where that is not allowed whatever lies round
    /// it, or too dear.
    pub(super) fn cost(
        &self,
        mesh: &GroupMesh,
        from: u16,
        to: u16,
        freedom: Freedom,
    ) -> Option<f32> {
        match self.distance_cost(mesh, from, to) {
            f32::INFINITY => None,
            distance => self.with_attributes(mesh, from, to, freedom, distance),
        }
    }

    /// The same where the cost of the distance is known.
    fn with_attributes(
        &self,
        mesh: &GroupMesh,
        from: u16,
        to: u16,
        freedom: Freedom,
        distance: f32,
    ) -> Option<f32> {
        let mut cost = distance;
        let offset = sub(mesh.positions[to as usize], mesh.positions[from as usize]);
        let first = self.first_vertex(mesh, from);
        if self.ring[first as usize] == first {
            // One vertex: any vertex of the other end that shares a triangle with it takes its corners.
            if L > 0 {
                let target = self.first_vertex(mesh, to);
                let target = match self.ring[target as usize] == target {
                    true => target,
                    false => self.partner(from, to)?,
                };
                cost += self.attribute_cost(offset, first, target);
            }
            return Some(cost);
        }
        let (pairs, count) = self.pairs(mesh, from, to, freedom)?;
        if L > 0 {
            for &[own, target] in &pairs[..count] {
                cost += self.attribute_cost(offset, own, target);
            }
        }
        Some(cost)
    }

    pub(super) fn attribute_cost(&self, offset: [f32; 3], own: u16, target: u16) -> f32 {
        let change = self.change(own, target);
        let quadric = &self.attribute_quadrics[own as usize];
        let other = &self.attribute_quadrics[target as usize];
        sum(quadric.lanes(offset, &change)) + quadric.base.c + other.base.c
    }

    pub(super) fn change(&self, own: u16, target: u16) -> [Vec4; L] {
        let (from, to) = (
            &self.attributes[own as usize],
            &self.attributes[target as usize],
        );
        std::array::from_fn(|k| to[k] - from[k])
    }
}

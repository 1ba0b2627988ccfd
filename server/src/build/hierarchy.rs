//! The eight-wide hierarchy over all groups: one tree a round, so that errors in a node are alike, under one root.

use lodestream_format::hierarchy::{Child, Group, Hierarchy, LEAF_FLAG, NO_CHILD, Node};
use lodestream_format::limits::HIERARCHY_WIDTH;
use lodestream_format::{Aabb, Sphere};

use super::dag::Dag;
use super::paginate::Pages;
use super::vertex::Grids;

/// Builds the hierarchy of laid-out groups. Neighbours in page order are neighbours in space, so eight in a row make a node.
pub(super) fn hierarchy(grids: &Grids, dag: &Dag, pages: &Pages) -> Hierarchy {
    let mut hierarchy = Hierarchy::default();
    let mut leaves: Vec<(u32, Child)> = Vec::with_capacity(pages.groups.len());
    for (index, placed) in pages.groups.iter().enumerate() {
        let group = &dag.groups[placed.group as usize];
        let members = || {
            let members = pages.clusters[placed.clusters.clone()].iter();
            members.map(|&cluster| &dag.clusters[cluster as usize])
        };
        let aabb = members().fold(Aabb::EMPTY, |sum, info| sum.merge(&info.aabb(grids)));
        hierarchy.groups.push(Group {
            lod_center: group.lod_sphere.center,
            lod_radius: group.lod_sphere.radius,
            parent_error_metres: group.parent_error_metres,
            first_part: hierarchy.parts.len() as u32,
            part_count: placed.parts.len() as u32,
            first_page: placed.first_page,
            level: group.level as u32,
            cluster_count: placed.clusters.len() as u32,
            triangle_count: members().map(|info| info.triangle_count as u32).sum(),
            spare: 0,
        });
        hierarchy.parts.extend(&placed.parts);
        let reference = index as u32 | LEAF_FLAG;
        leaves.push((
            group.round,
            child(group.lod_sphere, aabb, group.parent_error_metres, reference),
        ));
    }
    let mut nodes = Vec::new();
    let mut rounds = Vec::new();
    for round in leaves.chunk_by(|a, b| a.0 == b.0) {
        let mut row: Vec<Child> = round.iter().map(|&(_, child)| child).collect();
        while row.len() > 1 {
            row = gather(&mut nodes, &row);
        }
        rounds.extend(row);
    }
    // At least once, so that even one group has a node above it.
    rounds = gather(&mut nodes, &rounds);
    while rounds.len() > 1 {
        rounds = gather(&mut nodes, &rounds);
    }
    hierarchy.nodes = root_first(nodes);
    hierarchy.depth = depth(&hierarchy.nodes);
    hierarchy
}

fn child(sphere: Sphere, aabb: Aabb, max_parent_error_metres: f32, reference: u32) -> Child {
    Child {
        lod_center: sphere.center,
        lod_radius: sphere.radius,
        aabb_min: aabb.min,
        max_parent_error_metres,
        aabb_max: aabb.max,
        reference,
    }
}

/// Puts every eight children of a row into a node; gives the row above.
fn gather(nodes: &mut Vec<Node>, row: &[Child]) -> Vec<Child> {
    row.chunks(HIERARCHY_WIDTH)
        .map(|eight| {
            let mut node = Node {
                children: [Child::EMPTY; HIERARCHY_WIDTH],
            };
            node.children[..eight.len()].copy_from_slice(eight);
            nodes.push(node);
            let spheres: Vec<Sphere> = eight.iter().map(Child::lod_sphere).collect();
            let aabb = eight
                .iter()
                .fold(Aabb::EMPTY, |sum, child| sum.merge(&child.aabb()));
            let error = eight
                .iter()
                .map(|child| child.max_parent_error_metres)
                .fold(0.0, f32::max);
            child(
                Sphere::enclosing(&spheres),
                aabb,
                error,
                nodes.len() as u32 - 1,
            )
        })
        .collect()
}

/// Turns the order round: nodes were made children first.
fn root_first(mut nodes: Vec<Node>) -> Vec<Node> {
    let last = nodes.len() as u32 - 1;
    nodes.reverse();
    for child in nodes.iter_mut().flat_map(|node| &mut node.children) {
        if child.reference != NO_CHILD && child.reference & LEAF_FLAG == 0 {
            child.reference = last - child.reference;
        }
    }
    nodes
}

fn depth(nodes: &[Node]) -> u32 {
    let mut depths = vec![1; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        for child in &node.children {
            if child.reference != NO_CHILD && child.reference & LEAF_FLAG == 0 {
                depths[child.reference as usize] = depths[index] + 1;
            }
        }
    }
    depths.into_iter().max().unwrap_or(1)
}

//! Nodes: the chosen scene's tree to instances in world space.

mod forest;
mod instancing;
mod joints;
mod shapes;
mod transform;

use std::mem::size_of;

use glam::DAffine3;

use super::Document;
use super::allowance::Allowance;
use super::buffers::out_of_range;
use super::document::Node;
use super::error::{Read, malformed};
use super::scene::Instance;
use super::warnings::Warnings;
use forest::Forest;
use shapes::Shapes;

pub(super) use shapes::Shape;

/// Meshes that the chosen scene shows, each in the poses that it stands in.
pub(super) struct Placed {
    /// `mesh` is an index into `shapes`.
    pub(super) instances: Vec<Instance>,
    /// In the order of the document's meshes; an instance shows each.
    pub(super) shapes: Vec<Shape>,
    pub(super) scene_name: Option<String>,
}

/// Bytes of buffers for an instance: a translation has twelve, and nodes may share them.
const BYTES_PER_INSTANCE: u64 = 2;
const INSTANCES_ALWAYS: u64 = 1 << 17;
/// Paths of the tree for each of its nodes, where nodes have several parents.
const PATHS_PER_NODE: u64 = 4;
/// Memory of an instance: here, and merged with those of other files.
const INSTANCE_BYTES: u64 = 3 * size_of::<Instance>() as u64;

/// Walks the default scene, else the first, else all root nodes; places every mesh once where there
/// are no nodes.
pub(super) fn place(
    document: &Document,
    allowance: &Allowance,
    warnings: &mut Warnings,
) -> Read<Placed> {
    let root = document.root;
    let (scene_name, roots) = forest::choose_scene(root, warnings)?;
    let forest = Forest::new(root, &roots)?;
    let mut shapes = Shapes::new(document, &forest, allowance);
    let mut instances = Vec::new();
    if root.nodes.is_empty() && root.scenes.is_empty() {
        let meshes = root.meshes.len();
        warnings.add(
            "meshes of a file without nodes placed at its origin",
            meshes as u64,
            "nodes",
        );
        for mesh in 0..meshes {
            instances.push(Instance {
                mesh: shapes.plain(mesh)?,
                world_from_object: DAffine3::IDENTITY,
            });
        }
    } else {
        walk(
            document,
            allowance,
            roots,
            &mut shapes,
            &mut instances,
            warnings,
        )?;
        for at in (0..root.meshes.len()).filter(|&at| !shapes.shows(at)) {
            let what = "meshes that the scene does not show left out";
            warnings.add(what, 1, &format!("meshes[{at}]"));
        }
    }
    Ok(Placed {
        shapes: shapes.into_sorted(&mut instances),
        instances,
        scene_name,
    })
}

/// Depth first in the document's order, on a stack of its own: chains may be as long as the file. A
/// node that several paths lead to stands at the end of each, but once below each parent.
fn walk(
    document: &Document,
    allowance: &Allowance,
    roots: Vec<usize>,
    shapes: &mut Shapes,
    instances: &mut Vec<Instance>,
    warnings: &mut Warnings,
) -> Read<()> {
    let nodes = &document.root.nodes;
    let bytes = document.buffers.total_bytes();
    let most = nodes.len() as u64 + (bytes / BYTES_PER_INSTANCE).max(INSTANCES_ALWAYS);
    let most_again = INSTANCES_ALWAYS.max(nodes.len() as u64 * PATHS_PER_NODE);
    let mut seen = vec![false; nodes.len()];
    let mut again = 0u64;
    let mut open: Vec<Step> = Vec::new();
    let mut times = vec![0; nodes.len()];
    let first = (DAffine3::IDENTITY, 1);
    let repeated = push_once(&mut open, roots.into_iter(), first, &mut times);
    warnings.add(REPEATED, repeated, "scenes");
    while let Some((at, world_from_parent, paths)) = open.pop() {
        let node = forest::node(document.root, at)?;
        let place = format!("nodes[{at}]");
        // Paths that are not drawn count, too: a small file must not name very many.
        again = again.saturating_add(paths - u64::from(!seen[at]));
        if again > most_again {
            let found = format!("more than {most_again} paths to nodes with several");
            return Err(malformed(place, "a node with one parent", found));
        }
        if seen[at] {
            let what = "nodes with several parents, or a parent beside the scene, drawn for each";
            warnings.add(what, 1, &place);
            allowance.take(INSTANCE_BYTES, &place)?;
        }
        seen[at] = true;
        if is_hidden(node) {
            warnings.add("nodes that are not visible left out", 1, &place);
            continue;
        }
        let parent_from_node = transform::parent_from_node(node, &place, warnings)?;
        let world_from_node = world_from_parent * parent_from_node;
        if !world_from_node.is_finite() {
            return Err(malformed(
                place,
                "a finite transform to the world",
                "an overflow",
            ));
        }
        if let Some(mesh) = node.mesh {
            let meshes = document.root.meshes.len();
            if mesh.value() >= meshes {
                let place = format!("{place}.mesh");
                return Err(out_of_range(&place, "meshes", meshes, mesh.value()));
            }
            let offsets = instancing::instancing(document, node, &place, warnings)?;
            if let Some(offsets) = offsets {
                if instances.len() as u64 + offsets.count as u64 > most {
                    let expected = format!("{most} instances at most from {bytes} bytes");
                    return Err(malformed(place, expected, "more"));
                }
                allowance.take(offsets.count as u64 * INSTANCE_BYTES, &place)?;
                let mesh = shapes.unskinned(mesh.value(), node, &place, warnings)?;
                for offset in 0..offsets.count {
                    let offset = offsets.get(offset, &place)?;
                    instances.push(Instance {
                        mesh,
                        world_from_object: world_from_node * offset,
                    });
                }
            } else {
                let shown = shapes.shown(mesh.value(), node, &place, warnings)?;
                instances.push(Instance {
                    mesh: shown.shape,
                    world_from_object: shown.world_from_skin.unwrap_or(world_from_node),
                });
            }
        }
        let children = node.children.iter().map(|child| child.value());
        let repeated = push_once(&mut open, children, (world_from_node, paths), &mut times);
        warnings.add(REPEATED, repeated, &place);
    }
    Ok(())
}

/// A node to visit, its parent's transform, and the paths to it that the file has on this way.
type Step = (usize, DAffine3, u64);

/// Warning for what [`push_once`] counts.
const REPEATED: &str = "nodes listed again below the same parent or in the scene drawn once";

/// Pushes each of `nodes` once, the first on top; gives how many are listed again. `times` is all
/// zero, before and after.
fn push_once(
    open: &mut Vec<Step>,
    nodes: impl DoubleEndedIterator<Item = usize> + Clone,
    (world_from_parent, paths): (DAffine3, u64),
    times: &mut [u64],
) -> u64 {
    let mut repeated = 0;
    for node in nodes.clone() {
        repeated += u64::from(times[node] > 0);
        times[node] += 1;
    }
    for node in nodes.rev() {
        let listed = std::mem::take(&mut times[node]);
        if listed > 0 {
            open.push((node, world_from_parent, paths.saturating_mul(listed)));
        }
    }
    repeated
}

/// By `KHR_node_visibility`; nodes below are hidden, too.
fn is_hidden(node: &Node) -> bool {
    let visibility = node
        .extensions
        .as_ref()
        .and_then(|it| it.visibility.as_ref());
    visibility.and_then(|it| it.visible) == Some(false)
}

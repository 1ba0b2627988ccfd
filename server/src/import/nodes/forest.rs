//! Forest: which node hangs on which, and the nodes that the chosen scene begins with.

use super::super::buffers::out_of_range;
use super::super::document::{Node, Root, Tolerant};
use super::super::error::{Fault, Read, malformed};
use super::super::scene::short_name;
use super::super::warnings::Warnings;

/// Parents of the document's nodes.
pub(super) struct Forest {
    /// The first that lists the node, where several do; of those that the scene shows, if any.
    pub(super) parent: Vec<Option<usize>>,
}

impl Forest {
    /// Checks the nodes that `roots` lead to, all of a document without scenes: each can be read,
    /// its children exist, and none hangs below itself.
    pub(super) fn new(root: &Root, roots: &[usize]) -> Read<Self> {
        let nodes = &root.nodes;
        let mut parent = vec![None; nodes.len()];
        let mut waiting = vec![0u32; nodes.len()];
        let mut is_shown = vec![false; nodes.len()];
        let mut open = match root.scenes.is_empty() {
            true => (0..nodes.len()).collect(),
            false => roots.to_vec(),
        };
        let mut shown = Vec::new();
        while let Some(at) = open.pop() {
            if std::mem::replace(&mut is_shown[at], true) {
                continue;
            }
            shown.push(at);
            for (place, child) in node(root, at)?.children.iter().enumerate() {
                let child = child.value();
                let Some(count) = waiting.get_mut(child) else {
                    let place = format!("nodes[{at}].children[{place}]");
                    return Err(out_of_range(&place, "nodes", nodes.len(), child));
                };
                *count += 1;
                open.push(child);
            }
        }
        // A node is reached once all its parents are; nodes on and below cycles never are.
        open.extend(shown.iter().filter(|&&at| waiting[at] == 0));
        let mut reached = 0;
        while let Some(at) = open.pop() {
            reached += 1;
            for child in &node(root, at)?.children {
                let child = child.value();
                waiting[child] -= 1;
                if waiting[child] == 0 {
                    open.push(child);
                }
            }
        }
        if reached < shown.len() {
            let at = waiting.iter().position(|&count| count > 0);
            return Err(on_a_cycle(&format!("nodes[{}]", at.unwrap_or_default())));
        }
        for shown in [true, false] {
            let listing = (0..nodes.len()).filter(|&at| is_shown[at] == shown);
            for (at, node) in listing.filter_map(|at| Some((at, nodes[at].read()?))) {
                for child in &node.children {
                    // A child that does not exist hangs on a node that is not shown.
                    if let Some(parent) = parent.get_mut(child.value()) {
                        parent.get_or_insert(at);
                    }
                }
            }
        }
        Ok(Self { parent })
    }
}

/// `nodes[at]`, which exists, unless it cannot be read.
pub(super) fn node(root: &Root, at: usize) -> Read<&Node> {
    let found = root.nodes[at].0.as_ref();
    found.map_err(|reason| malformed(format!("nodes[{at}]"), "a node", reason))
}

/// A node without a root above it.
pub(super) fn on_a_cycle(place: &str) -> Fault {
    let found = "a node on or below a cycle of children";
    malformed(place, "a node below a root", found)
}

/// The name and the first nodes of the default scene, else of the first; without a scene all nodes
/// that have no parent.
pub(super) fn choose_scene(
    root: &Root,
    warnings: &mut Warnings,
) -> Read<(Option<String>, Vec<usize>)> {
    let chosen = root.scene.map_or(0, |scene| scene.value());
    let Some(scene) = root.scenes.get(chosen) else {
        if root.scene.is_some() {
            return Err(out_of_range("scene", "scenes", root.scenes.len(), chosen));
        }
        let mut is_child = vec![false; root.nodes.len()];
        let nodes = root.nodes.iter().filter_map(Tolerant::read);
        for child in nodes.flat_map(|node| &node.children) {
            if let Some(is_child) = is_child.get_mut(child.value()) {
                *is_child = true;
            }
        }
        let roots = (0..root.nodes.len()).filter(|&at| !is_child[at]);
        return Ok((None, roots.collect()));
    };
    warnings.add(
        "scenes beside the chosen one left out",
        root.scenes.len() as u64 - 1,
        "scenes",
    );
    let mut roots = Vec::with_capacity(scene.nodes.len());
    for (at, node) in scene.nodes.iter().enumerate() {
        let node = node.value();
        if node >= root.nodes.len() {
            let place = format!("scenes[{chosen}].nodes[{at}]");
            return Err(out_of_range(&place, "nodes", root.nodes.len(), node));
        }
        roots.push(node);
    }
    Ok((scene.name.0.as_deref().map(short_name), roots))
}

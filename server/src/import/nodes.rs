//! Nodes: the chosen scene's tree to instances in world space.

use std::mem::size_of;

use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::json::accessor::ComponentType::{F32, I8, I16};
use gltf::json::{Node, Root};

use super::Document;
use super::accessor::{Accessor, Component};
use super::allowance::Allowance;
use super::buffers::out_of_range;
use super::error::{Read, malformed, short};
use super::features;
use super::scene::{Instance, short_name};
use super::warnings::Warnings;

/// What the chosen scene shows.
pub(super) struct Placed {
    /// `mesh` is an index into the document's meshes.
    pub(super) instances: Vec<Instance>,
    /// For each of the document's meshes whether an instance shows it.
    pub(super) mesh_used: Vec<bool>,
    pub(super) scene_name: Option<String>,
}

/// Bytes of buffers for an instance: a translation has twelve, and nodes may share them.
const BYTES_PER_INSTANCE: u64 = 2;
const INSTANCES_ALWAYS: u64 = 1 << 17;
/// Memory of an instance: here, and merged with those of other files.
const INSTANCE_BYTES: u64 = 3 * size_of::<Instance>() as u64;

/// Walks the default scene, else the first, else all root nodes; places every mesh once where there are no nodes.
pub(super) fn place(
    document: &Document,
    allowance: &Allowance,
    warnings: &mut Warnings,
) -> Read<Placed> {
    let root = document.root;
    let parents = check_forest(root)?;
    let (scene_name, roots) = choose_scene(root, &parents, warnings)?;
    let mut placed = Placed {
        instances: Vec::new(),
        mesh_used: vec![false; root.meshes.len()],
        scene_name,
    };
    if root.nodes.is_empty() && root.scenes.is_empty() {
        let meshes = root.meshes.len();
        warnings.add(
            "meshes of a file without nodes placed at its origin",
            meshes as u64,
            "nodes",
        );
        for mesh in 0..meshes as u32 {
            placed.show(mesh, DAffine3::IDENTITY);
        }
        return Ok(placed);
    }
    walk(document, allowance, roots, &mut placed, warnings)?;
    for (at, _) in placed
        .mesh_used
        .iter()
        .enumerate()
        .filter(|(_, used)| !**used)
    {
        let what = "meshes that the scene does not show left out";
        warnings.add(what, 1, &format!("meshes[{at}]"));
    }
    Ok(placed)
}

impl Placed {
    fn show(&mut self, mesh: u32, world_from_object: DAffine3) {
        self.mesh_used[mesh as usize] = true;
        self.instances.push(Instance {
            mesh,
            world_from_object,
        });
    }
}

/// Every node has one parent at most and no cycle; gives the parents.
fn check_forest(root: &Root) -> Read<Vec<Option<usize>>> {
    let nodes = &root.nodes;
    let mut parents = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for (at, child) in node.children.iter().flatten().enumerate() {
            let place = || format!("nodes[{parent}].children[{at}]");
            let child = child.value();
            match parents.get(child) {
                None => return Err(out_of_range(&place(), "nodes", nodes.len(), child)),
                Some(Some(first)) => {
                    let found = format!("node {child} again, a child of nodes[{first}] already");
                    return Err(malformed(place(), "a node with one parent", found));
                }
                Some(None) => parents[child] = Some(parent),
            }
        }
    }
    // With one parent each, what no root leads to hangs on a cycle.
    let mut reached = vec![false; nodes.len()];
    let mut open: Vec<usize> = (0..nodes.len())
        .filter(|&at| parents[at].is_none())
        .collect();
    while let Some(at) = open.pop() {
        reached[at] = true;
        open.extend(
            nodes[at]
                .children
                .iter()
                .flatten()
                .map(|child| child.value()),
        );
    }
    match reached.iter().position(|reached| !reached) {
        None => Ok(parents),
        Some(at) => {
            let place = format!("nodes[{at}]");
            Err(malformed(
                place,
                "a node below a root",
                "a node on or below a cycle of children",
            ))
        }
    }
}

/// The name and the root nodes of the scene to read.
fn choose_scene(
    root: &Root,
    parents: &[Option<usize>],
    warnings: &mut Warnings,
) -> Read<(Option<String>, Vec<usize>)> {
    let chosen = root.scene.map_or(0, |scene| scene.value());
    let Some(scene) = root.scenes.get(chosen) else {
        if root.scene.is_some() {
            return Err(out_of_range("scene", "scenes", root.scenes.len(), chosen));
        }
        let roots = (0..parents.len())
            .filter(|&at| parents[at].is_none())
            .collect();
        return Ok((None, roots));
    };
    warnings.add(
        "scenes beside the chosen one left out",
        root.scenes.len() as u64 - 1,
        "scenes",
    );
    let mut listed = vec![false; parents.len()];
    let mut roots = Vec::with_capacity(scene.nodes.len());
    for (at, node) in scene.nodes.iter().enumerate() {
        let place = format!("scenes[{chosen}].nodes[{at}]");
        let node = node.value();
        match parents.get(node) {
            None => return Err(out_of_range(&place, "nodes", parents.len(), node)),
            Some(Some(parent)) => {
                let found = format!("node {node}, a child of nodes[{parent}]");
                return Err(malformed(place, "a root node", found));
            }
            Some(None) if listed[node] => {
                let found = format!("node {node} again");
                return Err(malformed(place, "each node once", found));
            }
            Some(None) => {}
        }
        listed[node] = true;
        roots.push(node);
    }
    Ok((scene.name.as_deref().map(short_name), roots))
}

/// Depth first in the document's order, on a stack of its own: chains may be as long as the file.
fn walk(
    document: &Document,
    allowance: &Allowance,
    roots: Vec<usize>,
    placed: &mut Placed,
    warnings: &mut Warnings,
) -> Read<()> {
    let nodes = &document.root.nodes;
    let bytes = document.buffers.total_bytes();
    let most = nodes.len() as u64 + (bytes / BYTES_PER_INSTANCE).max(INSTANCES_ALWAYS);
    let mut open: Vec<(usize, DAffine3)> = Vec::new();
    open.extend(roots.into_iter().rev().map(|at| (at, DAffine3::IDENTITY)));
    while let Some((at, world_from_parent)) = open.pop() {
        let node = &nodes[at];
        let place = format!("nodes[{at}]");
        let world_from_node = world_from_parent * transform(node, &place, warnings)?;
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
            let mesh = mesh.value() as u32;
            match instancing(document, node, &place, warnings)? {
                None => placed.show(mesh, world_from_node),
                Some(offsets) => {
                    if placed.instances.len() as u64 + offsets.count as u64 > most {
                        let expected = format!("{most} instances at most from {bytes} bytes");
                        return Err(malformed(place, expected, "more"));
                    }
                    allowance.take(offsets.count as u64 * INSTANCE_BYTES, &place)?;
                    for offset in 0..offsets.count {
                        let offset = offsets.get(offset, &place)?;
                        placed.show(mesh, world_from_node * offset);
                    }
                }
            }
        }
        let children = node.children.iter().flatten().rev();
        open.extend(children.map(|child| (child.value(), world_from_node)));
    }
    Ok(())
}

/// `parent_from_node`.
fn transform(node: &Node, place: &str, warnings: &mut Warnings) -> Read<DAffine3> {
    let finite = |values: &[f32], name: &str| match values.iter().all(|it| it.is_finite()) {
        true => Ok(()),
        false => {
            let place = format!("{place}.{name}");
            Err(malformed(
                place,
                "numbers within f32",
                format!("{values:?}"),
            ))
        }
    };
    if let Some(matrix) = &node.matrix {
        finite(matrix, "matrix")?;
        let place = format!("{place}.matrix");
        if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
            let expected = "either a matrix or translation, rotation and scale";
            return Err(malformed(place, expected, "both"));
        }
        let last_row = [matrix[3], matrix[7], matrix[11], matrix[15]];
        // Exporters multiply in f32, so the last row may be off by a rounding.
        let off = |(found, expected): (&f32, f32)| (found - expected).abs() > 1e-5;
        if last_row.iter().zip([0.0, 0.0, 0.0, 1.0]).any(off) {
            return Err(malformed(
                place,
                "a last row of 0 0 0 1",
                format!("{last_row:?}"),
            ));
        }
        return Ok(DAffine3::from_mat4(DMat4::from_cols_array(
            &matrix.map(f64::from),
        )));
    }
    let translation = node.translation.unwrap_or([0.0; 3]);
    let scale = node.scale.unwrap_or([1.0; 3]);
    let rotation = node.rotation.unwrap_or_default().0;
    finite(&translation, "translation")?;
    finite(&scale, "scale")?;
    finite(&rotation, "rotation")?;
    if rotation == [0.0; 4] {
        warnings.add("rotations of no length read as none", 1, place);
    }
    Ok(compose(translation, rotation, scale))
}

/// Translation after rotation after scale; the quaternion is x, y, z, w and need not have unit length.
fn compose(translation: [f32; 3], rotation: [f32; 4], scale: [f32; 3]) -> DAffine3 {
    let rotation = DQuat::from_array(rotation.map(f64::from));
    let rotation = match rotation.length_squared() > 0.0 {
        true => rotation.normalize(),
        false => DQuat::IDENTITY,
    };
    DAffine3::from_scale_rotation_translation(
        DVec3::from(scale.map(f64::from)),
        rotation,
        DVec3::from(translation.map(f64::from)),
    )
}

/// The transforms of `EXT_mesh_gpu_instancing`.
struct Instancing {
    count: usize,
    translation: Option<Vec<[f32; 3]>>,
    rotation: Option<Vec<[f32; 4]>>,
    scale: Option<Vec<[f32; 3]>>,
}

const FLOAT: &[Component] = &[(F32, None)];
const ROTATION: &[Component] = &[(F32, None), (I8, Some(true)), (I16, Some(true))];

fn instancing(
    document: &Document,
    node: &Node,
    place: &str,
    warnings: &mut Warnings,
) -> Read<Option<Instancing>> {
    let extensions = node.extensions.as_ref().map(|it| &it.others);
    let Some(extension) = extensions.and_then(|it| it.get(features::INSTANCING)) else {
        return Ok(None);
    };
    let place = format!("{place}.extensions.{}.attributes", features::INSTANCING);
    let Some(attributes) = extension.get("attributes").and_then(|it| it.as_object()) else {
        return Err(malformed(place, "an object of accessors", "none"));
    };
    let mut instancing = Instancing {
        count: 0,
        translation: None,
        rotation: None,
        scale: None,
    };
    let mut count = None;
    for (name, index) in attributes {
        let name = short(name);
        let place = format!("{place}.{name}");
        let Some(index) = index.as_u64().and_then(|it| usize::try_from(it).ok()) else {
            return Err(malformed(place, "an accessor's index", index));
        };
        let (lanes, components) = match name.as_str() {
            "TRANSLATION" | "SCALE" => (3, FLOAT),
            "ROTATION" => (4, ROTATION),
            _ => {
                warnings.add(format!("instance attributes {name} left out"), 1, &place);
                continue;
            }
        };
        let accessor = Accessor::open(document, index, &place)?;
        accessor.expect(&[lanes], components)?;
        if *count.get_or_insert(accessor.count) != accessor.count {
            let expected = "as many elements as the other attributes";
            return Err(malformed(place, expected, accessor.count));
        }
        // An accessor without a buffer view has few elements, any other its bytes in the file.
        match name.as_str() {
            "TRANSLATION" => instancing.translation = Some(accessor.all_floats()?),
            "SCALE" => instancing.scale = Some(accessor.all_floats()?),
            _ => instancing.rotation = Some(accessor.all_floats()?),
        }
    }
    match count {
        Some(count) => {
            instancing.count = count;
            Ok(Some(instancing))
        }
        None => Err(malformed(place, "TRANSLATION, ROTATION or SCALE", "none")),
    }
}

impl Instancing {
    /// `node_from_instance` of instance `at < count`.
    fn get(&self, at: usize, place: &str) -> Read<DAffine3> {
        let translation = self.translation.as_ref().map(|it| it[at]);
        let rotation = self.rotation.as_ref().map(|it| it[at]);
        let scale = self.scale.as_ref().map(|it| it[at]);
        let node_from_instance = compose(
            translation.unwrap_or([0.0; 3]),
            rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]),
            scale.unwrap_or([1.0; 3]),
        );
        match node_from_instance.is_finite() {
            true => Ok(node_from_instance),
            false => {
                let place = format!("{place}.extensions.{}", features::INSTANCING);
                Err(malformed(
                    place,
                    "finite transforms",
                    format!("others at instance {at}"),
                ))
            }
        }
    }
}

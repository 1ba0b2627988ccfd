//! Joints: where the skeleton of a skin stands while nothing moves it, by its nodes as the file
//! writes them.

use std::sync::Arc;

use glam::{DAffine3, DMat4};

use super::super::Document;
use super::super::accessor::Accessor;
use super::super::accessor::ComponentType::F32;
use super::super::allowance::Allowance;
use super::super::buffers::out_of_range;
use super::super::error::{Read, malformed};
use super::super::warnings::Warnings;
use super::forest::{self, Forest, on_a_cycle};
use super::transform::parent_from_node;

/// Memory of a joint of a skin: three matrices while they are made, one of them to the end.
const JOINT_BYTES: u64 = 4 * size_of::<DAffine3>() as u64;

/// A skin at rest.
pub(super) struct SkinPose {
    /// The frame that the deformed vertices are given in.
    pub(super) world_from_skin: DAffine3,
    /// By joint: from a vertex as the file has it to where that joint takes it, in the frame.
    /// `None` where all take it to the same place: the frame alone places the mesh.
    pub(super) joints: Option<Arc<[DAffine3]>>,
}

/// Places nodes in the world, each once.
pub(super) struct Joints<'a> {
    document: &'a Document<'a>,
    forest: &'a Forest,
    allowance: &'a Allowance<'a>,
    /// By node; empty until a skin is asked for.
    world_from_node: Vec<Option<DAffine3>>,
}

impl<'a> Joints<'a> {
    pub(super) fn new(
        document: &'a Document<'a>,
        forest: &'a Forest,
        allowance: &'a Allowance<'a>,
    ) -> Self {
        Self {
            document,
            forest,
            allowance,
            world_from_node: Vec::new(),
        }
    }

    /// The rest pose of `skins[index]`; `None`, with a warning, for a skin without joints.
    pub(super) fn pose(&mut self, index: usize, warnings: &mut Warnings) -> Read<Option<SkinPose>> {
        let place = format!("skins[{index}]");
        let skin = &self.document.root.skins[index];
        if skin.joints.is_empty() {
            warnings.add("skins without joints left out", 1, &place);
            return Ok(None);
        }
        let bytes = skin.joints.len() as u64 * JOINT_BYTES;
        self.allowance.take(bytes, &place)?;
        let inverse_bind = self.inverse_bind(index, &place, warnings)?;
        let mut skinning = Skinning::default();
        for (at, joint) in skin.joints.iter().enumerate() {
            let place = format!("{place}.joints[{at}]");
            let world_from_joint = self.world_from_node(joint.value(), &place, warnings)?;
            let joint_from_mesh = inverse_bind.get(at).copied();
            let joint_from_mesh = joint_from_mesh.unwrap_or(DAffine3::IDENTITY);
            if !skinning.add(world_from_joint, joint_from_mesh) {
                let expected = "a finite transform to the world";
                return Err(malformed(place, expected, "an overflow"));
            }
        }
        Ok(Some(skinning.into_pose()))
    }

    /// One matrix for each joint, or none at all.
    fn inverse_bind(
        &self,
        index: usize,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<Vec<DAffine3>> {
        let skin = &self.document.root.skins[index];
        let Some(accessor) = skin.inverse_bind_matrices else {
            return Ok(Vec::new());
        };
        let place = format!("{place}.inverseBindMatrices");
        let accessor = Accessor::open(self.document, accessor.value(), &place)?;
        accessor.expect(&[16], &[(F32, None)])?;
        if accessor.count < skin.joints.len() {
            let expected = format!("{} matrices, one for each joint", skin.joints.len());
            return Err(malformed(place, expected, accessor.count));
        }
        let wanted: Vec<u32> = (0..skin.joints.len() as u32).collect();
        let (mut matrices, mut off) = (Vec::with_capacity(wanted.len()), 0);
        accessor.visit_floats(&wanted, |_, matrix: [f32; 16]| {
            let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
            let row = matrix.row(3).to_array();
            let is_off = |(found, expected): (f64, f64)| (found - expected).abs() > 1e-5;
            off += u64::from(row.into_iter().zip([0.0, 0.0, 0.0, 1.0]).any(is_off));
            matrices.push(DAffine3::from_mat4(matrix));
        })?;
        let what = "inverse bind matrices whose last row is not 0 0 0 1 read as if it were";
        warnings.add(what, off, &place);
        Ok(matrices)
    }

    fn world_from_node(
        &mut self,
        node: usize,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<DAffine3> {
        let nodes = &self.document.root.nodes;
        if node >= nodes.len() {
            return Err(out_of_range(place, "nodes", nodes.len(), node));
        }
        if self.world_from_node.is_empty() {
            let bytes = size_of::<Option<DAffine3>>() * nodes.len();
            self.allowance.take(bytes as u64, "nodes, as joints")?;
            self.world_from_node.resize(nodes.len(), None);
        }
        // Up to a node that is known, then down again.
        let mut chain = Vec::new();
        let mut next = Some(node);
        let mut world = DAffine3::IDENTITY;
        while let Some(at) = next {
            if let Some(known) = self.world_from_node[at] {
                world = known;
                break;
            }
            // Nodes that the scene does not show are not checked.
            if chain.len() > nodes.len() {
                return Err(on_a_cycle(place));
            }
            chain.push(at);
            next = self.forest.parent[at];
        }
        for &at in chain.iter().rev() {
            let node = forest::node(self.document.root, at)?;
            world *= parent_from_node(node, &format!("nodes[{at}]"), warnings)?;
            self.world_from_node[at] = Some(world);
        }
        Ok(world)
    }
}

/// The joints' matrices, gathered.
#[derive(Default)]
struct Skinning {
    world_from_mesh: Vec<DAffine3>,
    /// How far joints lie from the mesh's origin, in the world: what their matrices are rounded by.
    reach: f64,
}

impl Skinning {
    /// Whether the joint's matrix is finite.
    fn add(&mut self, world_from_joint: DAffine3, joint_from_mesh: DAffine3) -> bool {
        let arm = world_from_joint.transform_vector3(joint_from_mesh.translation);
        self.reach = self.reach.max(arm.abs().max_element());
        let world_from_mesh = world_from_joint * joint_from_mesh;
        self.world_from_mesh.push(world_from_mesh);
        world_from_mesh.is_finite()
    }

    fn into_pose(self) -> SkinPose {
        // Inverse bind matrices are f32 and made of many products: a few of its steps.
        const ROUNDING: f64 = 1.0 / (1u64 << 20) as f64;
        let first = self.world_from_mesh[0];
        let size = largest(&first);
        let is_first = |other: &DAffine3| {
            let turned = (other.matrix3 - first.matrix3).to_cols_array();
            let moved = (other.translation - first.translation).abs().max_element();
            turned.iter().all(|it| it.abs() <= ROUNDING * size) && moved <= ROUNDING * self.reach
        };
        if self.world_from_mesh.iter().all(is_first) {
            return SkinPose {
                world_from_skin: first,
                joints: None,
            };
        }
        // In the first joint's frame the numbers are about the file's own, however far it stands.
        let is_regular = first.matrix3.determinant().abs() > 1e-9 * size.powi(3);
        let world_from_skin = match is_regular {
            true => first,
            false => DAffine3::from_translation(first.translation),
        };
        let skin_from_world = world_from_skin.inverse();
        let joints = self.world_from_mesh.iter().map(|it| skin_from_world * *it);
        SkinPose {
            world_from_skin,
            joints: Some(joints.collect()),
        }
    }
}

/// The largest component of the linear part.
fn largest(transform: &DAffine3) -> f64 {
    let components = transform.matrix3.to_cols_array();
    components.iter().fold(0.0, |most, it| most.max(it.abs()))
}

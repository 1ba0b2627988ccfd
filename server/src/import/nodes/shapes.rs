//! Shapes: the meshes that a scene shows, once for each pose that skins and morph targets give.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DAffine3;

use super::super::Document;
use super::super::allowance::Allowance;
use super::super::buffers::out_of_range;
use super::super::document::{Mesh, Node};
use super::super::error::Read;
use super::super::pose::Pose;
use super::super::scene::Instance;
use super::super::warnings::Warnings;
use super::forest::Forest;
use super::joints::{Joints, SkinPose};

/// A mesh in one pose.
#[derive(Clone, Debug)]
pub(in crate::import) struct Shape {
    /// Index into the document's meshes.
    pub(in crate::import) mesh: usize,
    /// `None`: as its vertices stand in the file.
    pub(in crate::import) pose: Option<Arc<Pose>>,
}

/// The shape that a node shows.
pub(super) struct Shown {
    pub(super) shape: u32,
    /// Where the joints of its skin place it, the node's own transform left aside; `None` without
    /// a skin.
    pub(super) world_from_skin: Option<DAffine3>,
}

/// Bytes of a primitive and of a mesh until they are built, for each pose beyond the first.
const PRIMITIVE_BYTES: u64 = 1024;
const MESH_BYTES: u64 = 2048;
/// Bytes of a weight, here and in the key.
const WEIGHT_BYTES: u64 = 16;

/// A mesh, the skin that deforms it, and its weights where they are not the mesh's own.
type Key = (usize, Option<usize>, Option<Vec<u64>>);

/// The shapes found so far.
pub(super) struct Shapes<'a> {
    document: &'a Document<'a>,
    allowance: &'a Allowance<'a>,
    joints: Joints<'a>,
    list: Vec<Shape>,
    known: HashMap<Key, u32>,
    /// By mesh: shapes that show it.
    uses: Vec<u32>,
    /// By mesh, once asked for: whether a primitive has joints and weights.
    is_skinned: HashMap<usize, bool>,
    skins: HashMap<usize, Option<SkinPose>>,
}

impl<'a> Shapes<'a> {
    pub(super) fn new(
        document: &'a Document<'a>,
        forest: &'a Forest,
        allowance: &'a Allowance<'a>,
    ) -> Self {
        Self {
            document,
            allowance,
            joints: Joints::new(document, forest, allowance),
            list: Vec::new(),
            known: HashMap::new(),
            uses: vec![0; document.root.meshes.len()],
            is_skinned: HashMap::new(),
            skins: HashMap::new(),
        }
    }

    pub(super) fn shows(&self, mesh: usize) -> bool {
        self.uses[mesh] > 0
    }

    /// The shape of a mesh that no node shows.
    pub(super) fn plain(&mut self, mesh: usize) -> Read<u32> {
        self.shape((mesh, None, None), None)
    }

    /// The shape that `node`, which has many instances, shows of `mesh`.
    pub(super) fn unskinned(
        &mut self,
        mesh: usize,
        node: &Node,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<u32> {
        let what = "skins of nodes with many instances left out";
        warnings.add(what, u64::from(node.skin.is_some()), place);
        self.shape((mesh, None, self.own_weights(mesh, node)), None)
    }

    /// The shape that `node` shows of `mesh`.
    pub(super) fn shown(
        &mut self,
        mesh: usize,
        node: &Node,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<Shown> {
        let weights = self.own_weights(mesh, node);
        if let Some(skin) = node.skin {
            let skin = skin.value();
            let skins = self.document.root.skins.len();
            if skin >= skins {
                return Err(out_of_range(&format!("{place}.skin"), "skins", skins, skin));
            }
            if !self.skins.contains_key(&skin) {
                let pose = self.joints.pose(skin, warnings)?;
                self.skins.insert(skin, pose);
            }
            let document = self.document;
            let mesh_of = |mesh: usize| is_skinned(&document.root.meshes[mesh]);
            let is_skinned = *self.is_skinned.entry(mesh).or_insert_with(|| mesh_of(mesh));
            match self.skins.get(&skin).and_then(Option::as_ref) {
                Some(pose) if is_skinned => {
                    let world_from_skin = Some(pose.world_from_skin);
                    let joints = pose.joints.clone();
                    let deforming = joints.is_some().then_some(skin);
                    return Ok(Shown {
                        shape: self.shape((mesh, deforming, weights), joints)?,
                        world_from_skin,
                    });
                }
                Some(_) => {
                    let what = "skins of meshes without JOINTS_0 and WEIGHTS_0 left out";
                    warnings.add(what, 1, place);
                }
                // Noted with the skin.
                None => {}
            }
        }
        Ok(Shown {
            shape: self.shape((mesh, None, weights), None)?,
            world_from_skin: None,
        })
    }

    /// The weights of `node` where they differ from the mesh's.
    fn own_weights(&self, mesh: usize, node: &Node) -> Option<Vec<u64>> {
        if node.weights.is_empty() {
            return None;
        }
        let own = without_zeros(&node.weights);
        let of_mesh = without_zeros(&self.document.root.meshes[mesh].weights);
        (own != of_mesh).then(|| own.iter().map(|weight| weight.to_bits()).collect())
    }

    fn shape(&mut self, key: Key, joints: Option<Arc<[DAffine3]>>) -> Read<u32> {
        if let Some(&shape) = self.known.get(&key) {
            return Ok(shape);
        }
        let mesh = key.0;
        let source = &self.document.root.meshes[mesh];
        let weights: Vec<f64> = match &key.2 {
            Some(weights) => weights.iter().map(|&bits| f64::from_bits(bits)).collect(),
            None => without_zeros(&source.weights).to_vec(),
        };
        let mut bytes = weights.len() as u64 * WEIGHT_BYTES;
        if self.uses[mesh] > 0 {
            bytes += source.primitives.len() as u64 * PRIMITIVE_BYTES + MESH_BYTES;
        }
        self.allowance.take(bytes, format!("meshes[{mesh}]"))?;
        self.uses[mesh] += 1;
        let pose = Pose { joints, weights };
        let shape = self.list.len() as u32;
        self.list.push(Shape {
            mesh,
            pose: (!pose.is_none()).then(|| Arc::new(pose)),
        });
        self.known.insert(key, shape);
        Ok(shape)
    }

    /// The shapes in the order of their meshes; `instances` are numbered anew.
    pub(super) fn into_sorted(self, instances: &mut [Instance]) -> Vec<Shape> {
        let mut order: Vec<usize> = (0..self.list.len()).collect();
        order.sort_by_key(|&at| self.list[at].mesh);
        let mut number = vec![0; order.len()];
        for (new, &old) in order.iter().enumerate() {
            number[old] = new as u32;
        }
        for instance in instances {
            instance.mesh = number[instance.mesh as usize];
        }
        order.iter().map(|&at| self.list[at].clone()).collect()
    }
}

fn is_skinned(mesh: &Mesh) -> bool {
    let has_both = |attributes: &super::super::document::Attributes| {
        attributes.find("JOINTS_0").is_some() && attributes.find("WEIGHTS_0").is_some()
    };
    mesh.primitives.iter().any(|it| has_both(&it.attributes))
}

/// Weights without the zeros at their end: targets that nobody weighs.
fn without_zeros(weights: &[f64]) -> &[f64] {
    let length = weights.iter().rposition(|&weight| weight != 0.0);
    &weights[..length.map_or(0, |last| last + 1)]
}

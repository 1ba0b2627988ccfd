//! Pose: vertices moved by morph targets and joints, in f64, as they stand while nothing moves.

mod source;

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::Document;
use super::accessor::ComponentType::{F32, I8, I16, U8, U16};
use super::accessor::{Accessor, Component};
use super::error::{Read, malformed};
use super::used::Used;
use super::warnings::Warnings;

pub(super) use source::PoseSource;

/// How a mesh is deformed.
#[derive(Debug)]
pub(super) struct Pose {
    /// By joint: from a vertex as the file has it to where the joint takes it, in the mesh's frame.
    pub(super) joints: Option<Arc<[DAffine3]>>,
    /// By morph target; those beyond the end weigh nothing.
    pub(super) weights: Vec<f64>,
}

impl Pose {
    /// Whether it leaves every vertex where it is.
    pub(super) fn is_none(&self) -> bool {
        self.joints.is_none() && self.weights.is_empty()
    }
}

/// Vertices that are posed at once: as many matrices stay in a core's cache.
const BLOCK: usize = 1 << 11;
/// The specification's own tolerance of the sum of four weights is smaller; quantized ones stay
/// below this.
const SUM_TOLERANCE: f64 = 0.02;

const JOINTS: &[Component] = &[(U8, Some(false)), (U16, Some(false))];
/// Their sum scales them, so a flag that is missing changes nothing.
const WEIGHTS: &[Component] = &[(F32, None), (U8, None), (U16, None)];
/// With `KHR_mesh_quantization`; plain ones are floats.
const DELTAS: &[Component] = &[(F32, None), (I8, None), (I16, None)];

/// The accessors of a [`PoseSource`] and the pose that reads them.
pub(super) struct Posing {
    /// Empty: no skin.
    joints: Arc<[DAffine3]>,
    /// `JOINTS_n` and `WEIGHTS_n`. Empty under a skin: all hangs on the first joint.
    sets: Vec<[Accessor; 2]>,
    targets: Vec<Target>,
}

struct Target {
    weight: f64,
    position: Option<Accessor>,
    normal: Option<Accessor>,
}

/// A block of vertices on their way.
struct Block {
    positions: Vec<DVec3>,
    /// Empty where there are none.
    normals: Vec<DVec3>,
}

/// Mended vertices, counted.
#[derive(Default)]
struct Notes {
    rescaled: u64,
    without_weight: u64,
    fault: Option<(usize, f32)>,
}

impl Posing {
    /// Opens the accessors for `vertices` vertices; `place` is the primitive's.
    pub(super) fn open(
        document: &Document,
        source: &PoseSource,
        pose: &Pose,
        vertices: usize,
        place: &str,
    ) -> Read<Self> {
        let open = |index: usize, name: &str| {
            let user = format!("{place}.{name}");
            let accessor = Accessor::open_beside(document, index, &user, vertices as u64)?;
            if accessor.count != vertices {
                let expected = format!("{vertices} elements, as many as POSITION");
                return Err(malformed(&accessor.place, expected, accessor.count));
            }
            Ok(accessor)
        };
        let mut sets = Vec::with_capacity(source.sets.len());
        for (set, &[joints, weights]) in source.sets.iter().enumerate() {
            let joints = open(joints, &format!("attributes.JOINTS_{set}"))?;
            joints.expect(&[4], JOINTS)?;
            let weights = open(weights, &format!("attributes.WEIGHTS_{set}"))?;
            weights.expect(&[4], WEIGHTS)?;
            sets.push([joints, weights]);
        }
        let mut targets = Vec::with_capacity(source.targets.len());
        let plain = &DELTAS[..1];
        let deltas = if document.quantized { DELTAS } else { plain };
        for target in &source.targets {
            let delta = |index: Option<usize>, name: &str| {
                let name = format!("targets[{}].{name}", target.number);
                let accessor = index.map(|index| open(index, &name)).transpose()?;
                if let Some(accessor) = &accessor {
                    accessor.expect(&[3], deltas)?;
                }
                Ok(accessor)
            };
            targets.push(Target {
                weight: pose.weights.get(target.number).copied().unwrap_or(0.0),
                position: delta(target.position, "POSITION")?,
                normal: delta(target.normal, "NORMAL")?,
            });
        }
        Ok(Self {
            joints: pose.joints.clone().unwrap_or_default(),
            sets,
            targets,
        })
    }

    /// Moves the vertices `used`, which stand in the arrays by their slots. Normals of no length
    /// stay so.
    pub(super) fn apply(
        &self,
        used: &Used,
        positions: &mut [[f32; 3]],
        mut normals: Option<&mut [[f32; 3]]>,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        let mut notes = Notes::default();
        let vector = |it: [f32; 3]| DVec3::from(it.map(f64::from));
        for start in (0..used.len()).step_by(BLOCK) {
            let elements = &used.ascending[start..(start + BLOCK).min(used.len())];
            let slots = || (start..start + elements.len()).map(|at| used.slot(at));
            let mut block = Block {
                positions: slots().map(|slot| vector(positions[slot])).collect(),
                normals: match &normals {
                    Some(normals) => slots().map(|slot| vector(normals[slot])).collect(),
                    None => Vec::new(),
                },
            };
            self.morph(elements, &mut block)?;
            if !self.joints.is_empty() {
                self.skin(elements, &mut block, &mut notes)?;
            }
            for (slot, position) in slots().zip(&block.positions) {
                positions[slot] = position.as_vec3().to_array();
                if !positions[slot].iter().all(|it| it.is_finite()) {
                    let found = format!("{position} at a vertex");
                    return Err(malformed(place, "a pose within f32", found));
                }
            }
            if let Some(normals) = &mut normals {
                for (slot, normal) in slots().zip(&block.normals) {
                    let unit = normal.normalize_or_zero();
                    normals[slot] = unit.as_vec3().to_array();
                }
            }
        }
        if let Some((element, joint)) = notes.fault {
            let expected = format!("joints below {}", self.joints.len());
            let found = format!("{joint} at element {element}");
            return Err(malformed(format!("{place}.attributes"), expected, found));
        }
        let what = "vertices whose weights do not sum to 1 scaled to it";
        warnings.add(what, notes.rescaled, place);
        let what = "vertices without a weight bound to their first joint";
        warnings.add(what, notes.without_weight, place);
        Ok(())
    }

    fn morph(&self, elements: &[u32], block: &mut Block) -> Read<()> {
        for target in &self.targets {
            let weighted = |delta: [f32; 3]| target.weight * DVec3::from(delta.map(f64::from));
            if let Some(accessor) = &target.position {
                let positions = &mut block.positions;
                accessor.visit_floats(elements, |at, delta| positions[at] += weighted(delta))?;
            }
            if let Some(accessor) = &target.normal
                && !block.normals.is_empty()
            {
                let normals = &mut block.normals;
                accessor.visit_floats(elements, |at, delta| normals[at] += weighted(delta))?;
            }
        }
        Ok(())
    }

    fn skin(&self, elements: &[u32], block: &mut Block, notes: &mut Notes) -> Read<()> {
        let mut blended = vec![(DMat3::ZERO, DVec3::ZERO); elements.len()];
        let mut sums = vec![0.0f64; elements.len()];
        // The joint of a vertex without any weight.
        let mut firsts = vec![0.0f32; elements.len()];
        let mut joints: Vec<[f32; 4]> = vec![[0.0; 4]; elements.len()];
        for (set, [of_joints, of_weights]) in self.sets.iter().enumerate() {
            of_joints.visit_floats(elements, |at, it| joints[at] = it)?;
            if set == 0 {
                for (first, joints) in firsts.iter_mut().zip(&joints) {
                    *first = joints[0];
                }
            }
            of_weights.visit_floats(elements, |at, weights: [f32; 4]| {
                for (joint, weight) in joints[at].into_iter().zip(weights) {
                    if weight == 0.0 || !weight.is_finite() {
                        continue;
                    }
                    let Some(matrix) = self.joints.get(joint as usize) else {
                        notes.fault.get_or_insert((elements[at] as usize, joint));
                        continue;
                    };
                    let weight = f64::from(weight);
                    blended[at].0 += matrix.matrix3 * weight;
                    blended[at].1 += matrix.translation * weight;
                    sums[at] += weight;
                }
            })?;
        }
        for at in 0..elements.len() {
            let (mut linear, mut offset) = blended[at];
            let sum = sums[at];
            if sum > 0.0 {
                notes.rescaled += u64::from((sum - 1.0).abs() > SUM_TOLERANCE);
                (linear, offset) = (linear * (1.0 / sum), offset / sum);
            } else {
                notes.without_weight += u64::from(!self.sets.is_empty());
                let joint = self.joints.get(firsts[at] as usize);
                let joint = joint.or(self.joints.first()).copied().unwrap_or_default();
                (linear, offset) = (joint.matrix3, joint.translation);
            }
            block.positions[at] = linear * block.positions[at] + offset;
            if let Some(normal) = block.normals.get_mut(at) {
                *normal = turned(&linear, *normal);
            }
        }
        Ok(())
    }
}

/// A normal under the transposed inverse of `linear`, of any length: by cofactors, so that a
/// transform without an inverse has one, too.
fn turned(linear: &DMat3, normal: DVec3) -> DVec3 {
    let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    let mirrored = if x.dot(y.cross(z)) < 0.0 { -1.0 } else { 1.0 };
    cofactors * normal * mirrored
}

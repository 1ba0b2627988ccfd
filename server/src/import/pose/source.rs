//! Pose source: the accessors that a primitive's vertices are deformed by.

use super::super::document::Primitive;
use super::super::warnings::Warnings;
use super::Pose;

/// Accessors, by their numbers. Primitives with equal ones may share vertices.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(in crate::import) struct PoseSource {
    /// `JOINTS_n` and `WEIGHTS_n`, from 0 on.
    pub(super) sets: Vec<[usize; 2]>,
    /// Morph targets that weigh something.
    pub(super) targets: Vec<TargetSource>,
}

/// A morph target's accessors.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct TargetSource {
    /// Its place among the primitive's targets.
    pub(super) number: usize,
    pub(super) position: Option<usize>,
    pub(super) normal: Option<usize>,
}

impl PoseSource {
    /// Of `primitive`, at `place`.
    pub(in crate::import) fn of(
        primitive: &Primitive,
        pose: &Pose,
        place: &str,
        warnings: &mut Warnings,
    ) -> Self {
        let source = Self::find(primitive, pose);
        if pose.joints.is_some() && source.sets.is_empty() {
            let what = "primitives of skinned meshes without JOINTS_0 and WEIGHTS_0 bound to the \
                first joint";
            warnings.add(what, 1, place);
        }
        source
    }

    /// Accessors whose elements are read beside the primitive's own.
    pub(in crate::import) fn accessors(primitive: &Primitive, pose: &Pose) -> Vec<usize> {
        let source = Self::find(primitive, pose);
        let targets = source.targets.iter();
        let of_targets = targets.flat_map(|it| it.position.into_iter().chain(it.normal));
        let of_sets = source.sets.iter().flatten().copied();
        of_sets.chain(of_targets).collect()
    }

    fn find(primitive: &Primitive, pose: &Pose) -> Self {
        let attributes = &primitive.attributes;
        let set = |set: u32| {
            let joints = attributes.find(&format!("JOINTS_{set}"))?;
            let weights = attributes.find(&format!("WEIGHTS_{set}"))?;
            Some([joints, weights])
        };
        let targets = primitive.targets.iter().zip(&pose.weights).enumerate();
        Self {
            sets: match pose.joints {
                Some(_) => (0..).map_while(set).collect(),
                None => Vec::new(),
            },
            targets: targets
                .filter(|(_, (_, weight))| **weight != 0.0)
                .map(|(number, (target, _))| TargetSource {
                    number,
                    position: target.find("POSITION"),
                    normal: target.find("NORMAL"),
                })
                .collect(),
        }
    }
}

//! Poses: skins and morph targets as they stand while nothing moves them.

use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde_json::json;

use super::{File, QUAD, corners, find, quad, read_with};
use crate::import::OpenOptions;

const FAR: DVec3 = DVec3::new(456_789.123, 120.5, -5_428_123.456);

/// A skeleton of two joints that stands far away, one of them stretched.
struct Skeleton {
    world_from_mesh: [DAffine3; 2],
}

/// A quad with `joints` and `weights` at each corner, under a skin; its own node stands elsewhere.
fn skinned(joints: [[u8; 4]; 4], weights: [[f32; 4]; 4]) -> (File, Skeleton) {
    let mut file = quad();
    let joints = file.accessor(joints.as_flattened(), 5121, "VEC4", 4);
    let weights = file.floats(&weights);
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = joints.into();
    attributes["WEIGHTS_0"] = weights.into();
    let turn = DQuat::from_rotation_z(0.5);
    let up = DVec3::new(0.0, 2.0, 0.0);
    let stretch = DVec3::new(1.0, 3.0, 1.0);
    // Each number is one of f32's.
    let inverse_bind = [
        DMat4::from_translation(DVec3::new(-1.0, 0.25, 0.0)),
        DMat4::from_scale(DVec3::splat(0.5)),
    ];
    let matrices = file.matrices(&inverse_bind);
    file.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [100, 0, 0], "scale": [7, 7, 7]},
        {"translation": FAR.to_array(), "rotation": turn.to_array(), "children": [2]},
        {"translation": up.to_array(), "scale": stretch.to_array()},
    ]);
    file.json["scenes"] = json!([{"nodes": [0, 1]}]);
    file.json["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": matrices}]);
    let root = DAffine3::from_rotation_translation(turn, FAR);
    let tip = root * DAffine3::from_scale_rotation_translation(stretch, DQuat::IDENTITY, up);
    let [first, second] = inverse_bind.map(DAffine3::from_mat4);
    let world_from_mesh = [root * first, tip * second];
    (file, Skeleton { world_from_mesh })
}

const HALVES: [[f32; 4]; 4] = [
    [1.0, 0.0, 0.0, 0.0],
    [0.5, 0.5, 0.0, 0.0],
    [0.25, 0.75, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0],
];
const BOTH: [[u8; 4]; 4] = [[0, 1, 0, 0]; 4];

impl Skeleton {
    /// Where the corner `at` of the quad stands.
    fn corner(&self, at: usize, weights: [f64; 2]) -> DVec3 {
        let position = DVec3::from(QUAD[at].map(f64::from));
        let [first, second] = self.world_from_mesh.map(|it| it.transform_point3(position));
        (weights[0] * first + weights[1] * second) / (weights[0] + weights[1])
    }

    /// Compares the triangles of the quad with where it should stand; positions are f32 about the
    /// quad's own size.
    fn check(&self, found: &[DVec3], weights: [[f32; 4]; 4]) {
        for (found, at) in found.iter().zip([0, 1, 2, 0, 2, 3]) {
            let [a, b, ..] = weights[at].map(f64::from);
            let expected = self.corner(at, [a, b]);
            assert!(found.distance(expected) < 1e-6, "{at}: {found} {expected}");
        }
        assert_eq!(found.len(), 6);
    }
}

#[test]
fn a_skin_stands_where_its_joints_take_it() {
    let (file, skeleton) = skinned(BOTH, HALVES);
    let scene = file.scene();
    assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 1));
    skeleton.check(&corners(&scene)[0], HALVES);
}

#[test]
fn a_skin_that_stays_in_its_file_stands_in_the_same_place() {
    let (file, skeleton) = skinned(BOTH, HALVES);
    let options = OpenOptions::with_max_mesh_bytes(0);
    let scene = read_with(&file.glb(), &options).unwrap();
    skeleton.check(&corners(&scene)[0], HALVES);
}

#[test]
fn weights_of_other_types_and_sums_are_scaled_to_one() {
    // Joints of 16 bits, weights of 8 that do not say that they are normalized.
    let (mut file, skeleton) = skinned(BOTH, HALVES);
    let joints: Vec<u8> = [0u16, 1, 0, 0]
        .iter()
        .flat_map(|it| it.to_le_bytes())
        .collect();
    let joints = file.accessor(&joints.repeat(4), 5123, "VEC4", 4);
    let weights = file.accessor(&[204, 51, 0, 0].repeat(4), 5121, "VEC4", 4);
    for normalized in [true, false] {
        file.json["accessors"][weights]["normalized"] = normalized.into();
        let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
        attributes["JOINTS_0"] = joints.into();
        attributes["WEIGHTS_0"] = weights.into();
        let scene = file.scene();
        skeleton.check(&corners(&scene)[0], [[0.8, 0.2, 0.0, 0.0]; 4]);
    }
    // A sum of 2.
    let doubled = HALVES.map(|it| it.map(|weight| 2.0 * weight));
    let (file, skeleton) = skinned(BOTH, doubled);
    let scene = file.scene();
    skeleton.check(&corners(&scene)[0], HALVES);
    find(&scene.warnings, "weights do not sum to 1 scaled to it: 4");
    // None at all: the first joint.
    let (file, skeleton) = skinned([[1, 0, 0, 0]; 4], [[0.0; 4]; 4]);
    let scene = file.scene();
    skeleton.check(&corners(&scene)[0], [[0.0, 1.0, 0.0, 0.0]; 4]);
    find(
        &scene.warnings,
        "vertices without a weight bound to their first joint: 4",
    );
}

#[test]
fn a_second_set_of_joints_counts() {
    let (mut file, skeleton) = skinned([[0; 4]; 4], [[0.25, 0.0, 0.0, 0.0]; 4]);
    let joints = file.accessor(&[1, 9, 9, 9].repeat(4), 5121, "VEC4", 4);
    let weights = file.floats(&[[0.75, 0.0, 0.0, 0.0]; 4]);
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_1"] = joints.into();
    attributes["WEIGHTS_1"] = weights.into();
    skeleton.check(&corners(&file.scene())[0], [[0.25, 0.75, 0.0, 0.0]; 4]);
}

#[test]
fn joints_that_do_not_exist_are_refused_where_they_weigh() {
    let (file, _) = skinned([[0, 7, 0, 0]; 4], [[1.0, 0.0, 0.0, 0.0]; 4]);
    assert!(file.read().is_ok());
    let (file, _) = skinned([[0, 7, 0, 0]; 4], HALVES);
    let fault = file.fault();
    assert!(
        fault.contains("expected joints below 2, found 7 at element 1"),
        "{fault}"
    );
    for (path, value, part) in [
        (
            "/nodes/0/skin",
            json!(5),
            "nodes[0].skin: expected one of 1 skins",
        ),
        (
            "/skins/0/joints/1",
            json!(9),
            "skins[0].joints[1]: expected one of 3 nodes",
        ),
        (
            "/skins/0/joints",
            json!([1, 2, 1]),
            "3 matrices, one for each joint, found 2",
        ),
    ] {
        let (mut file, _) = skinned(BOTH, HALVES);
        *file.json.pointer_mut(path).unwrap() = value;
        let fault = file.fault();
        assert!(fault.contains(part), "{fault}");
    }
}

#[test]
fn normals_turn_with_their_joint() {
    let (mut file, _) = skinned(BOTH, [[0.0, 1.0, 0.0, 0.0]; 4]);
    let slant = [0.0f32, 0.6, 0.8];
    let normals = file.floats(&[slant; 4]);
    file.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = normals.into();
    let scene = file.scene();
    let instance = &scene.instances[0];
    let normal = scene.meshes[0].normals.as_ref().unwrap()[0];
    let normal = DVec3::from(normal.map(f64::from));
    // Of an object's normal in the world: the inverse of the linear part, transposed.
    let linear = instance.world_from_object.matrix3.inverse().transpose();
    let found = (linear * normal).normalize();
    let turn = DQuat::from_rotation_z(0.5);
    let expected = turn * DVec3::new(0.0, 0.6 / 3.0, 0.8).normalize();
    assert!(found.distance(expected) < 1e-6, "{found} {expected}");
}

/// In the bind pose all joints agree, and a crowd shares one mesh.
#[test]
fn skins_in_their_bind_pose_share_the_mesh() {
    let (mut file, _) = skinned(BOTH, HALVES);
    let places = [DVec3::new(3.0, 0.0, 0.0), FAR];
    let turn = DQuat::from_rotation_y(0.7);
    let arm = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.4), DVec3::Y);
    let matrices = [DMat4::IDENTITY, DMat4::from(arm.inverse())];
    let matrices = file.matrices(&matrices);
    let (mut nodes, mut skins) = (vec![], vec![]);
    for place in places {
        let first = nodes.len();
        nodes.extend([
            json!({"mesh": 0, "skin": skins.len(), "translation": [50, 0, 0]}),
            json!({"translation": place.to_array(), "rotation": turn.to_array(), "children": [first + 2]}),
            json!({"translation": [0, 1, 0], "rotation": DQuat::from_rotation_z(0.4).to_array()}),
        ]);
        skins.push(json!({"joints": [first + 1, first + 2], "inverseBindMatrices": matrices}));
    }
    nodes.push(json!({"mesh": 0, "translation": [1, 2, 3]}));
    file.json["nodes"] = json!(nodes);
    file.json["skins"] = json!(skins);
    file.json["scenes"] = json!([{"nodes": [0, 1, 3, 4, 6]}]);
    let scene = file.scene();
    assert_eq!(scene.meshes.len(), 1);
    assert_eq!(scene.meshes[0].positions, QUAD);
    let found: Vec<DAffine3> = scene
        .instances
        .iter()
        .map(|it| it.world_from_object)
        .collect();
    let [near, far] = places.map(|place| DAffine3::from_rotation_translation(turn, place));
    let plain = DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0));
    for (found, expected) in found.iter().zip([near, far, plain]) {
        assert!(found.abs_diff_eq(expected, 1e-12), "{found} {expected}");
    }
    // One arm moved: that one has a mesh of its own.
    file.json["nodes"][2]["translation"] = json!([0, 1.5, 0]);
    let scene = file.scene();
    assert_eq!(scene.meshes.len(), 2);
    let meshes: Vec<u32> = scene.instances.iter().map(|it| it.mesh).collect();
    assert_eq!(meshes, [0, 1, 1]);
}

#[test]
fn each_skin_has_a_mesh_of_its_own_and_nodes_share_it() {
    let (mut file, skeleton) = skinned(BOTH, HALVES);
    let mut other = file.json["skins"][0].clone();
    other["joints"] = json!([2, 1]);
    file.push("skins", other);
    file.push("nodes", json!({"mesh": 0, "skin": 1}));
    file.push("nodes", json!({"mesh": 0, "skin": 0}));
    file.json["scenes"] = json!([{"nodes": [0, 1, 3, 4]}]);
    let scene = file.scene();
    assert_eq!((scene.meshes.len(), scene.instances.len()), (2, 3));
    let corners = corners(&scene);
    skeleton.check(&corners[0], HALVES);
    skeleton.check(&corners[2], HALVES);
    assert!(corners[1][0].distance(corners[0][0]) > 0.1);
}

#[test]
fn meshes_without_joints_and_nodes_with_many_instances_leave_the_skin_out() {
    let (mut file, _) = skinned(BOTH, HALVES);
    let offsets = file.floats(&[[0.0, 0.0, 1.0]]);
    let extension = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": offsets}}});
    file.json["nodes"][0]["extensions"] = extension;
    let scene = file.scene();
    find(
        &scene.warnings,
        "skins of nodes with many instances left out",
    );
    let place = scene.instances[0].world_from_object.translation;
    assert_eq!(place, DVec3::new(100.0, 0.0, 7.0));
    let (mut file, _) = skinned(BOTH, HALVES);
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes.as_object_mut().unwrap().remove("WEIGHTS_0");
    let scene = file.scene();
    find(&scene.warnings, "without JOINTS_0 and WEIGHTS_0 left out");
    let place = scene.instances[0].world_from_object.translation;
    assert_eq!(place, DVec3::new(100.0, 0.0, 0.0));
}

/// A quad with two morph targets.
fn morphed() -> File {
    let mut file = quad();
    let up = file.floats(&[[0.0, 0.0, 2.0]; 4]);
    let tilt = file.floats(&[[0.0, 1.0, -1.0]; 4]);
    let aside = file.floats(&[[4.0, 0.0, 0.0]; 4]);
    let normals = file.floats(&[[0.0, 0.0, 1.0]; 4]);
    let primitive = &mut file.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["NORMAL"] = normals.into();
    primitive["targets"] = json!([{"POSITION": up, "NORMAL": tilt}, {"POSITION": aside}]);
    file
}

#[test]
fn morph_targets_stand_at_their_default_weights() {
    let moved = |by: [f32; 3]| QUAD.map(|at| std::array::from_fn(|axis| at[axis] + by[axis]));
    let mut file = morphed();
    assert_eq!(file.scene().meshes[0].positions, QUAD);
    file.json["meshes"][0]["weights"] = json!([1, 0.25]);
    let scene = file.scene();
    assert_eq!(scene.meshes[0].positions, moved([1.0, 0.0, 2.0]));
    assert_eq!(
        scene.meshes[0].normals.as_ref().unwrap()[0],
        [0.0, 1.0, 0.0]
    );
    let options = OpenOptions::with_max_mesh_bytes(0);
    let streamed = read_with(&file.glb(), &options).unwrap();
    assert_eq!(streamed.meshes[0].positions, moved([1.0, 0.0, 2.0]));
    // Weights of a node go before those of its mesh; equal ones share.
    file.json["nodes"] = json!([
        {"mesh": 0}, {"mesh": 0, "weights": [0, 0.5]}, {"mesh": 0, "weights": [1, 0.25, 0]},
        {"mesh": 0, "weights": [0, 0]}, {"mesh": 0, "weights": [0.0, 0.5]},
    ]);
    file.json["scenes"] = json!([{"nodes": [0, 1, 2, 3, 4]}]);
    let scene = file.scene();
    let meshes: Vec<u32> = scene.instances.iter().map(|it| it.mesh).collect();
    assert_eq!(meshes, [0, 1, 0, 2, 1]);
    assert_eq!(scene.meshes[1].positions, moved([2.0, 0.0, 0.0]));
    assert_eq!(scene.meshes[2].positions, QUAD);
}

/// Targets are mostly sparse, without bytes for what they leave in place.
#[test]
fn sparse_targets_move_what_they_name() {
    let count = 5000;
    let mut file = File::new();
    let positions: Vec<[f32; 3]> = (0..count)
        .map(|at| [at as f32, (at % 2) as f32, 0.0])
        .collect();
    let position = file.floats(&positions);
    let indices = file.view(&4321u16.to_le_bytes());
    let values: Vec<u8> = [0.0f32, 0.0, 9.0]
        .iter()
        .flat_map(|it| it.to_le_bytes())
        .collect();
    let values = file.view(&values);
    let sparse = json!({
        "count": 1, "indices": {"bufferView": indices, "componentType": 5123},
        "values": {"bufferView": values},
    });
    let target = json!({"componentType": 5126, "type": "VEC3", "count": count, "sparse": sparse});
    let target = file.push("accessors", target);
    file.primitive(json!({
        "attributes": {"POSITION": position}, "targets": [{"POSITION": target}], "mode": 5,
    }));
    file.json["meshes"][0]["weights"] = json!([1]);
    let scene = file.scene();
    let raised: Vec<_> = scene.meshes[0]
        .positions
        .iter()
        .filter(|it| it[2] != 0.0)
        .collect();
    assert!(!raised.is_empty());
    assert!(
        raised.iter().all(|it| **it == [4321.0, 1.0, 9.0]),
        "{raised:?}"
    );
}

#[test]
fn morph_targets_come_before_joints() {
    let (mut file, skeleton) = skinned(BOTH, [[0.0, 1.0, 0.0, 0.0]; 4]);
    let aside = file.floats(&[[4.0, 0.0, 0.0]; 4]);
    file.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": aside}]);
    file.json["nodes"][0]["weights"] = json!([0.5]);
    let found = corners(&file.scene())[0][0];
    let expected = skeleton.world_from_mesh[1].transform_point3(DVec3::new(2.0, 0.0, 0.0));
    assert!(found.distance(expected) < 1e-6, "{found} {expected}");
}

//! Nodes: transforms in f64, trees that are none, nodes that are not visible.

use glam::{DAffine3, DQuat, DVec3};
use serde_json::{Value, json};

use super::{corners, find, quad};

/// Easting, height and northing of UTM; ECEF.
const FAR: [[f64; 3]; 2] = [
    [456_789.123, 120.5, -5_428_123.456],
    [4_194_500.123, 4_780_123.5, -171_234.25],
];

#[test]
fn translations_far_from_the_origin_keep_every_digit() {
    for [x, y, z] in FAR {
        let mut file = quad();
        let place = |at: usize| [x + at as f64, y, z - 0.25 * at as f64];
        let nodes: Vec<Value> = (0..100)
            .map(|at| json!({"mesh": 0, "translation": place(at)}))
            .collect();
        file.json["nodes"] = json!(nodes);
        file.json.as_object_mut().unwrap().remove("scenes");
        file.json.as_object_mut().unwrap().remove("scene");
        let scene = file.scene();
        assert_eq!(scene.instances.len(), 100);
        for (at, instance) in scene.instances.iter().enumerate() {
            assert_eq!(instance.world_from_object.translation, place(at).into());
        }
        // The quad is a metre wide: the right edge of each tile is the left one of the next.
        let corners = corners(&scene);
        for pair in corners.windows(2) {
            let (right, left) = (pair[0][1], pair[1][0]);
            assert_eq!((right.x, right.y), (left.x, left.y));
        }
    }
}

#[test]
fn chains_and_matrices_are_composed_in_f64() {
    let [far, _] = FAR.map(DVec3::from);
    let angle = 0.3f64;
    let turn = DQuat::from_rotation_y(angle);
    let (sin, cos) = angle.sin_cos();
    let step = DVec3::new(0.1, 0.2, 0.3);
    let mut file = quad();
    let offsets = file.floats(&[[0.5, 0.0, 0.0], [0.0, 0.25, 0.0]]);
    let instancing = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": offsets}}});
    let matrix = [
        cos, 0.0, -sin, 0.0, 0.0, 1.0, 0.0, 0.0, sin, 0.0, cos, 0.0, far.x, far.y, far.z, 1.0,
    ];
    file.json["nodes"] = json!([
        {"translation": far.to_array(), "rotation": turn.to_array(), "children": [1, 3]},
        {"mesh": 0, "translation": step.to_array(), "scale": [0.1, 0.1, 0.1]},
        {"mesh": 0, "matrix": matrix},
        {"mesh": 0, "extensions": instancing},
    ]);
    file.json["scenes"] = json!([{"nodes": [0, 2]}]);
    let scene = file.scene();
    let parent = DAffine3::from_rotation_translation(turn, far);
    let child = DAffine3::from_scale_rotation_translation(DVec3::splat(0.1), DQuat::IDENTITY, step);
    let expected = [
        parent * child,
        parent * DAffine3::from_translation(DVec3::new(0.5, 0.0, 0.0)),
        parent * DAffine3::from_translation(DVec3::new(0.0, 0.25, 0.0)),
        parent,
    ];
    assert_eq!(scene.instances.len(), expected.len());
    for (instance, expected) in scene.instances.iter().zip(expected) {
        let found = instance.world_from_object;
        // A rounding of 5,428,123 in f64 is 1e-9.
        assert!(found.abs_diff_eq(expected, 2e-9), "{found} {expected}");
    }
    assert_eq!(scene.instances[3].world_from_object.translation, far);
}

#[test]
fn nodes_with_two_parents_stand_below_both() {
    let mut file = quad();
    file.json["nodes"] = json!([
        {"children": [2], "translation": [1, 0, 0]},
        {"children": [2], "translation": [0, 5, 0]},
        {"mesh": 0, "translation": [0, 0, 2]},
    ]);
    file.json["scenes"] = json!([{"nodes": [0, 1]}]);
    let scene = file.scene();
    let places: Vec<DVec3> = scene
        .instances
        .iter()
        .map(|it| it.world_from_object.translation)
        .collect();
    assert_eq!(
        places,
        [DVec3::new(1.0, 0.0, 2.0), DVec3::new(0.0, 5.0, 2.0)]
    );
    let line = find(&scene.warnings, "several parents");
    assert!(line.contains(": 1 (at nodes[2])"), "{line}");
}

/// Some exporters list every node in the scene.
#[test]
fn roots_that_are_children_stand_in_both_places() {
    for roots in [json!([0, 1]), json!([1, 0])] {
        let mut file = quad();
        file.json["nodes"] = json!([
            {"children": [1], "translation": [1, 0, 0]},
            {"mesh": 0, "translation": [0, 0, 2]},
        ]);
        file.json["scenes"] = json!([{"nodes": roots}]);
        let scene = file.scene();
        let mut places: Vec<DVec3> = scene
            .instances
            .iter()
            .map(|it| it.world_from_object.translation)
            .collect();
        places.sort_by(|a, b| a.x.total_cmp(&b.x));
        assert_eq!(
            places,
            [DVec3::new(0.0, 0.0, 2.0), DVec3::new(1.0, 0.0, 2.0)]
        );
        find(&scene.warnings, "a parent beside the scene");
    }
}

#[test]
fn many_paths_and_cycles_are_refused() {
    let mut file = quad();
    let mut nodes: Vec<Value> = (1..41).map(|at| json!({"children": [at, at]})).collect();
    nodes.push(json!({"mesh": 0}));
    file.json["nodes"] = json!(nodes);
    let fault = file.fault();
    assert!(fault.contains("a node with one parent"), "{fault}");
    let nodes = json!([{"mesh": 0, "children": [1]}, {"children": [2]}, {"children": [1]}]);
    file.json["nodes"] = nodes;
    // With the scene, and without one: all nodes are meant then.
    for _ in 0..2 {
        let fault = file.fault();
        assert!(
            fault.contains("nodes[1]") && fault.contains("cycle"),
            "{fault}"
        );
        file.json.as_object_mut().unwrap().remove("scene");
        file.json["scenes"] = json!([]);
        file.json["nodes"][0] = json!({"mesh": 0});
    }
}

#[test]
fn a_node_listed_twice_in_one_place_stands_once() {
    let mut file = quad();
    file.json["nodes"] = json!([
        {"children": [2, 2, 1, 2], "translation": [1, 0, 0]},
        {"mesh": 0, "translation": [0, 5, 0]},
        {"mesh": 0, "translation": [0, 0, 2]},
    ]);
    file.json["scenes"] = json!([{"nodes": [0, 2, 0]}]);
    let scene = file.scene();
    let mut places: Vec<[f64; 3]> = scene
        .instances
        .iter()
        .map(|it| it.world_from_object.translation.to_array())
        .collect();
    places.sort_by(|a, b| a.partial_cmp(b).unwrap());
    // Below its parent and in the scene, as nodes with two parents do.
    assert_eq!(places, [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [1.0, 5.0, 0.0]]);
    let line = find(&scene.warnings, "listed again");
    assert!(
        line.contains(": 3 (in 2 places, first at scenes)"),
        "{line}"
    );
}

#[test]
fn broken_nodes_and_accessors_that_nothing_uses_are_passed_over() {
    for node in [
        json!({"children": [77]}),
        json!({"children": [-1]}),
        json!({"children": [1]}),
        json!({"children": [0, 2]}),
        json!({"children": [2]}),
        json!({"matrix": [1, 2]}),
        json!({"mesh": "none"}),
        json!(7),
    ] {
        let mut file = quad();
        file.json["nodes"] =
            json!([{"mesh": 0, "translation": [0, 0, 2]}, node, {"children": [1]}]);
        for accessor in [
            json!({"componentType": 5126, "count": -1, "type": "VEC3"}),
            json!({"componentType": 5126, "count": 1.5, "type": "VEC3"}),
            json!({"bufferView": -1}),
            json!("none"),
        ] {
            file.push("accessors", accessor);
        }
        let scene = file.scene();
        assert_eq!(scene.instances.len(), 1, "{node}");
        let place = scene.instances[0].world_from_object.translation;
        assert_eq!(place, DVec3::new(0.0, 0.0, 2.0), "{node}");
        // Shown, each is refused by its place.
        file.json["scenes"][0]["nodes"] = json!([0, 2]);
        let fault = file.fault();
        let is_named = fault.contains("nodes[1]") || fault.contains("cycle");
        assert!(is_named, "{node}: {fault}");
        // As is a broken accessor.
        file.json["scenes"][0]["nodes"] = json!([0]);
        for accessor in 2..6 {
            file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = accessor.into();
            let fault = file.fault();
            assert!(fault.contains(&format!("accessors[{accessor}]")), "{fault}");
        }
    }
}

/// A skin may hang on nodes that the scene does not show.
#[test]
fn joints_below_a_cycle_are_refused() {
    let mut file = quad();
    file.json["nodes"] = json!([
        {"mesh": 0, "skin": 0}, {"children": [2]}, {"children": [1, 3]}, {},
    ]);
    file.json["skins"] = json!([{"joints": [3]}]);
    let fault = file.fault();
    assert!(
        fault.contains("skins[0].joints[0]") && fault.contains("cycle"),
        "{fault}"
    );
    // A joint that the scene shows has its parent there.
    file.json["nodes"][0]["children"] = json!([3]);
    assert_eq!(file.scene().instances.len(), 1);
}

#[test]
fn hidden_nodes_and_those_below_are_left_out() {
    let hidden = |visible: Value| json!({"KHR_node_visibility": {"visible": visible}});
    for listed in ["extensionsUsed", "extensionsRequired"] {
        let mut file = quad();
        file.json[listed] = json!(["KHR_node_visibility"]);
        file.json["nodes"] = json!([
            {"mesh": 0, "translation": [1, 0, 0], "extensions": hidden(json!(true))},
            {"mesh": 0, "translation": [2, 0, 0], "children": [2], "extensions": hidden(json!(false))},
            {"mesh": 0},
            {"mesh": 0, "translation": [3, 0, 0], "extensions": {"KHR_node_visibility": {}}},
        ]);
        file.json["scenes"] = json!([{"nodes": [0, 1, 3]}]);
        let scene = file.scene();
        let places = scene.instances.iter();
        let places: Vec<f64> = places
            .map(|it| it.world_from_object.translation.x)
            .collect();
        assert_eq!(places, [1.0, 3.0]);
        find(
            &scene.warnings,
            "nodes that are not visible left out: 1 (at nodes[1])",
        );
    }
}

#[test]
fn a_matrix_wins_over_what_stands_beside_it() {
    let mut file = quad();
    file.json["nodes"] = json!([{
        "mesh": 0, "translation": [7, 0, 0], "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 2,0,0,1],
    }]);
    let scene = file.scene();
    assert_eq!(
        scene.instances[0].world_from_object.translation,
        DVec3::new(2.0, 0.0, 0.0)
    );
    find(&scene.warnings, "beside a matrix left out");
}

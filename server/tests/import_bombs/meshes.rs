//! Accessors, views, primitives and instances that share their bytes.

use super::{glb, import_within, list};

const ASSET: &str = r#""asset":{"version":"2.0"}"#;

/// A document over a buffer of `bin`.
fn document(parts: &str, bin: &[u8]) -> Vec<u8> {
    let buffer = format!(r#""buffers":[{{"byteLength":{}}}]"#, bin.len());
    glb(&format!("{{{ASSET},{buffer},{parts}}}"), bin)
}

/// Vertices of a surface that is not flat.
fn vertices(count: usize) -> Vec<u8> {
    let position = |at: usize| [at as f32, (at % 7) as f32, (at % 11) as f32];
    (0..count)
        .flat_map(position)
        .flat_map(f32::to_le_bytes)
        .collect()
}

const VIEW: &str = r#""bufferViews":[{"buffer":0,"byteLength":#}]"#;

#[test]
fn accessors_without_bytes_are_refused() {
    let mesh = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;
    for count in ["2147483648", "4294967294", "9007199254740993"] {
        let accessor = format!(r#"{{"componentType":5126,"count":{count},"type":"VEC3"}}"#);
        let parts = format!(r#"{mesh},"accessors":[{accessor}]"#);
        let outcome = import_within("zeros", "glb", &document(&parts, &[]));
        assert!(outcome.scene.is_err());
        let sparse = r#""sparse":{"count":1,"indices":{"bufferView":0,"componentType":5121},
            "values":{"bufferView":0}}"#;
        let accessor = accessor.replace('}', &format!(",{sparse}}}"));
        let view = VIEW.replace('#', "12");
        let parts = format!(r#"{mesh},"accessors":[{accessor}],{view}"#);
        let outcome = import_within("sparse zeros", "glb", &document(&parts, &[0; 12]));
        assert!(outcome.scene.is_err());
    }
}

/// One range of bytes in many meshes, through one accessor or one for each.
#[test]
fn meshes_that_share_vertices_stay_within_the_limit() {
    let bin = vertices(30_000);
    let view = VIEW.replace('#', &bin.len().to_string());
    let accessor = r#"{"bufferView":0,"componentType":5126,"count":30000,"type":"VEC3"}"#;
    for (name, count, accessor_of_mesh) in
        [("one accessor", 1, "0"), ("an accessor each", 300, "#")]
    {
        let accessors = list(count, accessor);
        let mesh =
            format!(r##"{{"primitives":[{{"attributes":{{"POSITION":{accessor_of_mesh}}}}}]}}"##);
        for meshes in [
            list(300, &mesh),
            mesh.replace(
                r#"[{"attributes"#,
                &format!(
                    "[{},{{\"attributes",
                    list(299, r#"{"attributes":{"POSITION":0}}"#)
                ),
            ),
        ] {
            let parts = format!(r#""accessors":[{accessors}],{view},"meshes":[{meshes}]"#);
            let parts = parts.replace("\"POSITION\":#", "\"POSITION\":0");
            import_within(name, "glb", &document(&parts, &bin));
        }
    }
}

#[test]
fn sparse_accessors_that_are_shared_stay_within_the_limit() {
    // All indices and values are those of one range of a megabyte.
    let count = 60_000u32;
    let mut bin: Vec<u8> = (0..count).flat_map(u32::to_le_bytes).collect();
    let indices = bin.len();
    bin.extend(vertices(count as usize));
    let views = format!(
        r#""bufferViews":[{{"buffer":0,"byteLength":{indices}}},
        {{"buffer":0,"byteOffset":{indices},"byteLength":{}}}]"#,
        bin.len() - indices
    );
    let accessor = format!(
        r#"{{"bufferView":1,"componentType":5126,"count":{count},"type":"VEC3","sparse":{{"count":{count},
        "indices":{{"bufferView":0,"componentType":5125}},"values":{{"bufferView":1}}}}}}"#
    );
    let primitive = r#"{"attributes":{"POSITION":0,"NORMAL":0}}"#;
    for meshes in [
        format!(r#"{{"primitives":[{}]}}"#, list(150, primitive)),
        list(150, &format!(r#"{{"primitives":[{primitive}]}}"#)),
    ] {
        let parts = format!(r#""accessors":[{accessor}],{views},"meshes":[{meshes}]"#);
        import_within("sparse", "glb", &document(&parts, &bin));
    }
}

#[test]
fn many_primitives_stay_within_the_limit() {
    let bin = vertices(3);
    let view = VIEW.replace('#', "36");
    let accessor = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}"#;
    let primitive = r#"{"attributes":{"POSITION":0}}"#;
    for meshes in [
        format!(r#"{{"primitives":[{}]}}"#, list(10_000, primitive)),
        format!(r#"{{"primitives":[{}]}}"#, list(100_000, primitive)),
        list(10_000, &format!(r#"{{"primitives":[{primitive}]}}"#)),
        list(100_000, &format!(r#"{{"primitives":[{primitive}]}}"#)),
    ] {
        let parts = format!(r#""accessors":[{accessor}],{view},"meshes":[{meshes}]"#);
        import_within("primitives", "glb", &document(&parts, &bin));
    }
}

#[test]
fn instances_stay_within_the_limit() {
    let count = 30_000;
    let bin = vertices(count);
    let view = VIEW.replace('#', &bin.len().to_string());
    let accessors = format!(
        r#"{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":0,"componentType":5126,"count":{count},"type":"VEC3"}}"#
    );
    let mesh = r#"{"primitives":[{"attributes":{"POSITION":0}}]}"#;
    let node =
        r#"{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":1}}}}"#;
    for nodes in [1, 4, 5000] {
        let parts = format!(
            r#""accessors":[{accessors}],{view},"meshes":[{mesh}],"nodes":[{}]"#,
            list(nodes, node)
        );
        let outcome = import_within("instances", "glb", &document(&parts, &bin));
        assert_eq!(outcome.scene.is_ok(), nodes <= 4, "{}", outcome.error());
    }
}

/// Each node has the next one twice: 2^40 instances.
#[test]
fn nodes_with_two_parents_are_refused() {
    let nodes = (1..40).map(|at| format!(r#"{{"children":[{at},{at}]}}"#));
    let nodes: Vec<String> = nodes.collect();
    let parts = format!(r#""nodes":[{},{{}}]"#, nodes.join(","));
    let outcome = import_within("nodes", "glb", &document(&parts, &[]));
    assert!(
        outcome.error().contains("one parent"),
        "{}",
        outcome.error()
    );
}

/// One mesh in as many poses as the file has skins or weights.
#[test]
fn meshes_in_many_poses_stay_within_the_limit() {
    let count = 30_000;
    let mut bin = vertices(count);
    let weights = bin.len();
    bin.extend(
        (0..count)
            .flat_map(|_| [1.0f32, 0.0, 0.0, 0.0])
            .flat_map(f32::to_le_bytes),
    );
    let joints = bin.len();
    bin.extend(vec![0; 4 * count]);
    let views = format!(
        r#""bufferViews":[{{"buffer":0,"byteLength":{weights}}},
        {{"buffer":0,"byteOffset":{weights},"byteLength":{}}},
        {{"buffer":0,"byteOffset":{joints},"byteLength":{}}}]"#,
        joints - weights,
        bin.len() - joints,
    );
    let accessors = format!(
        r#""accessors":[{{"bufferView":0,"componentType":5126,"count":{count},"type":"VEC3"}},
        {{"bufferView":1,"componentType":5126,"count":{count},"type":"VEC4"}},
        {{"bufferView":2,"componentType":5121,"count":{count},"type":"VEC4"}}]"#
    );
    let attributes = r#""POSITION":0,"WEIGHTS_0":1,"JOINTS_0":2"#;
    let primitive = format!(r#"{{"attributes":{{{attributes}}},"targets":[{{"POSITION":0}}]}}"#);
    let mesh = format!(r#"{{"primitives":[{primitive}]}}"#);
    let skin = r#"{"joints":[0,1]}"#;
    for poses in [3, 300, 3000] {
        let by_skin = list(poses, r#"{"mesh":0,"skin":#}"#);
        let by_weight = list(poses, r#"{"mesh":0,"weights":[#.5]}"#);
        for nodes in [by_skin, by_weight] {
            let nodes = format!(r#"{{}},{{"translation":[1,2,3]}},{nodes}"#);
            let parts = format!(
                r#"{accessors},{views},"meshes":[{mesh}],"nodes":[{nodes}],"skins":[{}]"#,
                list(poses, skin)
            );
            let outcome = import_within("poses", "glb", &document(&parts, &bin));
            match poses {
                3 => assert!(outcome.scene.is_ok(), "{}", outcome.error()),
                3000 => assert!(
                    outcome.error().contains("corners at most"),
                    "{}",
                    outcome.error()
                ),
                _ => {}
            }
        }
    }
    // Empty primitives and joints take memory, too.
    let empty = r#""accessors":[{"componentType":5126,"count":0,"type":"VEC3"}]"#;
    let primitives = list(
        10_000,
        r#"{"attributes":{"POSITION":0,"WEIGHTS_0":0,"JOINTS_0":0}}"#,
    );
    let nodes = list(10_000, r#"{"mesh":0,"skin":#}"#);
    let parts = format!(
        r#"{empty},"meshes":[{{"primitives":[{primitives}]}}],"nodes":[{{}},{{"scale":[2,2,2]}},{nodes}],
        "skins":[{}]"#,
        list(10_000, skin)
    );
    import_within("empty poses", "glb", &document(&parts, &[]));
    let joints = list(1 << 20, "0");
    let parts = format!(
        r#""accessors":[{{"componentType":5126,"count":3,"type":"VEC3"}}],"meshes":[{{"primitives":
        [{{"attributes":{{"POSITION":0,"WEIGHTS_0":0,"JOINTS_0":0}}}}]}}],"nodes":[{{"mesh":0,"skin":0}}],
        "skins":[{{"joints":[{joints}]}}]"#
    );
    import_within("joints", "glb", &document(&parts, &[]));
}

/// Zeros compress to nearly nothing, and views may name one range of them.
#[test]
fn compressed_views_stay_within_the_limit() {
    let (count, stride) = (65_536usize, 16usize);
    let zeros = vec![[0u8; 16]; count];
    let bin = meshopt::encode_vertex_buffer(&zeros).expect("compresses");
    let length = count * stride;
    let view = format!(
        r#"{{"buffer":0,"byteLength":{length},"byteStride":{stride},"extensions":{{"EXT_meshopt_compression":
        {{"buffer":0,"byteLength":{},"byteStride":{stride},"count":{count},"mode":"ATTRIBUTES"}}}}}}"#,
        bin.len()
    );
    let padding = vec![0; 1 << 20];
    let bin = [bin, padding].concat();
    let accessor =
        format!(r#"{{"bufferView":#,"componentType":5126,"count":{count},"type":"VEC3"}}"#);
    let mesh = r#"{"primitives":[{"attributes":{"POSITION":#}}]}"#;
    for views in [8, 200] {
        let parts = format!(
            r#""bufferViews":[{}],"accessors":[{}],"meshes":[{}],"extensionsUsed":["EXT_meshopt_compression"]"#,
            list(views, &view),
            list(views, &accessor),
            list(views, mesh)
        );
        let outcome = import_within("compressed views", "glb", &document(&parts, &bin));
        assert_eq!(outcome.scene.is_ok(), views == 8, "{}", outcome.error());
    }
}

//! Documents: lists of empty objects, trees in extensions, names, nesting.

use super::{glb, import, import_within, list};
use lodestream_server::import::OpenOptions;

const ASSET: &str = r#""asset":{"version":"2.0"}"#;
/// Bytes of text: where an object of three bytes takes 25 there is no room.
const TEXT_BYTES: usize = 3 << 20;

/// As many of `item` in the list `key` of the document as have [`TEXT_BYTES`].
fn of_list(key: &str, item: &str) -> String {
    of_text(&format!(r#""{key}":[@]"#), item)
}

/// The same where `@` stands in `around`.
fn of_text(around: &str, item: &str) -> String {
    let count = TEXT_BYTES / (item.len() + 1);
    let text = around.replace('@', &list(count, item));
    format!("{{{ASSET},{text}}}")
}

fn bombs() -> Vec<(&'static str, String)> {
    let accessor = r#"{"componentType":5126,"count":0,"type":"SCALAR"}"#;
    let animation = r#"{"channels":[],"samplers":[]}"#;
    let camera = r#"{"type":"perspective","perspective":{"yfov":1,"znear":1}}"#;
    let channel = r#"{"sampler":0,"target":{"node":0,"path":"scale"}}"#;
    let in_mesh = r#""meshes":[{"primitives":[@]}]"#;
    let in_extensions = r#""nodes":[{"extensions":{"x":[@]}}]"#;
    let mut bombs = vec![
        ("accessors", of_list("accessors", accessor)),
        ("animations", of_list("animations", animation)),
        (
            "buffers",
            of_list("buffers", r#"{"byteLength":1,"uri":"data:,x"}"#),
        ),
        (
            "bufferViews",
            of_list("bufferViews", r#"{"buffer":0,"byteLength":1}"#),
        ),
        ("cameras", of_list("cameras", camera)),
        ("images", of_list("images", "{}")),
        ("materials", of_list("materials", "{}")),
        ("materials as lists", of_list("materials", "[]")),
        ("meshes", of_list("meshes", r#"{"primitives":[]}"#)),
        ("nodes", of_list("nodes", "{}")),
        ("nodes that show", of_list("nodes", r#"{"mesh":0}"#)),
        (
            "nodes with children",
            of_list("nodes", r#"{"children":[#]}"#),
        ),
        ("samplers", of_list("samplers", "{}")),
        ("scenes", of_list("scenes", r#"{"nodes":[]}"#)),
        ("scenes without nodes", of_list("scenes", "{}")),
        ("skins", of_list("skins", r#"{"joints":[]}"#)),
        ("textures", of_list("textures", "{}")),
        (
            "textures with images",
            of_list("textures", r#"{"source":0}"#),
        ),
        ("extensionsUsed", of_list("extensionsUsed", "\"\"")),
        ("names of extensions", of_list("extensionsUsed", "\"#\"")),
        ("primitives", of_text(in_mesh, r#"{"attributes":{}}"#)),
        (
            "primitives with attributes",
            of_text(in_mesh, r#"{"attributes":{"_":0}}"#),
        ),
        (
            "attributes",
            of_text(
                r#""meshes":[{"primitives":[{"attributes":{@}}]}]"#,
                r#""_#":0"#,
            ),
        ),
        (
            "targets",
            of_text(
                r#""meshes":[{"primitives":[{"attributes":{},"targets":[@]}]}]"#,
                "{}",
            ),
        ),
        (
            "channels",
            of_text(r#""animations":[{"samplers":[],"channels":[@]}]"#, channel),
        ),
        ("children", of_text(r#""nodes":[{"children":[@]}]"#, "#")),
        ("weights", of_text(r#""nodes":[{"weights":[@]}]"#, "0")),
        ("joints", of_text(r#""skins":[{"joints":[@]}]"#, "0")),
        ("lists in extensions", of_text(in_extensions, "[]")),
        ("numbers in extensions", of_text(in_extensions, "0")),
        ("objects in extensions", of_text(in_extensions, r#"{"":0}"#)),
        ("strings in extensions", of_text(in_extensions, r#""""#)),
        (
            "names in extensions",
            of_text(r#""nodes":[{"extensions":{@}}]"#, "\"#\":0"),
        ),
        (
            "extensions",
            of_list("materials", r#"{"extensions":{"":{"":[[]]}}}"#),
        ),
        (
            "extensions of the root",
            of_text(r#""extensions":{"x":[@]}"#, "[[]]"),
        ),
        (
            "bounds of an accessor",
            of_text(
                r#""accessors":[{"componentType":5126,"count":0,"type":"SCALAR","min":[@]}]"#,
                "[]",
            ),
        ),
        ("extras", of_text(r#""nodes":[{"extras":[@]}]"#, "[]")),
        ("what nobody knows", of_text(r#""unknown":[@]"#, "[]")),
    ];
    // A list that comes twice, and one that the reader for scenes without nodes must leave alone.
    let materials = list(TEXT_BYTES / 6, "{}");
    let twice = format!(r#"{{{ASSET},"materials":[{materials}],"materials":[{materials}]}}"#);
    bombs.push(("materials twice", twice));
    let beside = list(TEXT_BYTES / 7, r#"{"":0}"#);
    let scene = format!(r#"{{{ASSET},"scenes":[{{}}],"unknown":[{beside}]}}"#);
    bombs.push(("objects beside a scene without nodes", scene));
    bombs
}

#[test]
fn documents_stay_within_the_limit() {
    for (name, json) in bombs() {
        import_within(name, "gltf", json.as_bytes());
    }
}

#[test]
fn documents_are_refused_for_what_they_would_take() {
    for key in ["materials", "scenes", "nodes", "images", "samplers"] {
        let json = of_list(key, "{}");
        let outcome = import_within(key, "gltf", json.as_bytes());
        let error = outcome.error();
        assert!(error.contains(&format!("({key}[")), "{error}");
        assert!(error.contains("bytes of memory at most"), "{error}");
    }
}

/// Nine megabytes, without any limit: three gigabytes once.
#[test]
fn empty_materials_are_refused_without_a_limit() {
    let json = format!(r#"{{{ASSET},"materials":[{}]}}"#, list(3_000_000, "{}"));
    let outcome = import("gltf", json.as_bytes(), &OpenOptions::default());
    assert!(
        outcome.error().contains("bytes of memory at most"),
        "{}",
        outcome.error()
    );
    assert!(outcome.peak_bytes < 64 << 20, "{}", outcome.peak_bytes);
}

/// A city of a million nodes is no bomb.
#[test]
fn a_million_nodes_are_read() {
    let node = r#"{"mesh":0,"translation":[#,0,1.5]}"#;
    let mut json = format!(r#"{{{ASSET},"nodes":[{}],"#, list(1_000_000, node));
    json.push_str(
        r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36}]}"#,
    );
    let corners: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let bin: Vec<u8> = corners.iter().flat_map(|it| it.to_le_bytes()).collect();
    let limit_bytes = 1 << 30;
    let outcome = import("glb", &glb(&json, &bin), &super::within(limit_bytes));
    let peak_bytes = outcome.peak_bytes;
    println!(
        "a million nodes: peak {} KiB, {}",
        peak_bytes >> 10,
        outcome.error()
    );
    let scene = outcome.scene.expect("is read");
    assert_eq!(scene.instances.len(), 1_000_000);
    assert!(peak_bytes < limit_bytes, "{peak_bytes}");
}

#[test]
fn long_strings_stay_within_the_limit() {
    let plain = "x".repeat(16 << 20);
    let escaped = "\\u0041".repeat(3 << 20);
    for text in [&plain, &escaped] {
        for json in [
            format!(r#"{{{ASSET},"nodes":[{{"name":"{text}"}}]}}"#),
            format!(r#"{{{ASSET},"scenes":[{{"name":"{text}","nodes":[]}}]}}"#),
            format!(r#"{{{ASSET},"materials":[{{"name":"{text}"}}]}}"#),
            format!(r#"{{{ASSET},"extensionsRequired":["{text}"]}}"#),
            format!(r#"{{{ASSET},"extensionsUsed":["{text}"]}}"#),
            format!(r#"{{{ASSET},"images":[{{"uri":"{text}"}}]}}"#),
            format!(r#"{{{ASSET},"buffers":[{{"byteLength":1,"uri":"{text}"}}]}}"#),
            format!(r#"{{{ASSET},"buffers":[{{"byteLength":1,"uri":"data:,{text}"}}]}}"#),
            format!(r#"{{"asset":{{"version":"{text}"}}}}"#),
            format!(r#"{{{ASSET},"{text}":0}}"#),
            format!(r#"{{{ASSET},"scene":"{text}"}}"#),
            format!(r#"{{{ASSET},"nodes":[{{"extensions":{{"x":"{text}"}}}}]}}"#),
        ] {
            let outcome = import("gltf", json.as_bytes(), &OpenOptions::default());
            // The text, the string, and what a data: URI stands for.
            let most = json.len() * 7 / 2 + (1 << 20);
            let error = outcome.error();
            assert!(
                outcome.peak_bytes <= most,
                "{} of {most}: {error}",
                outcome.peak_bytes
            );
            import_within("a long string", "gltf", json.as_bytes());
        }
    }
}

/// Names go on to the scene, the library and every viewer.
#[test]
fn names_are_cut() {
    let name = "näme".repeat(1 << 16);
    let json =
        format!(r#"{{{ASSET},"scenes":[{{"name":"{name}"}}],"materials":[{{"name":"{name}"}}]}}"#);
    let outcome = import("gltf", json.as_bytes(), &OpenOptions::default());
    let scene = outcome.scene.expect("is read");
    assert_eq!(scene.name.chars().count(), 257);
    assert_eq!(scene.materials[0].name.chars().count(), 257);
}

/// Deeper than any stack, in each bracket.
#[test]
fn deep_nesting_is_refused() {
    for (open, close) in [("[", "]"), (r#"{"a":"#, "}"), (r#"[{"a":"#, "}]")] {
        for key in ["unknown", "extras", "extensions", "nodes"] {
            let depth = 200_000;
            let json = format!(
                r#"{{{ASSET},"{key}":{}0{}}}"#,
                open.repeat(depth),
                close.repeat(depth)
            );
            let outcome = import_within("deep nesting", "gltf", json.as_bytes());
            assert!(
                outcome.error().contains("recursion limit"),
                "{}",
                outcome.error()
            );
        }
    }
}

#[test]
fn chunks_are_counted() {
    let mut file = glb(&format!("{{{ASSET}}}"), &[]);
    file.extend([0u8, 0, 0, 0, b'X', b'X', b'X', b'X'].repeat(1 << 19));
    let length = file.len() as u32;
    file[8..12].copy_from_slice(&length.to_le_bytes());
    let outcome = import_within("chunks", "glb", &file);
    assert!(
        outcome.error().contains("1024 chunks at most"),
        "{}",
        outcome.error()
    );
}

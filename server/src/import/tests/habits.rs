//! Habits: what exporters write beyond the specification, or beside what is read.

use serde_json::{Value, json};

use super::{File, QUAD, find, quad, read};

/// The glb of `file` with `before` and `after` around its JSON.
fn padded(file: &File, before: &[u8], after: &[u8]) -> Vec<u8> {
    let glb = file.glb();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let (head, rest) = glb.split_at(20);
    let (json, bin) = rest.split_at(length);
    let mut json = [before, json.trim_ascii_end(), after].concat();
    json.resize(
        json.len().next_multiple_of(4),
        after.last().copied().unwrap_or(b' '),
    );
    let mut whole = [head, &json, bin].concat();
    whole[12..16].copy_from_slice(&(json.len() as u32).to_le_bytes());
    let length = whole.len() as u32;
    whole[8..12].copy_from_slice(&length.to_le_bytes());
    whole
}

#[test]
fn byte_order_marks_and_padding_stand_around_the_document() {
    let file = quad();
    let mark = b"\xef\xbb\xbf";
    for (before, after) in [
        (&mark[..], &b""[..]),
        (mark, b"\0\0\0\0\0"),
        (b"", b"\0"),
        (b" \n", b"\r\n  \0\0"),
        (b"", b"   "),
    ] {
        let scene = read(&padded(&file, before, after)).unwrap();
        assert_eq!(scene.meshes[0].positions, QUAD);
        // The same text alone, its buffer inline.
        let mut alone = file.json.clone();
        let bytes = file.bin.iter().map(|byte| format!("%{byte:02x}"));
        let uri = format!("data:,{}", bytes.collect::<String>());
        alone["buffers"] = json!([{"byteLength": file.bin.len(), "uri": uri}]);
        let text = [before, alone.to_string().as_bytes(), after].concat();
        let scene = read(&text).unwrap();
        assert_eq!(scene.meshes[0].positions, QUAD);
    }
    // No other text may stand there.
    assert!(read(&padded(&file, b"", b"\0x")).is_err());
    assert!(read(&padded(&file, b"\0", b"")).is_err());
}

/// The glb of `file` with every integer of its JSON as `change` writes it.
fn respelt(file: &File, change: fn(u64) -> String) -> Vec<u8> {
    let glb = file.glb();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    fn write(value: &Value, change: fn(u64) -> String) -> String {
        match value {
            Value::Number(number) if number.is_u64() => change(number.as_u64().unwrap()),
            Value::Array(list) => {
                let items: Vec<String> = list.iter().map(|it| write(it, change)).collect();
                format!("[{}]", items.join(","))
            }
            Value::Object(map) => {
                let member =
                    |(key, it): (&String, &Value)| format!("{}:{}", json!(key), write(it, change));
                let members: Vec<String> = map.iter().map(member).collect();
                format!("{{{}}}", members.join(","))
            }
            other => other.to_string(),
        }
    }
    let mut json = write(&json, change).into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut whole = [&glb[..20], &json, &glb[20 + length..]].concat();
    whole[12..16].copy_from_slice(&(json.len() as u32).to_le_bytes());
    let length = whole.len() as u32;
    whole[8..12].copy_from_slice(&length.to_le_bytes());
    whole
}

#[test]
fn whole_numbers_may_have_a_point_or_an_exponent() {
    let mut file = quad();
    let uvs = file.floats(&[[0.25, 0.25]; 4]);
    let primitive = &mut file.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["TEXCOORD_0"] = uvs.into();
    primitive["mode"] = 4.into();
    primitive["material"] = 0.into();
    file.json["bufferViews"][0]["byteStride"] = 12.into();
    file.json["samplers"] = json!([{"magFilter": 9728, "wrapS": 33071}]);
    file.json["materials"] = json!([{}]);
    let plain = file.scene();
    let changes: [fn(u64) -> String; 3] = [
        |number| format!("{number}.0"),
        |number| format!("{number}.000e0"),
        |number| format!("{}e-1", number * 10),
    ];
    for change in changes {
        let scene = read(&respelt(&file, change)).unwrap();
        assert_eq!(scene.meshes, plain.meshes);
        assert_eq!(scene.instances, plain.instances);
    }
    let zero: fn(u64) -> String = |number| match number {
        0 => "-0".to_owned(),
        number => number.to_string(),
    };
    assert_eq!(read(&respelt(&file, zero)).unwrap().meshes, plain.meshes);
    for (change, found) in [
        (
            (|it| format!("{it}.5")) as fn(u64) -> String,
            "floating point",
        ),
        (|it| format!("-{}", it + 1), "integer `-"),
        (|_| "1e300".to_owned(), "floating point"),
        (|_| "\"1\"".to_owned(), "string"),
    ] {
        let fault = read(&respelt(&file, change)).unwrap_err().to_string();
        assert!(
            fault.contains("a whole number") && fault.contains(found),
            "{fault}"
        );
    }
}

#[test]
fn null_stands_for_an_absent_member() {
    let mut file = quad();
    let null = Value::Null;
    for (path, keys) in [
        (
            "",
            &[
                "extras",
                "extensions",
                "animations",
                "cameras",
                "skins",
                "materials",
            ][..],
        ),
        (
            "/nodes/0",
            &[
                "children", "name", "skin", "matrix", "rotation", "weights", "camera",
            ],
        ),
        ("/meshes/0", &["name", "weights", "extras"]),
        (
            "/meshes/0/primitives/0",
            &["material", "mode", "targets", "extensions"],
        ),
        ("/meshes/0/primitives/0/attributes", &["NORMAL", "COLOR_0"]),
        (
            "/accessors/0",
            &["min", "max", "sparse", "byteOffset", "normalized", "name"],
        ),
        ("/bufferViews/0", &["byteStride", "target", "extensions"]),
        ("/buffers/0", &["uri", "name"]),
        ("/scenes/0", &["name"]),
    ] {
        for key in keys {
            file.json.pointer_mut(path).unwrap()[key] = null.clone();
        }
    }
    assert_eq!(file.scene().meshes, quad().scene().meshes);
}

#[test]
fn empty_lists_and_names_of_other_types_are_passed_over() {
    let mut file = quad();
    for key in [
        "animations",
        "cameras",
        "images",
        "materials",
        "samplers",
        "skins",
        "textures",
    ] {
        file.json[key] = json!([]);
    }
    file.json["nodes"][0]["children"] = json!([]);
    file.json["nodes"][0]["weights"] = json!([]);
    file.json["meshes"][0]["name"] = json!(7);
    file.json["scenes"][0]["name"] = json!(["a"]);
    let scene = file.scene();
    assert_eq!(
        (scene.name.as_str(), scene.meshes[0].name.as_str()),
        ("test", "mesh_0")
    );
    assert_eq!(scene.meshes[0].positions, QUAD);
}

/// The last counts, as in other readers of JSON.
#[test]
fn repeated_members_are_read_as_the_last() {
    let file = quad();
    let glb = file.glb();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let text = String::from_utf8(glb[20..20 + length].to_vec()).unwrap();
    let text = text.replace(r#""mesh":0"#, r#""mesh":9,"mesh":0"#);
    let text = text.replace(r#""POSITION":0"#, r#""POSITION":1,"POSITION":0"#);
    let text = text.replacen('{', r#"{"meshes":[],"#, 1);
    let mut json = text.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut whole = [&glb[..20], &json, &glb[20 + length..]].concat();
    whole[12..16].copy_from_slice(&(json.len() as u32).to_le_bytes());
    let all = whole.len() as u32;
    whole[8..12].copy_from_slice(&all.to_le_bytes());
    assert_eq!(read(&whole).unwrap().meshes[0].positions, QUAD);
}

/// Nothing that the import ignores can refuse a file.
#[test]
fn members_that_nobody_reads_may_hold_anything() {
    let mut file = quad();
    file.json["animations"] = json!([
        {"channels": [{"sampler": 0, "target": {"path": "weights"}}], "samplers": [{"input": -1}]},
        {"channels": [{"target": {"path": "pointer", "extensions": {"KHR_animation_pointer": {}}}}]},
        7,
    ]);
    file.json["cameras"] = json!([{"type": "orthographic"}, null]);
    file.json["skins"] = json!([{"joints": [99], "skeleton": "none"}]);
    file.json["extras"] = json!({"count": -1.5});
    file.json["nodes"][0]["camera"] = json!(99);
    file.json["accessors"][0]["min"] = json!("nothing");
    file.json["accessors"][0]["max"] = json!([1e300]);
    let unread = json!({"componentType": 5130, "type": "MAT9"});
    file.push("accessors", unread);
    let views = json!({"buffer": 77, "byteOffset": 0});
    file.push("bufferViews", views);
    for uri in [
        None,
        Some("nothere.bin"),
        Some("http://127.0.0.1:9/x"),
        Some("data:;base64,@"),
    ] {
        let mut buffer = json!({"byteLength": 1000});
        if let Some(uri) = uri {
            buffer["uri"] = uri.into();
        }
        file.push("buffers", buffer);
    }
    let primitive = &mut file.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["TANGENT"] = 99.into();
    primitive["attributes"]["JOINTS_0"] = 98.into();
    primitive["targets"] = json!([{"POSITION": 97}]);
    let scene = file.scene();
    assert_eq!(scene.meshes[0].positions, QUAD);
    find(&scene.warnings, "animations left out: 3");
    find(&scene.warnings, "cameras left out: 2");
    // A buffer that is read must be there.
    file.json["bufferViews"][0]["buffer"] = 2.into();
    assert!(file.fault().contains("buffers[2]"), "{}", file.fault());
    file.json["bufferViews"][0]["buffer"] = 1.into();
    assert!(
        file.fault().contains("buffers[1]: expected a uri"),
        "{}",
        file.fault()
    );
}

#[test]
fn integer_colours_are_normalized_whatever_their_accessor_says() {
    for (component, bytes) in [
        (5121, vec![255, 0, 51, 102]),
        (5123, {
            let shorts = [65_535u16, 0, 13_107, 26_214];
            shorts.iter().flat_map(|it| it.to_le_bytes()).collect()
        }),
    ] {
        let mut file = quad();
        let color = file.accessor(&bytes.repeat(4), component, "VEC4", 4);
        let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
        attributes["COLOR_0"] = color.into();
        let scene = file.scene();
        assert_eq!(scene.meshes[0].colors, Some(vec![[255, 0, 51, 102]; 4]));
        find(&scene.warnings, "integer COLOR_0 read as normalized");
        file.json["accessors"][color]["normalized"] = true.into();
        let scene = file.scene();
        assert_eq!(scene.meshes[0].colors, Some(vec![[255, 0, 51, 102]; 4]));
        assert!(!scene.warnings.iter().any(|it| it.contains("normalized")));
    }
}

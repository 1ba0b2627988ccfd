//! Broken input: a fault that names its place, and never a panic.

use serde_json::{Value, json};

use super::{File, picture, quad, read};

#[test]
fn faults_name_their_place() {
    let edit = |path: &str, value: Value| {
        let mut file = quad();
        *file.json.pointer_mut(path).unwrap() = value;
        file.fault()
    };
    let cases = [
        (
            "/meshes/0/primitives/0/indices",
            json!(7),
            "meshes[0].primitives[0].indices: expected one of 2 accessors, found index 7",
        ),
        (
            "/meshes/0/primitives/0/indices",
            json!(4_294_967_296u64),
            "(meshes[0].primitives[0].indices): expected an index below",
        ),
        (
            "/accessors/0/count",
            json!(2.5),
            "POSITION (accessors[0]): expected an accessor, found invalid value: floating point `2.5`, expected a whole number",
        ),
        (
            "/accessors/0/count",
            json!(5),
            "POSITION (accessor 0): expected elements within the 48 bytes of its view, found 5 of them",
        ),
        (
            "/bufferViews/0/byteLength",
            json!(1000),
            "bufferViews[0]: expected a range within 60 bytes, found 1000 bytes at 0",
        ),
        (
            "/asset/version",
            json!("1\n.0"),
            "asset.version: expected 2.0, found 1\\n.0",
        ),
        (
            "/meshes/0/primitives/0/attributes",
            json!({"POSITION": 0, "NORMAL": 1}),
            "NORMAL (accessor 1): expected 4 elements, as many as POSITION, found 6",
        ),
    ];
    for (path, value, expected) in cases {
        let fault = edit(path, value);
        assert!(fault.contains(expected), "{fault}");
        assert_eq!(fault.lines().count(), 1, "{fault}");
    }
}

#[test]
fn a_small_file_cannot_unfold_to_a_huge_one() {
    let mut file = File::new();
    let position = file.floats(&vec![[0.0; 3]; 30_000]);
    for _ in 0..2000 {
        file.primitive(json!({"attributes": {"POSITION": position}}));
    }
    let fault = file.fault();
    assert!(fault.contains("corners at most"), "{fault}");
}

#[test]
fn no_cut_or_flipped_byte_panics() {
    let mut file = quad();
    let uv = file.floats(&[[0.5, 0.25]; 4]);
    file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv.into();
    let png = file.view(&picture(image::ImageFormat::Png));
    let jpeg = file.view(&picture(image::ImageFormat::Jpeg));
    file.json["images"] = json!([{"bufferView": png}, {"bufferView": jpeg}]);
    file.json["textures"] = json!([{"source": 0}, {"source": 1}]);
    file.json["materials"] = json!([
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}},
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}},
    ]);
    let whole = file.glb();
    assert!(read(&whole).is_ok());
    for length in 0..whole.len() {
        assert!(read(&whole[..length]).is_err(), "cut to {length}");
    }
    for at in 0..whole.len() {
        for flip in [0x01, 0x10, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            if let Err(fault) = read(&bytes) {
                assert_eq!(fault.to_string().lines().count(), 1);
            }
        }
    }
}

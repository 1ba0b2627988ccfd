//! References to files beside the model: none is opened where the model must be self-contained, and
//! no error or warning quotes another file.

use std::path::{Path, PathBuf};

use lodestream_server::import::{ImportError, ImportedScene, OpenOptions, open};

/// Bytes that must not come back.
const SECRET: &str = "S3CRET_1";

/// A folder with a model's folder in it; secrets lie beside the model and above it.
struct Rig {
    folder: tempfile::TempDir,
}

impl Rig {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let models = folder.path().join("models/sub");
        std::fs::create_dir_all(models).expect("a folder");
        for name in [
            "secret",
            "models/secret",
            "models/sub/secret",
            "models/a b",
            "models/secret.mtl",
        ] {
            // A material library as well as a buffer and a text.
            let text = format!(
                "{SECRET} \nnewmtl m\nKd {SECRET}\nmap_{SECRET} x\n{}",
                "x".repeat(99)
            );
            std::fs::write(folder.path().join(name), text).expect("writes");
        }
        Self { folder }
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join("models").join(name);
        std::fs::write(&path, bytes).expect("writes");
        path
    }

    /// Ways to name the secrets, and files that are not there.
    fn references(&self) -> Vec<String> {
        let absolute = self.folder.path().join("secret");
        let absolute = absolute.to_str().expect("UTF-8");
        let mut references: Vec<String> = [
            "secret",
            "./secret",
            "sub/secret",
            "../secret",
            "sub/../secret",
            "%73ecret",
            "%2e%2e/secret",
            "..%2fsecret",
            "..\\secret",
            "sub\\secret",
            "a%20b",
            "missing",
            "sub/missing",
            "secret?x",
            "secret#x",
            "//host/share/x",
            "\\\\host\\share\\x",
            "C:\\x",
            "http://127.0.0.1:9/x",
            "FILE:///etc/hostname",
            "dat:,x",
            " data:,x",
        ]
        .map(str::to_owned)
        .to_vec();
        references.extend([absolute.to_owned(), format!("file://{absolute}")]);
        references.extend([
            format!("/proc/self/root{absolute}"),
            "secret.mtl".to_owned(),
        ]);
        references
    }
}

fn self_contained() -> OpenOptions {
    OpenOptions {
        self_contained: true,
        ..OpenOptions::default()
    }
}

fn read(path: &Path, options: &OpenOptions) -> Result<ImportedScene, ImportError> {
    open(path, options)?.into_imported()
}

fn json_text(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

/// A triangle whose buffer and image are at `buffer` and `image`.
fn gltf(buffer: &str, image: &str) -> Vec<u8> {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"meshes":[{{"primitives":[{{"attributes":
        {{"POSITION":0}},"material":0}}]}}],"accessors":[{{"bufferView":0,"componentType":5126,
        "count":3,"type":"VEC3"}}],"bufferViews":[{{"buffer":0,"byteLength":36}}],
        "buffers":[{{"byteLength":36,"uri":{}}}],"images":[{{"uri":{}}}],
        "textures":[{{"source":0}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}]}}"#,
        json_text(buffer),
        json_text(image)
    )
    .into_bytes()
}

/// The corners (0 0 0), (1 0 0) and (0 1 0).
fn inline_buffer() -> String {
    let zeros = "%00".repeat(12);
    let one = "%00%00%80%3f";
    let zero = "%00%00%00%00";
    format!("data:,{zeros}{one}{zero}{zero}{zero}{one}{zero}")
}

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";

const PLY: &str = "ply\nformat ascii 1.0\ncomment TextureFile NAME\nelement vertex 3\n\
    property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0 0 0\n1 0 0 0 0\n0 1 0 0 0\n3 0 1 2\n";

#[test]
fn buffers_in_other_files_are_refused() {
    let rig = Rig::new();
    for reference in rig.references() {
        let model = rig.write("model.gltf", &gltf(&reference, "data:,"));
        let error = read(&model, &self_contained()).expect_err(&reference);
        let text = error.fault.to_string();
        assert!(
            text.starts_with("buffers[0].uri: expected data inside"),
            "{text}"
        );
        assert!(text.contains("--self-contained"), "{text}");
        assert!(!text.contains(SECRET), "{text}");
    }
}

#[test]
fn whether_a_file_exists_is_not_told() {
    let rig = Rig::new();
    let told = |reference: &str| {
        let model = rig.write("model.gltf", &gltf(reference, "data:,"));
        let error = read(&model, &self_contained()).expect_err(reference);
        error.fault.to_string().replace(reference, "NAME")
    };
    assert_eq!(told("secret"), told("missing"));
    assert_eq!(told("../secret"), told("../missing"));
    assert_eq!(told("sub"), told("missing"));
}

#[test]
fn images_in_other_files_are_left_out() {
    let rig = Rig::new();
    for reference in rig.references() {
        let model = rig.write("model.gltf", &gltf(&inline_buffer(), &reference));
        let scene = read(&model, &self_contained()).expect(&reference);
        assert!(scene.images.is_empty(), "{reference}");
        let warnings = scene.warnings.concat();
        assert!(
            warnings.contains("images in other files left out"),
            "{warnings}"
        );
        assert!(!warnings.contains(SECRET), "{warnings}");
    }
}

#[test]
fn material_libraries_and_textures_of_mesh_files_are_left_out() {
    let rig = Rig::new();
    for reference in rig.references() {
        let model = rig.write("model.obj", format!("mtllib {reference}\n{OBJ}").as_bytes());
        let scene = read(&model, &self_contained()).expect(&reference);
        assert_eq!(scene.source_triangles, 1);
        let warnings = scene.warnings.concat();
        assert!(
            warnings.contains("material libraries left out (--self-"),
            "{warnings}"
        );
        assert!(!warnings.contains(SECRET), "{warnings}");

        let model = rig.write("model.ply", PLY.replace("NAME", &reference).as_bytes());
        let scene = read(&model, &self_contained()).expect(&reference);
        let warnings = scene.warnings.concat();
        assert!(
            warnings.contains("images in other files left out"),
            "{warnings}"
        );
        assert!(!warnings.contains(SECRET), "{warnings}");
    }
}

#[test]
fn inline_data_is_read() {
    let rig = Rig::new();
    let model = rig.write("model.gltf", &gltf(&inline_buffer(), "DATA:,x"));
    let scene = read(&model, &self_contained()).expect("reads");
    assert_eq!(scene.source_triangles, 1);
    assert_eq!(scene.meshes[0].positions[1], [1.0, 0.0, 0.0]);
}

/// Buffers and images of glTF files, as those of OBJ and PLY.
#[test]
fn files_named_as_on_another_machine_are_found_below_the_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("maps")).expect("makes a folder");
    let corners = [[0.0f32, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
    let bytes: Vec<u8> = corners
        .iter()
        .flatten()
        .flat_map(|it| it.to_le_bytes())
        .collect();
    std::fs::write(folder.path().join("maps/a b.bin"), bytes).expect("writes");
    let picture = image::DynamicImage::new_rgb8(3, 2);
    picture
        .save(folder.path().join("maps/a b.png"))
        .expect("writes");
    let model = folder.path().join("model.gltf");
    for name in [
        "C:\\work\\maps\\a b",
        "C:/models/maps/a%20b",
        "/home/me/maps/a b",
        "file:///C:/models/maps/a%20b",
        "none/../maps/a b",
        "../maps/a b",
    ] {
        for (buffer, image) in [("bin", "png"), ("bin?v=1", "png?v=1")] {
            let (buffer, image) = (format!("{name}.{buffer}"), format!("{name}.{image}"));
            std::fs::write(&model, gltf(&buffer, &image)).expect("writes");
            let scene = read(&model, &OpenOptions::default()).expect(name);
            assert_eq!(scene.meshes[0].positions, corners, "{name}");
            assert_eq!((scene.images[0].width, scene.images[0].height), (3, 2));
            for what in ["buffer", "image"] {
                let found = |line: &String| line.starts_with(&format!("{what} "));
                let line = scene.warnings.iter().find(|line| found(line)).expect(what);
                assert!(line.contains("found by another spelling"), "{line}");
            }
            // Neither is looked for where the model must hold all.
            assert!(read(&model, &self_contained()).is_err(), "{name}");
            std::fs::write(&model, gltf(&inline_buffer(), &image)).expect("writes");
            let scene = read(&model, &self_contained()).expect(name);
            assert!(scene.images.is_empty(), "{name}");
        }
    }
}

/// Without the option the model's own folder is read, and nothing above it.
#[test]
fn no_text_quotes_another_file() {
    let rig = Rig::new();
    let default = OpenOptions::default();
    for reference in rig.references() {
        for (buffer, image) in [
            (reference.clone(), "data:,".to_owned()),
            (inline_buffer(), reference.clone()),
        ] {
            let model = rig.write("model.gltf", &gltf(&buffer, &image));
            match read(&model, &default) {
                Ok(scene) => assert!(!scene.warnings.concat().contains(SECRET)),
                Err(error) => assert!(!error.fault.to_string().contains(SECRET), "{error}"),
            }
        }
        let model = rig.write("model.obj", format!("mtllib {reference}\n{OBJ}").as_bytes());
        match read(&model, &default) {
            Ok(scene) => assert!(!scene.warnings.concat().contains(SECRET)),
            Err(error) => assert!(!error.fault.to_string().contains(SECRET), "{error}"),
        }
        let model = rig.write("model.ply", PLY.replace("NAME", &reference).as_bytes());
        let scene = read(&model, &default).expect("reads");
        assert!(
            !scene.warnings.concat().contains(SECRET),
            "{:?}",
            scene.warnings
        );
    }
}

/// Names with control characters, escape sequences and marks that turn text, and very long ones.
#[test]
fn names_are_quoted_short_and_printable() {
    let rig = Rig::new();
    let names = [
        "\u{1b}[31mred\u{1b}[0m".to_owned(),
        "a\nb\rc".to_owned(),
        "\u{202e}gpj.x\u{2066}".to_owned(),
        "\u{9b}2J".to_owned(),
        "long".repeat(1 << 16),
    ];
    for name in names {
        for options in [OpenOptions::default(), self_contained()] {
            let model = rig.write("model.gltf", &gltf(&name, "data:,"));
            let error = read(&model, &options).expect_err("refused");
            let model = rig.write("model.obj", format!("mtllib {name}\n{OBJ}").as_bytes());
            let lines = match read(&model, &options) {
                Ok(scene) => scene.warnings,
                Err(error) => vec![error.fault.to_string()],
            };
            for text in lines.iter().chain([&error.fault.to_string()]) {
                assert!(text.chars().count() < 500, "{text}");
                let printable = |it: char| !it.is_control() && !"\u{202e}\u{2066}".contains(it);
                assert!(text.chars().all(printable), "{text:?}");
            }
        }
    }
}

//! Files of other kinds under the name of a model are refused.

use super::{area, read, warns};

/// One of each kind that is at hand everywhere.
fn foreign() -> Vec<(&'static str, Vec<u8>)> {
    let mut png = std::io::Cursor::new(vec![]);
    let pixel = |x: u32, y: u32| image::Rgb([(x * 7) as u8, (y * 13) as u8, (x * y) as u8]);
    let picture = image::RgbImage::from_fn(100, 80, pixel);
    picture
        .write_to(&mut png, image::ImageFormat::Png)
        .expect("writes");
    let mut state = 1u64;
    let mut random = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 56) as u8
    };
    let noise: Vec<u8> = (0..84 + 50 * 100).map(|_| random()).collect();
    // As long as binary facets, with a count of none.
    let mut counted = noise.clone();
    counted[80..84].fill(0);
    let mut letters = noise.iter().map(|it| b' ' + it % 95).collect::<Vec<u8>>();
    letters[40..44].copy_from_slice(b"\n#\nv");
    let program = std::fs::read(env!("CARGO_BIN_EXE_lodestream-server")).expect("reads");
    let text = |it: &str| it.as_bytes().to_vec();
    vec![
        ("nothing", vec![]),
        ("blanks", vec![b'\n'; 200]),
        ("a picture", png.into_inner()),
        ("a program", program[..100_000].to_vec()),
        ("noise", noise),
        ("noise of 100 facets", counted),
        ("letters", letters),
        ("zeros", vec![0; 84 + 50 * 3 + 1]),
        ("source", include_bytes!("foreign.rs").to_vec()),
        ("a manifest", include_bytes!("../../Cargo.toml").to_vec()),
        ("JSON", text("{\n  \"asset\": {\"version\": \"2.0\"}\n}\n")),
        (
            "XML",
            text("<?xml version=\"1.0\"?>\n<COLLADA>\n</COLLADA>\n"),
        ),
        (
            "prose",
            text("Some parts\ng are named as statements.\nThe others are not.\n"),
        ),
        ("remarks", text("# a title\n# and no more\n")),
        ("a table", text("x,y,z\n1,2,3\n4,5,6\n")),
        ("points", text("1 2 3\n4 5 6\n")),
        ("a library", text("newmtl m\nKd 1 0 0\nd 1\n")),
        (
            "two bytes a letter",
            text("v 0 0 0\n").iter().flat_map(|it| [*it, 0]).collect(),
        ),
    ]
}

#[test]
fn files_of_other_kinds_are_refused() {
    for (kind, bytes) in foreign() {
        for extension in ["obj", "stl", "ply"] {
            let name = format!("x.{extension}");
            let error = read(&name, &bytes).err();
            let error = error.unwrap_or_else(|| panic!("{kind} is read as {extension}"));
            assert_eq!(error.lines().count(), 1, "{error}");
            assert!(error.contains(&name), "{error}");
        }
    }
}

/// More lines that are none than statements, bytes that are no text, and statements of nothing.
#[test]
fn stray_lines_count() {
    let model = "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n";
    let few = format!("exported by hand\n{model}and so on\n");
    let scene = read("a.obj", few).expect("is read");
    assert_eq!(area(&scene), 1.0);
    assert!(warns(&scene, &["unknown statements left out: 2", "line 1"]));
    let many = format!("{model}{}", "and so on\n".repeat(5));
    let error = read("a.obj", many).expect_err("is refused");
    assert!(
        error.contains("line 5: expected a statement of OBJ, found \"and so on\""),
        "{error}"
    );
    for line in [
        &b"v 0 0 0\0"[..],
        b"g a\0b",
        b"odd \x01",
        b"odd \xff",
        b"\xff\xfe",
    ] {
        let bytes = [model.as_bytes(), line, b"\n"].concat();
        let error = read("a.obj", bytes).expect_err("is refused");
        assert!(error.contains("line 5: expected"), "{error}");
    }
    // Remarks and names may hold what they want.
    let names = [
        b"# \0 \xff\no caf\xe9\ng \xff\nusemtl \xe9\n",
        model.as_bytes(),
    ]
    .concat();
    assert_eq!(area(&read("a.obj", names).expect("is read")), 1.0);
    let empty = read("a.obj", "# Blender\no Cube\n").expect("is read");
    assert!(empty.meshes.is_empty());
}

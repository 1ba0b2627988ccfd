//! Broken files: a fault that names its place, and never a panic.

use lodestream_server::import::{OpenOptions, import, open};

use super::{FORMATS, OBJ, binary_stl, ply, read, square_corners, text_stl};

#[test]
fn broken_mesh_files_are_refused_with_their_place() {
    let ply = |body: &str| format!("ply\nformat ascii 1.0\n{body}").into_bytes();
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let one = |vertices: &str, face: &str| {
        let count = vertices.lines().count();
        ply(&format!(
            "element vertex {count}\n{xyz}{faces}{vertices}{face}"
        ))
    };
    let three = "0 0 0\n1 0 0\n0 1 0\n";
    let mut lying_stl = binary_stl("", &square_corners());
    lying_stl[80..84].copy_from_slice(&(u32::MAX - 1).to_le_bytes());
    let huge = format!("element vertex 4294967290\n{xyz}{faces}");
    let huge_binary = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\n{xyz}element face 99999999999\n\
         property list uint int vertex_indices\nend_header\n"
    );
    let mut long_list = huge_binary.clone().into_bytes();
    long_list.extend([0; 36]);
    long_list.extend(u32::MAX.to_le_bytes());
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        (
            "a.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_vec(),
            "line 4: expected an index into 3 positions, found 4",
        ),
        (
            "a.obj",
            b"v 0 0 0\nf 1 1 -2\n".to_vec(),
            "line 2: expected an index into 1 positions, from 1 or from -1",
        ),
        (
            "a.obj",
            b"v 0 0 0\nf 0 1 1\n".to_vec(),
            "line 2: expected an index",
        ),
        (
            "a.obj",
            b"v 1 1 1\nv 0 nan 0\nv 0 0 0\nf 1 2 3\n".to_vec(),
            "line 2: expected three finite numbers",
        ),
        (
            "a.obj",
            b"v 0 zero 0\n".to_vec(),
            "line 1: expected a number, found \"zero\"",
        ),
        (
            "a.obj",
            b"v 0 0\n".to_vec(),
            "line 1: expected three numbers",
        ),
        (
            "a.obj",
            vec![0x4c, 1, 0, 0, 0xff, 0xfe, 10, 3],
            "line 1: expected a statement of OBJ",
        ),
        ("a.ply", b"plyx\n".to_vec(), "header line 1: expected ply"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\n".to_vec(),
            "header line 3: expected end_header",
        ),
        (
            "a.ply",
            b"ply\nformat ascii 2.0\nend_header\n".to_vec(),
            "header line 2",
        ),
        (
            "a.ply",
            ply("element vertex -1\nend_header\n"),
            "header line 3: expected a number of elements",
        ),
        (
            "a.ply",
            ply("element vertex 1\nproperty half x\nend_header\n"),
            "header line 4",
        ),
        (
            "a.ply",
            ply("element vertex 1\nproperty float x\nend_header\n0\n"),
            "the properties x, y and z",
        ),
        (
            "a.ply",
            one(three, "3 0 1 3\n"),
            "face 0: expected indices below 3, found 3",
        ),
        (
            "a.ply",
            one(three, "3 0 1 -1\n"),
            "face 0: expected indices below 3, found -1",
        ),
        (
            "a.ply",
            one(three, "3 0 1 1.5\n"),
            "face 0: expected indices below 3, found 1.5",
        ),
        (
            "a.ply",
            one(three, "3 0 1\n"),
            "expected a number, found the end of the file",
        ),
        (
            "a.ply",
            one(three, "-3 0 1 2\n"),
            "expected a list's length, found -3",
        ),
        (
            "a.ply",
            one(three, "three\n"),
            "line 4 of the body: expected a number, found \"three\"",
        ),
        (
            "a.ply",
            one("0 0 0\n1 inf 0\n0 1 0\n", "3 0 1 2\n"),
            "vertex 1: expected finite numbers",
        ),
        ("a.ply", ply(&huge), "expected a number, found the end"),
        (
            "a.ply",
            huge_binary.into_bytes(),
            "expected 36 bytes more, found the end of the file after 0",
        ),
        (
            "a.ply",
            long_list,
            "expected 4 bytes more, found the end of the file after 0",
        ),
        (
            "a.stl",
            b"".to_vec(),
            "\"solid\" or a header of 84 bytes, found 0 bytes",
        ),
        (
            "a.stl",
            lying_stl,
            "expected 214748364784 bytes for 4294967294 facets",
        ),
        (
            "a.stl",
            b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0\nendloop".to_vec(),
            "line 5: expected a number, found \"endloop\"",
        ),
        (
            "a.stl",
            b"solid\n".to_vec(),
            "line 2: expected facet or endsolid, found the end of the file",
        ),
        ("a.xyz", b"1 2 3\n".to_vec(), "expected the magic"),
        ("a.glb", b"1 2 3\n".to_vec(), "expected the magic"),
    ];
    for (name, bytes, expected) in cases {
        let error = read(name, &bytes).expect_err(expected);
        assert!(error.contains(expected), "{error:?} has no {expected:?}");
        assert!(
            error.lines().count() == 1 && error.contains(name),
            "{error:?}"
        );
    }
}

/// Cut and changed files: an answer for each, never a panic. A cut binary file is always refused.
#[test]
fn no_cut_or_flipped_byte_panics() {
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<(&str, Vec<u8>, bool)> = vec![
        ("a.obj", OBJ.as_bytes().to_vec(), false),
        ("b.ply", ply(FORMATS[0], false), false),
        ("c.ply", ply(FORMATS[1], false), true),
        ("d.ply", ply(FORMATS[2], true), true),
        ("e.stl", binary_stl("solid", &square_corners()), true),
        ("f.stl", text_stl().into_bytes(), false),
    ];
    let streaming = OpenOptions::with_max_mesh_bytes(0);
    for (name, whole, binary) in files {
        let path = folder.path().join(name);
        let answer = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let loaded = import(&path).map_err(|error| error.to_string());
            let streamed = open(&path, &streaming).and_then(|it| it.into_imported());
            if let Err(error) = &loaded {
                assert_eq!(error.lines().count(), 1, "{error:?}");
            }
            assert_eq!(
                loaded.is_ok(),
                streamed.is_ok(),
                "{name}: {loaded:?} {streamed:?}"
            );
            loaded
        };
        assert!(answer(&whole).is_ok(), "{name}");
        for length in 0..whole.len() {
            assert!(
                answer(&whole[..length]).is_err() || !binary,
                "{name} cut to {length}"
            );
        }
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << (at * 5 % 8);
            let _ = answer(&bytes);
        }
    }
}

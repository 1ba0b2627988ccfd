//! Mesh files: lines, words, faces and headers.

use std::fmt::Write as _;

use super::{LIMIT, import, import_within, within};
use lodestream_server::import::OpenOptions;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[test]
fn material_libraries_make_few_warnings() {
    let mut obj = String::new();
    for at in 0..200_000 {
        writeln!(obj, "mtllib missing{at}.mtl").expect("writes");
    }
    obj.push_str(TRIANGLE);
    let outcome = import("obj", obj.as_bytes(), &OpenOptions::default());
    let scene = outcome.scene.expect("is read");
    assert!(scene.warnings.len() <= 101, "{}", scene.warnings.len());
    let most = obj.len() * 2;
    assert!(
        outcome.peak_bytes < most,
        "{} from {}",
        outcome.peak_bytes,
        obj.len()
    );
    // The same on one line.
    let names: Vec<String> = (0..1_000_000).map(|at| format!("m{at}")).collect();
    let obj = format!("mtllib {}\n{TRIANGLE}", names.join(" "));
    let outcome = import("obj", obj.as_bytes(), &OpenOptions::default());
    let most = obj.len() * 6;
    assert!(
        outcome.peak_bytes < most,
        "{} from {}",
        outcome.peak_bytes,
        obj.len()
    );
    assert!(outcome.scene.expect("is read").warnings.len() <= 101);
}

/// A library that many lines name is read once.
#[test]
fn a_material_library_is_read_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let library = format!("newmtl m\nKd 1 0 0\nmap_bump {}\n", "x".repeat(1 << 16)).repeat(4);
    std::fs::write(folder.path().join("m.mtl"), library).expect("writes");
    let path = folder.path().join("model.obj");
    let obj = format!("{}usemtl m\n{TRIANGLE}", "mtllib m.mtl\n".repeat(100));
    std::fs::write(&path, obj).expect("writes");
    let scene = lodestream_server::import::import(&path).expect("is read");
    let bump = scene.warnings.iter().find(|line| line.contains("map_bump"));
    assert!(bump.expect("a warning").contains("in 4 places"), "{bump:?}");
}

#[test]
fn obj_bombs_stay_within_the_limit() {
    let corners = |count: usize, step: usize| {
        let mut line = "f".to_owned();
        for at in 0..count {
            write!(line, " {}", at % step + 1).expect("writes");
        }
        line
    };
    let many_vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n".repeat(1000);
    let mut pairs = many_vertices.clone();
    for at in 0..1_000_000 {
        // A vertex of its own for each corner.
        let (position, uv) = (at % 3000 + 1, at / 3000 + 1);
        write!(
            pairs,
            "{}{position}/{uv}",
            if at % 3 == 0 { "\nf " } else { " " }
        )
        .expect("writes");
    }
    let bombs = [
        ("a long line of nothing", "x".repeat(40 << 20)),
        (
            "a long line of blanks",
            format!("{}\n{TRIANGLE}", " ".repeat(31 << 20)),
        ),
        (
            "a long comment",
            format!("#{}\n{TRIANGLE}", "x".repeat(31 << 20)),
        ),
        ("a long continuation", "\\\n".repeat(8 << 20)),
        ("a long number", format!("v 0 0 {}\n", "9".repeat(12 << 20))),
        (
            "a long word",
            format!("{TRIANGLE}f 1 2 {}\n", "x".repeat(12 << 20)),
        ),
        (
            "a face of many corners",
            format!("{TRIANGLE}{}\n", corners(4_000_000, 3)),
        ),
        (
            "relative corners",
            format!("{TRIANGLE}f{}\n", " -1 -2 -3".repeat(1 << 20)),
        ),
        ("corners of their own", pairs),
        (
            "short faces",
            format!("{TRIANGLE}{}", "f 1 2 3\n".repeat(1 << 20)),
        ),
        (
            "short positions",
            format!("{}{TRIANGLE}", "v 0 0 0\n".repeat(1 << 20)),
        ),
        (
            "coloured positions",
            format!("{}{TRIANGLE}", "v 0 0 0 1 1 1\n".repeat(1 << 20)),
        ),
        (
            "short coordinates",
            format!("{}{TRIANGLE}", "vt 0\n".repeat(2 << 20)),
        ),
        (
            "short normals",
            format!("{}{TRIANGLE}", "vn 0 0 1\n".repeat(1 << 20)),
        ),
        (
            "long names",
            format!("{TRIANGLE}usemtl {}\nf 1 2 3\n", "x".repeat(12 << 20)),
        ),
        (
            "unknown statements",
            format!("{TRIANGLE}{}", "a\nb\nc\n".repeat(1 << 20)),
        ),
    ];
    for (name, obj) in &bombs {
        import_within(name, "obj", obj.as_bytes());
    }
}

/// All the names of a file are kept, but few.
#[test]
fn materials_of_an_obj_stay_within_the_limit() {
    let mut obj = TRIANGLE.to_owned();
    for at in 0..60_000 {
        writeln!(obj, "usemtl {at}{}\nf 1 2 3", "x".repeat(200)).expect("writes");
    }
    import_within("names of materials", "obj", obj.as_bytes());
}

fn ply(format: &str, elements: &str, body: &[u8]) -> Vec<u8> {
    let head = format!("ply\nformat {format} 1.0\n{elements}end_header\n");
    [head.as_bytes(), body].concat()
}

const VERTEX: &str = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";

#[test]
fn ply_bombs_stay_within_the_limit() {
    let vertices: Vec<u8> = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        .iter()
        .flat_map(|it| it.to_le_bytes())
        .collect();
    let little = "binary_little_endian";
    let huge = VERTEX.replace('3', "4000000000");
    let faces = "element face 1000000000\nproperty list uchar int vertex_indices\n";
    let bytes = "element face 30000\nproperty list uchar uchar vertex_indices\n";
    let face: Vec<u8> = [255].into_iter().chain((0..255).map(|at| at % 3)).collect();
    let polygons = [vertices.clone(), face.repeat(30_000)].concat();
    let wide = "element face 1\nproperty list uint uchar vertex_indices\n";
    let corners: Vec<u8> = (0..4_000_000u32).map(|at| (at % 3) as u8).collect();
    let polygon = [&vertices, &4_000_000u32.to_le_bytes()[..], &corners].concat();
    let too_wide = [
        &vertices,
        &8_000_000u32.to_le_bytes()[..],
        &corners,
        &corners,
    ]
    .concat();
    let text_face = format!("255{}\n", " 0 1 2".repeat(85)).repeat(16_000);
    let text = format!("0 0 0\n1 0 0\n0 1 0\n{text_face}");
    let text_faces = "element face 16000\nproperty list uchar uchar vertex_indices\n";
    let doubles = "property double a\n".repeat(10_000);
    let elements: String = (0..60_000).fold(VERTEX.to_owned(), |mut all, at| {
        writeln!(all, "element e{at} 1").expect("writes");
        all
    });
    let properties: String = (0..40_000).fold(VERTEX.to_owned(), |mut all, at| {
        writeln!(all, "property float p{at}").expect("writes");
        all
    });
    let bombs = [
        ("many vertices", ply(little, &huge, &vertices)),
        ("many vertices of text", ply("ascii", &huge, b"0 0 0\n")),
        (
            "many faces",
            ply(little, &format!("{VERTEX}{faces}"), &vertices),
        ),
        (
            "many faces of text",
            ply("ascii", &format!("{VERTEX}{faces}"), b"0 0 0\n"),
        ),
        (
            "large faces",
            ply(little, &format!("{VERTEX}{bytes}"), &polygons),
        ),
        (
            "a large face",
            ply(little, &format!("{VERTEX}{wide}"), &polygon),
        ),
        (
            "a larger face",
            ply(little, &format!("{VERTEX}{wide}"), &too_wide),
        ),
        (
            "large faces of text",
            ply("ascii", &format!("{VERTEX}{text_faces}"), text.as_bytes()),
        ),
        (
            "wide vertices",
            ply("ascii", &format!("{huge}{doubles}"), b"0 0 0\n"),
        ),
        ("many elements", ply(little, &elements, &vertices)),
        ("many properties", ply(little, &properties, &vertices)),
        (
            "a header without an end",
            ply(little, &"comment x\n".repeat(1 << 18), &[]),
        ),
        ("a long word", ply("ascii", VERTEX, &[b'9'; 1 << 20])),
        ("a long line", ply("ascii", VERTEX, &[b' '; 8 << 20])),
    ];
    for (name, bytes) in &bombs {
        import_within(name, "ply", bytes);
    }
}

/// Faces of many corners are read in pieces, although their number is small, to the same triangles.
#[test]
fn polygons_are_counted_by_their_triangles() {
    let vertices: Vec<u8> = (0..256u32)
        .flat_map(|at| [at as f32, (at * at) as f32, 0.0])
        .flat_map(f32::to_le_bytes)
        .collect();
    let face: Vec<u8> = [255].into_iter().chain(0..255).collect();
    let body = [vertices, face.repeat(4000)].concat();
    let header = "element vertex 256\nproperty float x\nproperty float y\nproperty float z\n\
        element face 4000\nproperty list uchar uchar vertex_indices\n";
    let bytes = ply("binary_little_endian", header, &body);
    let whole = import("ply", &bytes, &OpenOptions::default());
    let pieces = import("ply", &bytes, &within(LIMIT));
    let (whole, pieces) = (
        whole.scene.expect("is read"),
        pieces.scene.expect("is read"),
    );
    assert_eq!(whole.source_triangles, 4000 * 253);
    assert_eq!(pieces.source_triangles, whole.source_triangles);
    let is_streamed = matches!(
        pieces.meshes[0],
        lodestream_server::import::OpenedMesh::Streamed(_)
    );
    assert!(is_streamed);
}

#[test]
fn stl_bombs_stay_within_the_limit() {
    let mut facets = "solid\n".to_owned();
    for at in 0..160_000 {
        writeln!(
            facets,
            "facet normal 0 0 1 outer loop vertex {at} 0 0 vertex {at} 1 0 vertex {at} 0 1 \
            endloop endfacet"
        )
        .expect("writes");
    }
    let mut header = [0u8; 84];
    header[80..].copy_from_slice(&u32::MAX.to_le_bytes());
    let bombs: [(&str, Vec<u8>); 6] = [
        ("facets of text", facets.into_bytes()),
        (
            "a long word",
            format!("solid x\nfacet {}", "x".repeat(30 << 20)).into_bytes(),
        ),
        (
            "a long name",
            format!("solid {}", "x".repeat(30 << 20)).into_bytes(),
        ),
        (
            "blanks",
            format!("solid x\n{}", " ".repeat(30 << 20)).into_bytes(),
        ),
        ("solids", "solid x\nendsolid\n".repeat(1 << 20).into_bytes()),
        ("a large count", header.to_vec()),
    ];
    for (name, bytes) in &bombs {
        import_within(name, "stl", bytes);
    }
}

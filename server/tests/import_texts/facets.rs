//! STL as programs write it: ends in two words or none, comments, colours, zeros, lost counts.

use super::{area, corners, read, read_in_pieces, warns};

const FACET: &str = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 1 0\n\
    endloop\nendfacet\n";

#[test]
fn texts_are_read_as_programs_write_them() {
    let colored = FACET.replace("outer", "color 1 0 0\nouter");
    for (text, count) in [
        (format!("solid a\n{FACET}end solid a\n"), 1),
        (format!("solid a\n{FACET}endsolid a   \n\t \n"), 1),
        (
            format!("solid a\n{}endsolid\n", FACET.replace("end", "end ")),
            1,
        ),
        (
            format!("# made by hand\nsolid a\n; facets\n{FACET}// more\n#\n{FACET}endsolid #\n"),
            2,
        ),
        (format!("solid a\n{FACET}endsolid a\n\0\0\0"), 1),
        (format!("solid a\n{FACET}endsolid\0\0\0\0"), 1),
        (format!("solid a\n{FACET}endsolid a\n\u{1a}"), 1),
        (
            format!(
                "solid a\n{}endsolid\n{}",
                FACET.repeat(99),
                "\0".repeat(9000)
            ),
            99,
        ),
        (
            format!("solid a\r{FACET}endsolid a\r").replace('\n', "\r"),
            1,
        ),
    ] {
        let scene = read("a.stl", &text).expect(&text[..40]);
        assert_eq!(area(&scene), f64::from(count), "{text}");
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    }
    for text in [
        format!("solid a\ncolor 1 0 0\n{FACET}endsolid\n"),
        format!("solid a\n{colored}endsolid\n"),
    ] {
        let scene = read("a.stl", &text).expect("is read");
        assert_eq!(area(&scene), 1.0);
        assert!(
            warns(&scene, &["colours of facets left out: 1"]),
            "{:?}",
            scene.warnings
        );
    }
}

/// Whole facets stay; a cut one is a broken file.
#[test]
fn solids_without_an_end_are_told() {
    for (text, count) in [
        (format!("solid a\n{FACET}"), 1.0),
        (format!("solid a\n{FACET}solid b\n{FACET}endsolid\n"), 2.0),
    ] {
        let scene = read("a.stl", &text).expect("is read");
        assert_eq!(area(&scene), count);
        assert!(
            warns(&scene, &["solids without endsolid"]),
            "{:?}",
            scene.warnings
        );
    }
    let whole = format!("solid a\n{FACET}{FACET}");
    for cut in ["endfacet", "endloop", "0 1 0", "normal"] {
        let at = whole.rfind(cut).expect("is there");
        assert!(read("a.stl", &whole[..at]).is_err(), "{cut}");
    }
}

/// The reader of texts says what is wrong with a text.
#[test]
fn broken_texts_are_told_as_texts() {
    for (text, expected) in [
        (
            format!("solid a\n{FACET}\0\0{FACET}"),
            "line 9: expected nothing behind a byte of 0",
        ),
        (
            format!("facet a\n{FACET}"),
            "line 1: expected solid, found \"facet\"",
        ),
        (
            "solid a\nfacet\0normal\nvertex".to_owned(),
            "expected nothing behind",
        ),
        (
            format!("solid a\n{}", FACET.replace("vertex 2", "vertex b")),
            "line 5: expected a number",
        ),
        (
            format!("solid a\n{FACET}end facet\n"),
            "line 9: expected solid, found \"facet\"",
        ),
    ] {
        let error = read("a.stl", &text).expect_err(&text);
        assert!(error.contains(expected), "{error}");
    }
}

/// A count of -1 stands for none; the length says how many there are.
#[test]
fn unknown_counts_are_those_of_the_length() {
    let mut bytes = b"solid made by a pipe".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(u32::MAX.to_le_bytes());
    for at in 0..100 {
        let x = at as f32;
        bytes.extend([0; 12]);
        let facet = [[x, 0.0, 0.0], [x + 2.0, 0.0, 0.0], [x, 1.0, 0.0]];
        bytes.extend(facet.iter().flatten().flat_map(|it| it.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    for scene in [read("a.stl", &bytes), read_in_pieces("a.stl", &bytes)] {
        let scene = scene.expect("is read");
        assert_eq!((corners(&scene).len(), area(&scene)), (100, 100.0));
        let words = [
            "counts of headers left out",
            "count 4294967295 before 100 facets",
        ];
        assert!(warns(&scene, &words), "{:?}", scene.warnings);
    }
    bytes.pop();
    assert!(read("a.stl", &bytes).is_err());
}

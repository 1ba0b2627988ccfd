//! Builds of any small mesh that keeps what an import promises: they end in pages that can be read, or in an error.

use lodestream_server::build::{BuildOptions, build, unpack_pages};
use lodestream_server::import::Mesh;

use super::input::Input;

pub const MOST_BYTES: [usize; 2] = [256 << 20, 65536];

/// Flags, vertices, then their values, and triangles to the end.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let (flags, count) = (input.byte(), usize::from(input.byte()) + 3);
    let mut number = || match flags & 1 {
        0 => f32::from(input.short() as i16) / 64.0,
        _ => {
            let word = u32::from(input.short()) | u32::from(input.short()) << 16;
            Some(f32::from_bits(word))
                .filter(|it| it.is_finite())
                .unwrap_or(0.0)
        }
    };
    let positions: Vec<[f32; 3]> = (0..count).map(|_| [number(), number(), number()]).collect();
    let uvs = (0..count).map(|_| [number(), number()]);
    let uvs: Option<Vec<[f32; 2]>> = (flags & 2 != 0).then(|| uvs.collect());
    let colors = (0..count).map(|_| std::array::from_fn(|_| input.byte()));
    let colors: Option<Vec<[u8; 4]>> = (flags & 4 != 0).then(|| colors.collect());
    let (mut triangles, mut triangle_materials) = (Vec::new(), Vec::new());
    while let [a, b, c, rest @ ..] = input.0 {
        input.0 = rest;
        let corners = [a, b, c].map(|&it| u32::from(it) % count as u32);
        if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
            triangles.push(corners);
            triangle_materials.push(u16::from(flags & 8 != 0 && a > b));
        }
    }
    let mesh = Mesh {
        name: "any".to_owned(),
        normals: Some(vec![[0.0, 1.0, 0.0]; count]),
        positions,
        uvs,
        colors,
        triangles,
        triangle_materials,
        material_slots: vec![0, 1],
    };
    if let Ok(built) = build(&mesh, &BuildOptions::default()) {
        let pages = unpack_pages(&built).expect("what was written can be read");
        let clusters = pages.iter().flatten();
        let triangles: usize = clusters.map(|it| it.triangles.len()).sum();
        assert_eq!(triangles as u64, built.asset.dag_triangles);
    }
}

//! Triangles by ranges are those of the whole.

use serde_json::json;

use super::File;
use crate::import::Document;
use crate::import::OpenOptions;
use crate::import::allowance::Allowance;
use crate::import::buffers::Buffers;
use crate::import::file::Extent;
use crate::import::warnings::Warnings;
use crate::import::{container, json as document_json, primitive};

#[test]
fn ranges_of_lists_strips_and_fans_make_up_the_whole() {
    let positions: Vec<[f32; 3]> = (0..40u8).map(|at| [f32::from(at), 0.0, 0.0]).collect();
    let order: Vec<u16> = (0..90).map(|at| (at * 7 + at / 5) % 40).collect();
    for mode in [4, 5, 6] {
        for indexed in [true, false] {
            let mut file = File::new();
            let position = file.floats(&positions);
            let mut primitive = json!({"attributes": {"POSITION": position}, "mode": mode});
            if indexed {
                primitive["indices"] = file.indices(&order).into();
            }
            file.primitive(primitive);

            let mut warnings = Warnings::default();
            let options = OpenOptions::default();
            let allowance = Allowance::new(std::path::Path::new("."), &options);
            let glb = Extent::memory(file.glb());
            let container = container::split(&glb, &allowance, &mut warnings).unwrap();
            let root = document_json::parse(&container.json, &allowance).unwrap();
            let bin = container.bin.as_ref();
            let buffers = Buffers::open(&root, bin, &allowance, &mut warnings).unwrap();
            let document = Document {
                root: &root,
                buffers: &buffers,
                quantized: false,
            };
            let source = &root.meshes[0].primitives[0];
            let place = "here".to_owned();
            let primitive = primitive::check(&document, source, None, place, &mut warnings);
            let primitive = primitive.unwrap().unwrap();
            let count = primitive.triangle_count;
            let mut read = |range| primitive.triangles(range, &mut warnings).unwrap();
            let whole = read(0..count);
            assert!(whole.len() > 10, "{mode}");
            for step in [1, 2, 7, 16] {
                let mut parts = Vec::new();
                for start in (0..count).step_by(step) {
                    parts.extend(read(start..(start + step as u64).min(count)));
                }
                assert_eq!(parts, whole, "mode {mode} by {step}");
            }
        }
    }
}

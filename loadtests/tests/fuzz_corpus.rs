//! The fuzzers' corpus through their targets, without a fuzzer: what was broken once, and what reaches most of the readers' branches.
// The fuzzers use all of it; what fails is told by a panic there, too.
#![allow(dead_code)]

#[path = "../fuzz/src/targets/mod.rs"]
mod targets;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

#[test]
fn the_corpus_passes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let (mut inputs, mut broken) = (0, Vec::new());
    for (target, run) in targets::TARGETS {
        let listed = std::fs::read_dir(folder.join(target));
        for entry in listed.expect("a folder for each target") {
            let file = entry.expect("reads").path();
            let input = std::fs::read(&file).expect("reads");
            inputs += 1;
            if catch_unwind(AssertUnwindSafe(|| run(&input))).is_err() {
                broken.push(file);
            }
        }
    }
    // A static keeps it, so nothing drops it.
    let _ = std::fs::remove_dir_all(targets::input::folder(""));
    assert!(inputs > 0 && broken.is_empty(), "{broken:#?} of {inputs}");
}

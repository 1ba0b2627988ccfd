//! Every pass's WGSL, as it is assembled for one, two and four pool bindings, parses and validates.

use lodestream_shaders::passes::{ALL, PoolBindings};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// What an adapter must offer, beyond WGSL's core: 64-bit integers and the atomic maximum of the visbuffer.
fn capabilities() -> Capabilities {
    Capabilities::SHADER_INT64 | Capabilities::SHADER_INT64_ATOMIC_MIN_MAX
}

fn check(source: &str) -> Result<(), String> {
    let module =
        naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    Validator::new(ValidationFlags::all(), capabilities())
        .validate(&module)
        .map(|_| ())
        .map_err(|error| error.emit_to_string(source))
}

#[test]
fn every_pass_validates() {
    let mut failures = String::new();
    let mut checked = 0;
    for pass in ALL {
        for count in [1, 2, 4] {
            let pool = PoolBindings {
                count,
                words_log2: 25,
            };
            checked += 1;
            if let Err(error) = check(&pass.source(pool)) {
                failures += &format!("{} with {count} pool bindings:\n{error}\n", pass.name);
            }
        }
    }
    assert_eq!(checked, 3 * ALL.len());
    assert!(failures.is_empty(), "\n{failures}");
}

#[test]
fn an_unknown_import_and_a_missing_capability_fail() {
    assert!(check("#import nowhere\n").is_err());
    assert!(check("var<private> x: f64;").is_err());
}

//! Every pass's WGSL, as it is assembled for one, two and four pool bindings, parses and validates.

use lodestream_shaders::VisbufferTarget;
use lodestream_shaders::passes::{ALL, PoolBindings};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// What an adapter must offer, beyond WGSL's core: 64-bit integers and the atomic maximum of the visbuffer.
fn capabilities() -> Capabilities {
    Capabilities::SHADER_INT64 | Capabilities::SHADER_INT64_ATOMIC_MIN_MAX
}

fn check(source: &str) -> Result<(), String> {
    check_with(source, capabilities())
}

fn check_with(source: &str, capabilities: Capabilities) -> Result<(), String> {
    let module =
        naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    Validator::new(ValidationFlags::all(), capabilities)
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

/// Only the target with 64-bit atomics needs more than WGSL's core.
#[test]
fn targets_without_64_bit_atomics_validate_without_capabilities() {
    let pool = PoolBindings {
        count: 1,
        words_log2: 25,
    };
    let mut varied = 0;
    for pass in ALL {
        for target in VisbufferTarget::ALL {
            let outcome = check_with(&pass.source_for(pool, target), Capabilities::empty());
            let needs_more = pass.has_target() && target == VisbufferTarget::U64;
            assert_eq!(outcome.is_err(), needs_more, "{} {target:?}", pass.name);
            varied += u32::from(needs_more);
        }
    }
    assert_eq!(
        varied, 4,
        "both hardware passes, the compute rasterizer and points"
    );
}

#[test]
fn an_unknown_import_and_a_missing_capability_fail() {
    assert!(check("#import nowhere\n").is_err());
    assert!(check("var<private> x: f64;").is_err());
}

//! Coverage-guided fuzzing of every parser that network or disk reaches. `targets` holds what is fuzzed, a file each; the workspace's
//! tests run the corpus through the same functions.

pub mod bounded;
pub mod seeds;
pub mod targets;

/// The `main` of a target, with an allocator that holds it to its bound.
#[macro_export]
macro_rules! fuzz {
    ($target:ident) => {
        #[global_allocator]
        static BOUNDED: $crate::bounded::Bounded = $crate::bounded::Bounded;

        libfuzzer_sys::fuzz_target!(|data: &[u8]| {
            use $crate::targets::$target::{MOST_BYTES, run};
            $crate::bounded::within(MOST_BYTES, data, run);
        });
    };
}

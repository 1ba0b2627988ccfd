//! Writes the seeds into the folder that `SEEDS` names. A target, so that it is built as the others are.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: {
        let folder = std::env::var_os("SEEDS").expect("SEEDS=FOLDER");
        lodestream_fuzz::seeds::write(folder.as_ref());
        if true {
            std::process::exit(0);
        }
    },
    |_data: &[u8]| {}
);

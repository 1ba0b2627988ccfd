//! `ingest --confine` and `--end-with-stdin`: the process keeps the rights that its options name,
//! and no longer than the program that started it.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::args::IngestArgs;
use super::commands::CommandError;
use crate::confine::{ConfineError, Rights, confine};

/// Gives up the rights that the options do not name, then watches standard input.
pub(super) fn give_up_rights(args: &IngestArgs) -> Result<(), CommandError> {
    if let Some(memory_bytes) = args.confine {
        confine(&rights(args, memory_bytes)?)?;
    }
    if args.end_with_stdin {
        let watch = std::thread::Builder::new().name("standard input".to_owned());
        watch.spawn(end_with_stdin).map_err(CommandError::Runtime)?;
    }
    Ok(())
}

/// Ends the process when standard input ends, or cannot be read.
fn end_with_stdin() {
    let mut stdin = std::io::stdin().lock();
    let mut bytes = [0; 64];
    while stdin.read(&mut bytes).is_ok_and(|read| read > 0) {}
    std::process::exit(1);
}

/// Creates the paths that are written. A right belongs to a path that exists; a right to create a
/// file would cover its whole folder.
fn rights(args: &IngestArgs, memory_bytes: u64) -> Result<Rights, CommandError> {
    let network = args.library.contains("://");
    let mut write = vec![args.scratch.clone().unwrap_or_else(std::env::temp_dir)];
    if !network {
        let library = PathBuf::from(&args.library);
        made(&library, std::fs::create_dir_all(&library))?;
        write.push(library);
    }
    if let Some(report) = &args.report {
        let file = File::options().append(true).create(true).open(report);
        made(report, file.map(drop))?;
        write.push(report.clone());
    }
    let folder = |input: &PathBuf| match input.parent() {
        Some(folder) if folder != Path::new("") => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    Ok(Rights {
        memory_bytes,
        read: args.inputs.iter().map(folder).collect(),
        write,
        network,
    })
}

fn made(path: &Path, made: std::io::Result<()>) -> Result<(), ConfineError> {
    made.map_err(|error| ConfineError::Path {
        path: path.to_owned(),
        cause: error.to_string(),
    })
}

//! `--private`: files and folders that other users of the machine cannot read.

use super::args::Command;
use super::commands::CommandError;
use crate::library::Library;

/// Sets the umask of the process and its children; called before any thread starts.
pub(super) fn begin(command: &Command) -> Result<(), CommandError> {
    let is_private = match command {
        Command::Ingest(args) => args.private.private,
        Command::Copy(args) => args.private.private,
        Command::Gc(args) => args.private.private,
        Command::Serve(args) => args.private.private,
        _ => false,
    };
    match is_private {
        true => mask(),
        false => Ok(()),
    }
}

#[cfg(unix)]
fn mask() -> Result<(), CommandError> {
    rustix::process::umask(rustix::fs::Mode::RWXG | rustix::fs::Mode::RWXO);
    Ok(())
}

#[cfg(not(unix))]
fn mask() -> Result<(), CommandError> {
    Err(CommandError::NotPrivate)
}

/// Shuts other users out of the library's root folder, which may be older than the option.
pub(super) fn shut(is_private: bool, library: &Library) -> Result<(), CommandError> {
    match is_private {
        true => Ok(library.shut_out_others()?),
        false => Ok(()),
    }
}

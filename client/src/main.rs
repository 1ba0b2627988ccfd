//! `lodestream-client`: draws scenes of a library.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}

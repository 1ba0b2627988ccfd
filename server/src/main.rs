//! `lodestream-server`: see [`lodestream_server::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    lodestream_server::cli::main()
}

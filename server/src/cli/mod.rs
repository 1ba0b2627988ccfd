//! The command line: `args` is its shape, the other files what each subcommand does.
//!
//! Exit 0 on success, 1 on a failed operation, 2 on wrong usage; an error is one line on standard error.

mod args;
mod commands;
mod config;
mod confined;
mod ingest;
mod output;
mod panics;
mod private;
mod serve;
mod show;
mod values;

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;

use crate::http::requests::ACCESS;
use args::{Cli, Command};

/// Runs the command that the process was started with.
pub fn main() -> ExitCode {
    let args = match config::expand(std::env::args_os().collect()) {
        Ok(args) => args,
        Err(error) => {
            output::error_line(&error);
            return ExitCode::from(2);
        }
    };
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    start_log(&cli);
    let quiet = cli.quiet;
    // Before there are threads: rights are a thread's, and of those that it starts.
    let begun = private::begin(&cli.command).and_then(|()| match &cli.command {
        Command::Ingest(args) => confined::give_up_rights(args),
        _ => Ok(()),
    });
    let done = begun.and_then(|()| match cli.command {
        Command::Serve(args) => serve::serve(args),
        command => panics::guarded(|| commands::run(command, quiet)),
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            output::error_line(&error.to_string());
            ExitCode::from(1)
        }
    }
}

/// Help goes out as it is; clap's error of several lines becomes one.
fn usage(error: &clap::Error) -> ExitCode {
    if matches!(
        error.kind(),
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion
    ) {
        // Nobody listens to the help any longer: nothing to do.
        let _ = error.print();
        return ExitCode::SUCCESS;
    }
    let text = match error.kind() {
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            "expected a subcommand with its arguments, found none".to_owned()
        }
        _ => error.render().to_string(),
    };
    let about = text.split("\n\nUsage:").next().unwrap_or_default();
    let about = about.split("\n\nFor more").next().unwrap_or_default();
    let words: Vec<&str> = about.split_whitespace().collect();
    let line = words.join(" ");
    let line = line.strip_prefix("error: ").unwrap_or(&line);
    output::error_line(&format!("{line} (see --help)"));
    ExitCode::from(2)
}

fn start_log(cli: &Cli) {
    let level = match (cli.quiet, cli.verbose) {
        (true, _) => "error",
        (_, 0) => "warn",
        (_, 1) => "info",
        (_, 2) => "debug",
        _ => "trace",
    };
    let access = match &cli.command {
        Command::Serve(args) if args.access_log => "info",
        _ => "off",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| {
        tracing_subscriber::EnvFilter::new(format!("{level},{ACCESS}={access}"))
    });
    let log = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr);
    match cli.log_json {
        true => log.json().flatten_event(true).init(),
        false => log.init(),
    }
}

//! `serve` from a file: its lines become options in front of those of the command line, which so count instead, as does the environment.

use std::ffi::{OsStr, OsString};
use std::path::Path;

use clap::CommandFactory;

use super::args::Cli;

/// Variable that names the file.
pub(super) const ENV: &str = "LODESTREAM_CONFIG";
const COMMAND: &str = "serve";

/// `args`, with what the file says that they name; one line on what is wrong with it.
pub(super) fn expand(args: Vec<OsString>) -> Result<Vec<OsString>, String> {
    let Some(at) = args.iter().skip(1).position(|arg| arg == COMMAND) else {
        return Ok(args);
    };
    let (before, after) = args.split_at(at + 2);
    let Some(file) = named(after).or_else(|| std::env::var_os(ENV)) else {
        return Ok(args);
    };
    let file = Path::new(&file);
    let wrong = |expected: &str, found: &dyn std::fmt::Display| {
        format!("{}: expected {expected}, found {found}", file.display())
    };
    let text =
        std::fs::read_to_string(file).map_err(|error| wrong("a file that can be read", &error))?;
    let table: toml::Table = text
        .parse()
        .map_err(|error: toml::de::Error| wrong("TOML", &error.to_string().replace('\n', " ")))?;
    let cli = Cli::command();
    let options = cli
        .find_subcommand(COMMAND)
        .into_iter()
        .flat_map(|serve| serve.get_arguments());
    let options: Vec<_> = options.chain(cli.get_arguments()).collect();
    let mut all = before.to_vec();
    for (key, value) in table {
        let long = key.replace('_', "-");
        let option = options
            .iter()
            .find(|option| option.get_long() == Some(&long));
        let Some(option) = option.filter(|_| long != "config") else {
            return Err(wrong("options of serve", &key));
        };
        if option
            .get_env()
            .is_some_and(|name| std::env::var_os(name).is_some())
        {
            continue;
        }
        let value = match value {
            toml::Value::String(text) => text,
            toml::Value::Integer(number) => number.to_string(),
            toml::Value::Boolean(yes) => yes.to_string(),
            other => {
                return Err(wrong(
                    "a text, a number or true or false",
                    &format!("{key}: {}", other.type_str()),
                ));
            }
        };
        all.push(format!("--{long}={value}").into());
    }
    all.extend_from_slice(after);
    Ok(all)
}

/// The value of `--config`.
fn named(args: &[OsString]) -> Option<OsString> {
    let mut found = None;
    for (index, arg) in args.iter().enumerate() {
        if arg == "--config" {
            found = args.get(index + 1).cloned();
        } else if let Some(value) = arg.to_str().and_then(|arg| arg.strip_prefix("--config=")) {
            found = Some(OsStr::new(value).to_owned());
        }
    }
    found
}

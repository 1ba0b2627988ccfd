//! How option values read.

use std::path::PathBuf;

use lodestream_format::FormatError;
use lodestream_format::frame::Codec;
use lodestream_format::library::scene_path;

use crate::build::PositionStep;
use crate::library::Replaces;

/// `--position-step`.
pub(super) type Step = PositionStep;

/// A number of bytes, with or without a unit.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let digits = text
        .trim_end_matches(|c: char| c.is_ascii_alphabetic())
        .trim_end();
    let unit: u64 = match &text[text
        .trim_end_matches(|c: char| c.is_ascii_alphabetic())
        .len()..]
    {
        "" | "B" => 1,
        "KiB" => 1 << 10,
        "MiB" => 1 << 20,
        "GiB" => 1 << 30,
        "TiB" => 1 << 40,
        "kB" => 1_000,
        "MB" => 1_000_000,
        "GB" => 1_000_000_000,
        "TB" => 1_000_000_000_000,
        _ => return Err(expected_bytes()),
    };
    if let Ok(count) = digits.parse::<u64>() {
        return count.checked_mul(unit).ok_or_else(expected_bytes);
    }
    let plain = digits
        .bytes()
        .all(|byte| byte.is_ascii_digit() || byte == b'.');
    let count: f64 = digits.parse().map_err(|_| expected_bytes())?;
    let bytes = count * unit as f64;
    if plain && bytes < u64::MAX as f64 {
        Ok(bytes as u64)
    } else {
        Err(expected_bytes())
    }
}

fn expected_bytes() -> String {
    "expected bytes such as 4GiB, 512MiB, 2GB or 1048576".to_owned()
}

/// At least one thread.
pub(super) fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count @ 1..=1024) => Ok(count),
        _ => Err("expected 1..=1024".to_owned()),
    }
}

/// Variables in which array schedulers number their jobs from 0.
const JOB_VARIABLES: [&str; 2] = ["SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX"];

/// A job's number, or `auto`.
pub(super) fn job(text: &str) -> Result<u32, String> {
    if text != "auto" {
        let expected = || "expected a number from 0, or auto".to_owned();
        return text.parse().map_err(|_| expected());
    }
    let set = JOB_VARIABLES
        .iter()
        .find_map(|name| Some((name, std::env::var_os(name)?)));
    let Some((name, value)) = set else {
        return Err(format!(
            "expected {} in the environment, found neither",
            JOB_VARIABLES.join(" or ")
        ));
    };
    let number = value.to_str().and_then(|value| value.parse().ok());
    number.ok_or_else(|| format!("expected a number from 0 in {name}, found {value:?}"))
}

/// `auto` or metres.
pub(super) fn step(text: &str) -> Result<Step, String> {
    match (text, text.parse::<f64>()) {
        ("auto", _) => Ok(PositionStep::Auto),
        (_, Ok(metres)) if metres > 0.0 && metres.is_finite() => Ok(PositionStep::Metres(metres)),
        _ => Err("expected auto or a positive number of metres".to_owned()),
    }
}

/// A codec's name.
pub(super) fn codec(text: &str) -> Result<Codec, String> {
    text.parse()
        .map_err(|_| "expected zstd, lz4 or none".to_owned())
}

/// A name that a library can hold.
pub(super) fn scene_name(text: &str) -> Result<String, String> {
    match scene_path(text) {
        Ok(_) => Ok(text.to_owned()),
        Err(error) => Err(format!("expected {}", error.expected)),
    }
}

/// An error bound.
pub(super) fn error_metres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(metres) if metres >= 0.0 && metres.is_finite() => Ok(metres),
        _ => Err("expected metres, 0 or more".to_owned()),
    }
}

/// A file whose name says a known format.
pub(super) fn export_file(text: &str) -> Result<PathBuf, String> {
    let lower = text.to_ascii_lowercase();
    match lower.ends_with(".glb") || lower.ends_with(".ply") {
        true => Ok(PathBuf::from(text)),
        false => Err("expected a name that ends in .glb or .ply".to_owned()),
    }
}

/// What a publication replaces.
pub(super) fn replaces(text: &str) -> Result<Replaces, String> {
    match text {
        "anything" => Ok(Replaces::Anything),
        "none" => Ok(Replaces::Nothing),
        hash => hash
            .parse()
            .map(Replaces::Scene)
            .map_err(|error: FormatError| error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_read_with_and_without_units() {
        for (text, expected) in [
            ("0", Some(0)),
            ("1048576", Some(1 << 20)),
            ("4GiB", Some(4 << 30)),
            ("512 MiB", Some(512 << 20)),
            ("1.5GB", Some(1_500_000_000)),
            ("7B", Some(7)),
            ("", None),
            ("GiB", None),
            ("-1", None),
            ("1e3", None),
            ("4gib", None),
            ("inf", None),
            ("18446744073709551615GiB", None),
        ] {
            assert_eq!(bytes(text).ok(), expected, "{text}");
        }
    }
}

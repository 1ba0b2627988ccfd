//! What each command does: it prints the figures, and writes them as JSON where asked to.

use std::path::Path;

use lodestream_loadtests::compare::{self, CompareError, DepthImage, Picture};
use lodestream_loadtests::report::{self, ReportError};
use lodestream_loadtests::samples::{self, SampleError};
use serde::Serialize;
use serde_json::{Value, json};

use crate::cli::{Cli, Command, Common, Compare, Sample};

/// Why a command failed: one line.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// A sample scene.
    #[error(transparent)]
    Sample(#[from] SampleError),
    /// Pictures.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The page.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A file to be written.
    #[error("{file}: expected to write it, found {source}")]
    Write {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Does what the command line says.
///
/// # Errors
/// The first failure.
pub fn run(cli: Cli) -> Result<(), CommandError> {
    let figures = match cli.command {
        Command::Sample(sample) => make_sample(sample)?,
        Command::Compare(files) => compare_pictures(&files)?,
        Command::Report { folder } => json!({ "page": report::write(&folder)? }),
    };
    finish(&figures, &cli.common)
}

fn finish(figures: &Value, common: &Common) -> Result<(), CommandError> {
    if !common.quiet {
        print(figures, "");
    }
    match &common.report {
        Some(file) => write(file, format!("{figures:#}\n").as_bytes()),
        None => Ok(()),
    }
}

/// One line a figure; a row of a table is one line.
fn print(figures: &Value, prefix: &str) {
    let Value::Object(fields) = figures else {
        println!("{prefix} {figures}");
        return;
    };
    for (key, value) in fields {
        let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            Value::Object(_) => print(value, &name),
            Value::Array(rows) => rows.iter().for_each(|row| println!("{name} {row}")),
            Value::String(text) => println!("{name} {text}"),
            value => println!("{name} {value}"),
        }
    }
}

fn write(file: &Path, bytes: &[u8]) -> Result<(), CommandError> {
    std::fs::write(file, bytes).map_err(|source| CommandError::Write {
        file: file.display().to_string(),
        source,
    })
}

fn value(figures: &impl Serialize) -> Value {
    // Reports are plain structs with string keys, so nothing in them can fail to serialize; were it otherwise the figures
    // say so instead of hiding it.
    serde_json::to_value(figures).unwrap_or_else(|error| json!({ "error": error.to_string() }))
}

fn make_sample(sample: Sample) -> Result<Value, CommandError> {
    let (glb, out) = match sample {
        Sample::City { out, instances, unique, seed } => (samples::city(instances, unique, seed), out),
        Sample::Rock { out, triangles, seed } => (samples::rock(triangles, seed), out),
    };
    glb.write(&out)?;
    Ok(json!({
        "out": out,
        "unique_triangles": glb.unique_triangles,
        "instances": glb.instances,
        "instanced_triangles": glb.instanced_triangles,
    }))
}

fn compare_pictures(files: &Compare) -> Result<Value, CommandError> {
    let picture = Picture::read(&files.picture)?;
    let reference = Picture::read(&files.reference)?;
    let depths = match files.depths.as_deref() {
        Some([depth, reference]) => Some((DepthImage::read(depth)?, DepthImage::read(reference)?)),
        _ => None,
    };
    let depths = depths.as_ref().map(|(depth, reference)| (depth, reference));
    Ok(value(&compare::compare(&picture, &reference, depths)?))
}

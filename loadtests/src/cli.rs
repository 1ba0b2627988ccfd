//! The command line: words and defaults. What the commands do is in `commands.rs`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

/// Load tests, eviction policies and sample scenes for Lodestream; needs no GPU.
#[derive(Debug, Parser)]
#[command(version, about, long_about = None, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Options of every command.
    #[command(flatten)]
    pub common: Common,
}

/// Options of every command.
#[derive(Debug, Clone, Args)]
pub struct Common {
    /// Write the figures as JSON.
    #[arg(long, global = true, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Print nothing but errors.
    #[arg(long, short, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say more on standard error; twice for everything.
    #[arg(long, short, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

/// A command.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a sample scene.
    #[command(subcommand)]
    Sample(Sample),
    /// Measure how far a picture is from its reference.
    Compare(Compare),
    /// Gather the JSON reports and pictures of a folder in one page, `index.html`.
    Report {
        /// Holds `build-*.json`, `draw-*.json`, `compare-*.json`, `play-*.json`, `policies-*.json`, `load-*.json` and `*.png`.
        folder: PathBuf,
    },
}

/// A sample scene.
#[derive(Debug, Subcommand)]
pub enum Sample {
    /// Thousands of instances of a few detailed meshes.
    City {
        /// Where to write it.
        #[arg(long, value_name = "FILE.glb")]
        out: PathBuf,
        /// Instances.
        #[arg(long, value_name = "N", default_value_t = 4000, value_parser = clap::value_parser!(u32).range(1..))]
        instances: u32,
        /// Unique meshes, at least 8.
        #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(8..))]
        unique: u32,
        /// Another number, another city.
        #[arg(long, value_name = "S", default_value_t = 1)]
        seed: u64,
    },
    /// One closed surface with detail at every scale.
    Rock {
        /// Where to write it.
        #[arg(long, value_name = "FILE.glb")]
        out: PathBuf,
        /// Triangles; the nearest 12 n² is made.
        #[arg(long, value_name = "N", default_value_t = 300_000, value_parser = clap::value_parser!(u32).range(48..))]
        triangles: u32,
        /// Another number, another rock.
        #[arg(long, value_name = "S", default_value_t = 1)]
        seed: u64,
    },
}

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub struct Compare {
    /// The picture, a PNG of 8-bit RGB or RGBA.
    pub picture: PathBuf,
    /// What it should look like.
    pub reference: PathBuf,
    /// Depth images of both (PFM), for the coverage.
    #[arg(long, num_args = 2, value_names = ["PICTURE.pfm", "REFERENCE.pfm"])]
    pub depths: Option<Vec<PathBuf>>,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        super::Cli::command().debug_assert();
    }
}

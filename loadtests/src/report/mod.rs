//! `report FOLDER`: the JSON files that the other commands wrote become one self-contained page of plots and tables.
//!
//! Files are told apart by their names: `build-*.json` (ingest), `draw-*.json` (render), `compare-*.json`, `play-*.json`,
//! `policies-*.json`, `load-*.json`, `builders-*.json` (`build`), `pages-*.json`,
//! `stability-*.json`, `sheets-*.json`, `judges-*.json`; pictures are `*.png`. A section without
//! files is left out.

mod builders;
mod judges;
mod pages;
mod passes;
mod plot;
mod sections;
mod sheets;
mod stability;

use std::fs;
use std::path::{Path, PathBuf};

pub use plot::{Plot, Series, escape, number};

/// Why a report was not written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file or folder that cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The place.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file that is not JSON.
    #[error("{path}: expected a JSON report, found {source}")]
    Json {
        /// The place.
        path: PathBuf,
        /// What the parser said.
        source: serde_json::Error,
    },
}

/// A report of one run.
#[derive(Debug, Clone)]
pub struct Run {
    /// File name without kind and ending: `draw-city-1.json` is `city-1` of kind `draw`.
    pub name: String,
    /// What the command wrote.
    pub json: serde_json::Value,
}

impl Run {
    /// The number at a path of keys, if it is there.
    pub fn number(&self, path: &[&str]) -> Option<f64> {
        path.iter()
            .try_fold(&self.json, |value, key| value.get(key))?
            .as_f64()
    }
}

/// All runs of a folder.
#[derive(Debug, Clone, Default)]
pub struct Runs {
    runs: Vec<(String, Run)>,
    pictures: Vec<String>,
}

impl Runs {
    /// Reads every report and lists every picture of `folder`, in the order of their names.
    pub fn read(folder: &Path) -> Result<Self, ReportError> {
        let io = |path: &Path| {
            let path = path.to_owned();
            move |source| ReportError::Io { path, source }
        };
        let mut names = Vec::new();
        for entry in fs::read_dir(folder).map_err(io(folder))? {
            names.push(
                entry
                    .map_err(io(folder))?
                    .file_name()
                    .to_string_lossy()
                    .into_owned(),
            );
        }
        names.sort();
        let mut runs = Self::default();
        for file in names {
            if let Some((kind, name)) = file
                .strip_suffix(".json")
                .and_then(|stem| stem.split_once('-'))
            {
                let path = folder.join(&file);
                let text = fs::read_to_string(&path).map_err(io(&path))?;
                let json = serde_json::from_str(&text)
                    .map_err(|source| ReportError::Json { path, source })?;
                runs.runs.push((
                    kind.to_owned(),
                    Run {
                        name: name.to_owned(),
                        json,
                    },
                ));
            } else if file.ends_with(".png") {
                runs.pictures.push(file);
            }
        }
        Ok(runs)
    }

    /// Runs of one kind.
    pub fn of<'a>(&'a self, kind: &'a str) -> impl Iterator<Item = &'a Run> + Clone {
        self.runs
            .iter()
            .filter(move |(of, _)| of == kind)
            .map(|(_, run)| run)
    }

    /// File names of the pictures.
    pub fn pictures(&self) -> &[String] {
        &self.pictures
    }
}

/// Writes `index.html` into `folder` and returns its path.
pub fn write(folder: &Path) -> Result<PathBuf, ReportError> {
    let runs = Runs::read(folder)?;
    let body: String = sections::ALL.iter().map(|section| section(&runs)).collect();
    let html = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Lodestream report</title><style>{STYLE}</style>\
         <main><h1>Lodestream: error against run time</h1>{body}</main></html>\n"
    );
    let path = folder.join("index.html");
    fs::write(&path, html).map_err(|source| ReportError::Io {
        path: path.clone(),
        source,
    })?;
    Ok(path)
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;color:#222;background:#fafafa;margin:0}\
main{max-width:1000px;margin:0 auto;padding:24px}h1{font-size:26px}h2{margin-top:40px;border-bottom:1px solid #ddd}\
figure{display:inline-block;width:470px;margin:8px;vertical-align:top;background:#fff;border:1px solid #e4e4e4;border-radius:6px;padding:4px}\
figure.s{width:auto;margin:4px;font-size:12px}figure.s img{width:auto;max-width:100%}\
figure img{width:100%}figcaption{text-align:center;color:#555}svg{width:100%}svg text{font-size:11px;fill:#444}svg .t{font-size:13px;font-weight:600}\
svg .x{text-anchor:middle}svg .y{text-anchor:end}svg .g{stroke:#e6e6e6}.k{margin:0 10px;white-space:nowrap;font-size:12px}\
.k i{display:inline-block;width:10px;height:10px;margin-right:5px;border-radius:2px}\
table{border-collapse:collapse;background:#fff;margin:10px 0}td,th{border:1px solid #e0e0e0;padding:3px 9px;text-align:right}\
td:first-child,th:first-child{text-align:left}th{background:#f0f0f0}p.note{color:#555}";

//! What is built: the largest meshes of a file, a whole file, or a generated input.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use lodestream_format::FormatError;
use lodestream_server::import::{ImportError, Mesh, import};

use super::inputs::Generated;

/// Why something was not measured.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// An input file.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// An input without triangles.
    #[error("{0}: expected at least one triangle, found none")]
    Empty(String),
    /// A built asset that breaks the format: a fault of the builder.
    #[error("{input}: built asset: {source}")]
    Format {
        /// The input.
        input: String,
        /// What the reader said.
        source: FormatError,
    },
    /// An input that the build refuses.
    #[error("{input}: expected a mesh that builds, found: {reason}")]
    Refused {
        /// The input.
        input: String,
        /// What the build said.
        reason: String,
    },
    /// The process that measures memory.
    #[error("memory of {input}: expected figures from a process of its own, found {found}")]
    Child {
        /// The input.
        input: String,
        /// What came instead.
        found: String,
    },
    /// No threads.
    #[error("expected to start {threads} threads, found {found}")]
    Threads {
        /// How many.
        threads: usize,
        /// What rayon said.
        found: String,
    },
}

/// Where meshes come from: a file, or the name of a generated input.
#[derive(Debug, Clone, PartialEq)]
pub enum MeshesOf {
    /// A glTF file.
    File(PathBuf),
    /// A generated input.
    Generated(Generated),
}

impl FromStr for MeshesOf {
    type Err = std::convert::Infallible;

    /// Never fails: what names no generated input is a file.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text
            .parse()
            .map_or_else(|_| Self::File(text.into()), Self::Generated))
    }
}

impl fmt::Display for MeshesOf {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::Generated(generated) => generated.fmt(f),
        }
    }
}

impl MeshesOf {
    /// The file's name without folder and ending, or the generated input's.
    pub fn short_name(&self) -> String {
        match self {
            Self::File(path) => path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            Self::Generated(generated) => generated.to_string(),
        }
    }

    /// Meshes with triangles, the largest first.
    ///
    /// # Errors
    /// A file that cannot be read, or nothing in it.
    pub fn load(&self) -> Result<Vec<Mesh>, StudyError> {
        let mut meshes = match self {
            Self::File(path) => import(path)?.meshes,
            Self::Generated(generated) => vec![generated.mesh()],
        };
        meshes.retain(|mesh| !mesh.triangles.is_empty());
        // Stable: meshes of one size keep the file's order, so that an index names the same mesh in another process.
        meshes.sort_by_key(|mesh| std::cmp::Reverse(mesh.triangles.len()));
        if meshes.is_empty() {
            return Err(StudyError::Empty(self.to_string()));
        }
        Ok(meshes)
    }
}

/// Which of the meshes that [`MeshesOf::load`] gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// One of them.
    Mesh(usize),
    /// All, one after the other.
    All,
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "all" => Ok(Self::All),
            text => text
                .parse()
                .map(Self::Mesh)
                .map_err(|_| format!("expected all or a number, found {text:?}")),
        }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Mesh(index) => index.fmt(f),
            Self::All => f.write_str("all"),
        }
    }
}

impl Part {
    /// The parts worth a row: the `largest` meshes, and the whole where it is more than one.
    pub fn rows(meshes: usize, largest: usize) -> impl Iterator<Item = Part> {
        let each = (0..meshes.min(largest.max(1))).map(Self::Mesh);
        each.chain((meshes > 1).then_some(Self::All))
    }

    /// Its meshes; none past the last one.
    pub fn of<T>(self, meshes: &[T]) -> &[T] {
        match self {
            Self::Mesh(index) => meshes.get(index).map_or(&[], std::slice::from_ref),
            Self::All => meshes,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_for_the_largest_and_one_for_all() {
        let rows = |meshes, largest| -> Vec<Part> { Part::rows(meshes, largest).collect() };
        assert_eq!(rows(1, 3), [Part::Mesh(0)]);
        assert_eq!(rows(5, 2), [Part::Mesh(0), Part::Mesh(1), Part::All]);
        assert_eq!(Part::All.of(&[1, 2]), [1, 2]);
        assert_eq!(Part::Mesh(1).of(&[1, 2]), [2]);
        assert!(Part::Mesh(2).of(&[1, 2]).is_empty());
        assert_eq!("all".parse(), Ok(Part::All));
        assert!(matches!("torus:100".parse(), Ok(MeshesOf::Generated(_))));
        assert!(matches!("torus.glb".parse(), Ok(MeshesOf::File(_))));
    }
}

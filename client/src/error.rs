//! What ends a command: one line that names the file or place, what was expected and what was found.

use crate::camera::CameraSyntaxError;
use crate::gpu::GpuError;
use crate::path::PathError;
use crate::picture::FileError;
use crate::stream::StreamError;

/// Any failure of the client's commands.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Between library and pool.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// Between pool and picture.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A camera that the user wrote.
    #[error(transparent)]
    Camera(#[from] CameraSyntaxError),
    /// A camera path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A file that could not be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The view did not settle in time.
    #[error("scene {scene}: expected a settled view after {timeout_secs} s, found {found}")]
    NotSettled {
        /// The scene.
        scene: String,
        /// Seconds waited.
        timeout_secs: f64,
        /// What was still missing.
        found: String,
    },
    /// Options that do not go together, or a machine that lacks something.
    #[error("{at}: expected {expected}, found {found}")]
    Setting {
        /// The option or the thing.
        at: String,
        /// What would do.
        expected: String,
        /// What is there.
        found: String,
    },
}

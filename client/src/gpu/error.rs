//! What can go wrong between the adapter and the picture.

/// One line that names what was expected and what this machine has.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No driver answers.
    #[error(
        "no graphics adapter found{0}: expected Vulkan, Metal or Direct3D 12; on Debian and Ubuntu \
         `apt-get install mesa-vulkan-drivers` brings a software one"
    )]
    NoAdapter(String),
    /// The adapter's limits are too small.
    #[error("adapter {adapter}: expected {expected}, found {found}")]
    Limit {
        /// Name and backend.
        adapter: String,
        /// What is needed.
        expected: String,
        /// What the adapter allows.
        found: String,
    },
    /// The driver would not give a device.
    #[error("adapter {adapter} gives no device: {reason}")]
    NoDevice {
        /// Name and backend.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// A buffer could not be made.
    #[error("buffer {name} of {bytes} bytes: {reason}")]
    Allocation {
        /// Name of the buffer.
        name: String,
        /// Its bytes.
        bytes: u64,
        /// The driver's words.
        reason: String,
    },
    /// A pass did not compile; a fault of this program or of the driver.
    #[error("pass {pass}: {reason}")]
    Pass {
        /// Name of the pass.
        pass: &'static str,
        /// The compiler's words.
        reason: String,
    },
    /// A change of instances that the scene does not allow.
    #[error("instances: expected {expected}, found {found}")]
    Instance {
        /// The places or assets that there are.
        expected: String,
        /// The places or assets asked for.
        found: String,
    },
    /// The device stopped answering.
    #[error("graphics device: {0}")]
    Device(String),
    /// The window's surface failed.
    #[error("window surface: {0}")]
    Surface(String),
}

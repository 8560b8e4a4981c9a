//! Errors of the GPU.

use argus_scene::RenderError;

/// No GPU is available, or it failed.
#[derive(Debug, Clone, thiserror::Error)]
pub enum GpuError {
    /// No adapter, or not the wanted one.
    #[error("{0}")]
    NoAdapter(String),
    /// The adapter lacks required features.
    #[error("the GPU `{adapter}` lacks {missing}; choose another with ARGUS_ADAPTER")]
    Unsupported {
        /// Name of the adapter.
        adapter: String,
        /// Missing features, by wgpu's names.
        missing: String,
    },
    /// The device was lost. All its resources must be recreated.
    #[error("the GPU device was lost: {0}")]
    Lost(String),
    /// The device is out of memory.
    #[error("the GPU is out of memory: {0}")]
    OutOfMemory(String),
    /// wgpu rejected a command, which is a bug.
    #[error("the GPU rejected a command: {0}")]
    Rejected(String),
}

impl From<GpuError> for RenderError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Lost(reason) => Self::DeviceLost(reason),
            GpuError::OutOfMemory(reason) => Self::OutOfMemory(reason),
            other => Self::Internal(other.to_string()),
        }
    }
}

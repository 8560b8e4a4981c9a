//! What can go wrong on a GPU.

use argus_scene::RenderError;

/// A GPU could not be had, or did not do its work.
#[derive(Debug, Clone, thiserror::Error)]
pub enum GpuError {
    /// There is no adapter, or not the one asked for.
    #[error("{0}")]
    NoAdapter(String),
    /// The adapter lacks what Argus needs.
    #[error("the GPU `{adapter}` lacks {missing}; choose another with ARGUS_ADAPTER")]
    Unsupported {
        /// Name of the adapter.
        adapter: String,
        /// Features, as wgpu names them.
        missing: String,
    },
    /// The device is gone: everything on it must be made anew.
    #[error("the GPU device was lost: {0}")]
    Lost(String),
    /// Memory of the device ran out.
    #[error("the GPU is out of memory: {0}")]
    OutOfMemory(String),
    /// wgpu rejected a command: a fault of ours.
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

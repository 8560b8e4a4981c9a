//! The two ways a request can fail that every layer shares.

/// A field of a request whose value cannot be honoured; travels to the client as `INVALID_ARGUMENT`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct InvalidField {
    /// Path of the field as the client wrote it, such as `camera.fov_deg`.
    pub field: &'static str,
    /// What is wrong with it and what would be right, in one line.
    pub reason: String,
}

impl InvalidField {
    /// Names the field and the reason.
    pub fn new(field: &'static str, reason: impl Into<String>) -> Self {
        Self { field, reason: reason.into() }
    }
}

/// Why a render produced no result. One view of a batch may fail while its neighbours succeed.
#[derive(Debug, Clone, thiserror::Error)]
pub enum RenderError {
    /// The request itself cannot be honoured.
    #[error(transparent)]
    Invalid(#[from] InvalidField),
    /// Nobody waits for the result any more.
    #[error("the render was cancelled")]
    Cancelled,
    /// A plan names a sample that this process does not hold.
    #[error("sample {0} is not held here")]
    MissingSample(crate::SampleId),
    /// The GPU device is gone; the process rebuilds it and the work is done again elsewhere.
    #[error("the GPU device was lost: {0}")]
    DeviceLost(String),
    /// The result or its working set does not fit in memory.
    #[error("not enough memory: {0}")]
    OutOfMemory(String),
    /// A fault of ours: a pass failed validation, an invariant broke.
    #[error("internal error: {0}")]
    Internal(String),
}

//! Errors that every layer shares.

use std::fmt;
use std::ops::RangeInclusive;

/// A field of a request with an invalid value; sent to clients as `INVALID_ARGUMENT`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct InvalidField {
    /// Path of the field as the client wrote it, such as `camera.fov_deg`.
    pub field: &'static str,
    /// What is wrong with it and what would be valid, in one line.
    pub reason: String,
}

impl InvalidField {
    /// An error for this field, with its reason.
    pub fn new(field: &'static str, reason: impl Into<String>) -> Self {
        Self { field, reason: reason.into() }
    }

    /// The value if it lies in the range. NaN never does.
    ///
    /// # Errors
    /// The field, with the range.
    pub fn within<T: PartialOrd + fmt::Display>(
        field: &'static str,
        value: T,
        range: RangeInclusive<T>,
    ) -> Result<T, Self> {
        if range.contains(&value) {
            return Ok(value);
        }
        Err(Self::new(field, format!("must be {} to {}, not {value}", range.start(), range.end())))
    }

    /// The value if it is above 0 and finite.
    ///
    /// # Errors
    /// The field.
    pub fn positive<T: Into<f64> + Copy>(field: &'static str, value: T) -> Result<T, Self> {
        let number: f64 = value.into();
        if number > 0.0 && number.is_finite() {
            return Ok(value);
        }
        Err(Self::new(field, format!("must be above 0 and finite, not {number}")))
    }
}

/// Why a render has no result. One view of a batch may fail while the rest succeed.
#[derive(Debug, Clone, thiserror::Error)]
pub enum RenderError {
    /// The request is invalid.
    #[error(transparent)]
    Invalid(#[from] InvalidField),
    /// The result is no longer needed.
    #[error("the render was cancelled")]
    Cancelled,
    /// A plan names a sample that this process does not hold.
    #[error("sample {0} is not held here")]
    MissingSample(crate::SampleId),
    /// The GPU device was lost. The process opens it again, and the work is repeated on another worker.
    #[error("the GPU device was lost: {0}")]
    DeviceLost(String),
    /// The result or its working set does not fit in memory.
    #[error("not enough memory: {0}")]
    OutOfMemory(String),
    /// An internal error: a pass failed validation or an invariant was violated.
    #[error("internal error: {0}")]
    Internal(String),
}

//! Why a hierarchy could not be built.

use crate::GpuError;

/// A hierarchy could not be built.
#[derive(Debug, Clone, thiserror::Error)]
pub enum HierarchyError {
    /// There is no triangle with an area.
    #[error("there is nothing to build a hierarchy over: no triangle has an area")]
    Empty,
    /// Something that was asked for is out of its range.
    #[error("{field} must be {range}, not {value}")]
    OutOfRange {
        /// What.
        field: &'static str,
        /// What it may be.
        range: String,
        /// What it was.
        value: String,
    },
    /// One array would be larger than a program may bind on this device.
    #[error(
        "{what} need {needed} bytes in one array, and this device binds at most {limit}; use fewer levels"
    )]
    TooLarge {
        /// What is in the array.
        what: &'static str,
        /// Its size, bytes.
        needed: u64,
        /// The device's limit, bytes.
        limit: u64,
    },
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

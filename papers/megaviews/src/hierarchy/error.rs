//! Errors of hierarchies.

use argus_gpu::{Gpu, GpuError};

/// Most nodes of a hierarchy: child links have 24 bits.
pub const MAX_NODES: u64 = 1 << 24;

/// Why a hierarchy could not be built.
#[derive(Debug, Clone, thiserror::Error)]
pub enum HierarchyError {
    /// No triangle has an area.
    #[error("there is nothing to build a hierarchy over: no triangle has an area")]
    Empty,
    /// A parameter is out of range.
    #[error("{field} must be {range}, not {value}")]
    OutOfRange {
        /// Its name.
        field: &'static str,
        /// Its valid range.
        range: String,
        /// Its value.
        value: String,
    },
    /// More nodes than 24-bit child links can address.
    #[error("{nodes} nodes are more than a hierarchy can number, which is {MAX_NODES}; use fewer levels")]
    TooManyNodes {
        /// Number of nodes.
        nodes: u64,
    },
    /// An array exceeds what a program may bind on this device.
    #[error(
        "{what} need {needed} bytes in one array, and this device binds at most {limit}; use fewer levels or views"
    )]
    TooLarge {
        /// Content of the array.
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

/// Checks that an array does not exceed what a program may bind.
///
/// # Errors
/// [`HierarchyError::TooLarge`].
pub fn fits(gpu: &Gpu, what: &'static str, needed: u64) -> Result<(), HierarchyError> {
    let limit = gpu.largest_array();
    if needed > limit { Err(HierarchyError::TooLarge { what, needed, limit }) } else { Ok(()) }
}

/// Fails if child links cannot address that many nodes.
pub(crate) fn numbered(nodes: u64) -> Result<(), HierarchyError> {
    if nodes > MAX_NODES { Err(HierarchyError::TooManyNodes { nodes }) } else { Ok(()) }
}

//! Why a hierarchy could not be built.

use crate::GpuError;

/// Most nodes of a hierarchy: what links to children have bits for.
pub const MAX_NODES: u64 = 1 << 24;

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
    /// Links from a node to its children have 24 bits.
    #[error("{nodes} nodes are more than a hierarchy can number, which is {MAX_NODES}; use fewer levels")]
    TooManyNodes {
        /// How many there would be.
        nodes: u64,
    },
    /// One array would be larger than a program may bind on this device.
    #[error(
        "{what} need {needed} bytes in one array, and this device binds at most {limit}; use fewer levels or views"
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

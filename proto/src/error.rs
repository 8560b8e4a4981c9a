//! Errors of chunked messages.

use argus_scene::{InvalidField, SampleId};

/// A damaged or malformed frame, sample or scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// A header's field is invalid, or claims more than the receiver allows.
    #[error(transparent)]
    Invalid(#[from] InvalidField),
    /// The stream ended too early.
    #[error("the {what} is cut short: {got} of {expected} bytes arrived")]
    Truncated {
        /// `frame`, `sample` or `scene`.
        what: &'static str,
        /// Bytes that arrived.
        got: u64,
        /// Bytes that the header promised.
        expected: u64,
    },
    /// A message out of order: a second header, a repeated or skipped chunk.
    #[error("the {what} is out of order: {reason}")]
    OutOfOrder {
        /// `frame`, `sample` or `scene`.
        what: &'static str,
        /// What arrived, and what was expected.
        reason: String,
    },
    /// Packed bytes do not unpack to the header's size or hash.
    #[error("{what} is damaged: {reason}")]
    Corrupt {
        /// The plane or image.
        what: &'static str,
        /// The decoder's reason.
        reason: String,
    },
    /// A sample's texels are on a device, and must be read back before they can be sent.
    #[error("sample {0} is not in host memory")]
    OnDevice(SampleId),
}

impl WireError {
    pub(crate) fn corrupt(what: &'static str, reason: impl Into<String>) -> Self {
        Self::Corrupt { what, reason: reason.into() }
    }

    pub(crate) fn out_of_order(what: &'static str, reason: impl Into<String>) -> Self {
        Self::OutOfOrder { what, reason: reason.into() }
    }

    /// The error of a header's invalid field.
    pub(crate) fn field(field: &'static str, reason: impl Into<String>) -> Self {
        Self::Invalid(InvalidField::new(field, reason))
    }
}

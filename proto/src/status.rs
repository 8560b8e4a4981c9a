//! The table from errors to gRPC codes, and how clients read the details.

use std::time::Duration;

use argus_scene::{InvalidField, RenderError};
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, StatusExt};

use crate::{PROTOCOL_VERSION, WireError};

/// The errors of all services of `argus.v1`.
#[derive(Debug, Clone, thiserror::Error)]
pub enum Fault {
    /// A field of the request is invalid.
    #[error(transparent)]
    Invalid(#[from] InvalidField),
    /// Rendering failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A chunked message was malformed.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// Overload, which is refused at once instead of queued.
    #[error("overloaded: {what}; try again in {} ms", retry_after.as_millis())]
    Overloaded {
        /// The exceeded limit.
        what: String,
        /// When to retry.
        retry_after: Duration,
    },
    /// The other side uses another version of the protocol.
    #[error(
        "protocol version {theirs} does not match this service's version {PROTOCOL_VERSION}: \
         use the same release of argus on both sides"
    )]
    Version {
        /// The other side's [`PROTOCOL_VERSION`].
        theirs: u32,
    },
    /// An order from a coordinator that no longer leads.
    #[error("term {theirs} is over, the coordinator of term {ours} leads")]
    StaleTerm {
        /// The highest term seen.
        ours: u64,
        /// The term of the order.
        theirs: u64,
    },
    /// A pinned provenance that this service cannot repeat.
    #[error("the pinned provenance cannot be met: {0}")]
    Pin(String),
    /// A condition of the request on the present state does not hold.
    #[error("{0}")]
    Conflict(String),
    /// An unknown scene, sample or worker.
    #[error("{0}")]
    NotFound(String),
    /// Temporarily unavailable; the same request may succeed later or elsewhere.
    #[error("{0}")]
    Unavailable(String),
    /// The request's own deadline has passed.
    #[error("the deadline of {} ms has passed", .0.as_millis())]
    Deadline(Duration),
}

impl Fault {
    /// The gRPC code of each fault. Faults that a retry may cure are `UNAVAILABLE`: clients retry exactly that code.
    pub fn code(&self) -> Code {
        match self {
            Self::Invalid(_) | Self::Render(RenderError::Invalid(_)) => Code::InvalidArgument,
            Self::Render(RenderError::Cancelled) => Code::Cancelled,
            Self::Render(RenderError::MissingSample(_) | RenderError::DeviceLost(_)) => Code::Unavailable,
            Self::Render(RenderError::OutOfMemory(_)) | Self::Overloaded { .. } => Code::ResourceExhausted,
            Self::Render(RenderError::Internal(_)) => Code::Internal,
            Self::Wire(WireError::OnDevice(_)) => Code::Internal,
            Self::Wire(_) => Code::DataLoss,
            Self::Version { .. } | Self::StaleTerm { .. } | Self::Pin(_) | Self::Conflict(_) => {
                Code::FailedPrecondition
            }
            Self::NotFound(_) => Code::NotFound,
            Self::Unavailable(_) => Code::Unavailable,
            Self::Deadline(_) => Code::DeadlineExceeded,
        }
    }
}

impl From<Fault> for Status {
    fn from(fault: Fault) -> Self {
        let (code, message) = (fault.code(), fault.to_string());
        let details = match fault {
            Fault::Invalid(at) | Fault::Render(RenderError::Invalid(at)) => {
                ErrorDetails::with_bad_request_violation(at.field, at.reason)
            }
            Fault::Overloaded { retry_after, .. } => ErrorDetails::with_retry_info(Some(retry_after)),
            Fault::Render(RenderError::OutOfMemory(_)) => {
                // Other work must leave memory first; a second is longer than most batches.
                ErrorDetails::with_retry_info(Some(Duration::from_secs(1)))
            }
            _ => return Self::new(code, message),
        };
        Self::with_error_details(code, message, details)
    }
}

/// The status of an invalid field.
pub fn invalid(field: InvalidField) -> Status {
    Fault::Invalid(field).into()
}

/// Compares the other side's protocol version with our own.
///
/// # Errors
/// [`Fault::Version`] unless they are equal.
pub fn check_version(theirs: u32) -> Result<(), Fault> {
    if theirs == PROTOCOL_VERSION { Ok(()) } else { Err(Fault::Version { theirs }) }
}

/// The field and the reason of an `INVALID_ARGUMENT`, if the server gave them.
pub fn invalid_field(status: &Status) -> Option<(String, String)> {
    let violation = status.get_details_bad_request()?.field_violations.into_iter().next()?;
    Some((violation.field, violation.description))
}

/// When to retry, if the server gave a hint.
pub fn retry_after(status: &Status) -> Option<Duration> {
    status.get_details_retry_info()?.retry_delay
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_field_travels_with_its_name_and_reason() {
        let status = invalid(InvalidField::new("camera.fov_deg", "must be less than 180"));
        assert_eq!(status.code(), Code::InvalidArgument);
        let (field, reason) = invalid_field(&status).unwrap();
        assert_eq!((field.as_str(), reason.as_str()), ("camera.fov_deg", "must be less than 180"));
        let through_render = RenderError::from(InvalidField::new("width", "must not be 0"));
        assert_eq!(invalid_field(&Fault::from(through_render).into()).unwrap().0, "width");
    }

    #[test]
    fn overload_has_a_retry_hint() {
        let retry = Duration::from_millis(250);
        let status: Status =
            Fault::Overloaded { what: "64 views wait".to_owned(), retry_after: retry }.into();
        assert_eq!(status.code(), Code::ResourceExhausted);
        assert_eq!(retry_after(&status), Some(retry));
        assert!(status.message().contains("250 ms"));
        assert!(invalid_field(&status).is_none());
    }

    #[test]
    fn exactly_the_retryable_faults_are_unavailable() {
        let id = argus_scene::SampleId { version: 0, camera: 2 };
        for fault in [
            Fault::from(RenderError::MissingSample(id)),
            Fault::from(RenderError::DeviceLost("reset".to_owned())),
            Fault::Unavailable("no compositor yet".to_owned()),
        ] {
            assert_eq!(fault.code(), Code::Unavailable);
        }
        for fault in [
            Fault::from(RenderError::Internal("pass".to_owned())),
            Fault::from(RenderError::OutOfMemory("frame".to_owned())),
            Fault::StaleTerm { ours: 2, theirs: 1 },
            Fault::Version { theirs: 9 },
            Fault::Deadline(Duration::from_secs(1)),
            Fault::Pin("version 3 is gone".to_owned()),
        ] {
            assert_ne!(fault.code(), Code::Unavailable);
        }
        assert!(check_version(PROTOCOL_VERSION).is_ok());
        assert_eq!(check_version(99).unwrap_err().code(), Code::FailedPrecondition);
    }
}

//! Errors of a client, worded so that users know what to do next.

use std::time::Duration;

use argus_proto::{PROTOCOL_VERSION, WireError, status};
use tonic::{Code, Status};

/// Why a request has no answer.
#[derive(Debug, Clone, thiserror::Error)]
pub enum ClientError {
    /// The address is not valid.
    #[error("{url:?} is not the address of a server ({reason}): write it like http://127.0.0.1:7400")]
    Address {
        /// The address as given.
        url: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No connection.
    #[error("no server answers at {url} ({reason}): start one with `argus serve` or check the address")]
    Unreachable {
        /// The address as given.
        url: String,
        /// The operating system's reason.
        reason: String,
    },
    /// The TLS handshake failed: a certificate is missing, or the other side does not trust it.
    #[error(
        "the server at {url} and this client do not trust each other ({reason}): give the authority that signed the \
         server's certificate with --ca, check that the address is one of the certificate's, and, if the server wants \
         one of yours, give that (client.certificate and client.key of the configuration)"
    )]
    Untrusted {
        /// The address as given.
        url: String,
        /// The reason given by the handshake.
        reason: String,
    },
    /// The server does not allow the request.
    #[error("not allowed: {reason}")]
    Refused {
        /// The reason or the missing role.
        reason: String,
    },
    /// The server at this address is not Argus.
    #[error(
        "what listens at {url} is not an Argus server ({reason}): check the address, and whether it is https://"
    )]
    NotArgus {
        /// The address as given.
        url: String,
        /// The answer or error.
        reason: String,
    },
    /// The server has another protocol version.
    #[error(
        "{url} speaks protocol version {theirs}, this client version {PROTOCOL_VERSION}: \
         use the same release of argus on both sides"
    )]
    Version {
        /// The address as given.
        url: String,
        /// The server's protocol version.
        theirs: u32,
    },
    /// The server cannot use a field of the request.
    #[error("{field}: {reason}")]
    Invalid {
        /// Path of the field.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The server rejected the request because of overload.
    #[error("{message}; ask less often or add workers")]
    Overloaded {
        /// The server's message.
        message: String,
        /// When the server expects to have capacity again.
        retry_after: Option<Duration>,
    },
    /// The deadline passed.
    #[error("no answer within {} ms ({last}): allow more time or see `argus status`", after.as_millis())]
    Deadline {
        /// The time allowed.
        after: Duration,
        /// The last failure before the deadline, or a note that there was none.
        last: String,
    },
    /// The answer does not match the request, or was damaged on the way.
    #[error("the answer is damaged: {0}; if it happens again, the server is at fault")]
    Damaged(#[from] WireError),
    /// Any other failure that the server reports.
    #[error("the server failed ({code}): {message}")]
    Server {
        /// The gRPC code.
        code: Code,
        /// The server's message.
        message: String,
        /// Whether the connection broke, so that the server did not answer.
        broken: bool,
    },
}

impl ClientError {
    /// Whether the same request may succeed if sent again.
    pub fn is_transient(&self) -> bool {
        match self {
            Self::Server { code, broken, .. } => *broken || *code == Code::Unavailable,
            Self::Damaged(error) => !matches!(error, WireError::Invalid(_)),
            Self::Unreachable { .. } => true,
            _ => false,
        }
    }
}

impl From<Status> for ClientError {
    fn from(status: Status) -> Self {
        // tonic keeps the transport's error as the source; a server's own status has none.
        let broken = std::error::Error::source(&status).is_some();
        match (status.code(), status::invalid_field(&status)) {
            (Code::InvalidArgument, Some((field, reason))) => Self::Invalid { field, reason },
            (Code::ResourceExhausted, _) => Self::Overloaded {
                retry_after: status::retry_after(&status),
                message: status.message().to_owned(),
            },
            (Code::Unauthenticated | Code::PermissionDenied, _) => {
                Self::Refused { reason: status.message().to_owned() }
            }
            (code, _) => Self::Server { code, message: root_cause(&status), broken },
        }
    }
}

/// The message of the innermost error: transports wrap "connection refused" in several layers of "transport error".
pub(crate) fn root_cause(error: &(dyn std::error::Error + 'static)) -> String {
    let mut at = error;
    while let Some(source) = at.source() {
        at = source;
    }
    // A status would also print its code and details.
    at.downcast_ref::<Status>().map_or_else(|| at.to_string(), |status| status.message().to_owned())
}

#[cfg(test)]
mod tests {
    use argus_proto::Fault;
    use argus_scene::InvalidField;

    use super::*;

    #[test]
    fn statuses_become_errors_that_keep_their_details() {
        let invalid: Status = Fault::from(InvalidField::new("camera.up", "must not be 0")).into();
        assert_eq!(ClientError::from(invalid).to_string(), "camera.up: must not be 0");
        let retry_after = Duration::from_millis(40);
        let full: Status = Fault::Overloaded { what: "64 views wait".to_owned(), retry_after }.into();
        match ClientError::from(full) {
            ClientError::Overloaded { retry_after: Some(after), .. } => assert_eq!(after, retry_after),
            other => panic!("{other:?}"),
        }
        let gone = ClientError::from(Status::unavailable("no compositor holds these samples"));
        assert!(gone.is_transient());
        assert!(gone.to_string().contains("no compositor holds these samples"));
        assert!(!ClientError::from(Status::internal("a pass failed")).is_transient());
        assert!(!ClientError::from(Status::failed_precondition("pin")).is_transient());
    }
}

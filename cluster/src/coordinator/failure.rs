//! Failures of single views within a session or a batch, which continue.

use argus_proto::status::{invalid_field, retry_after};
use argus_proto::v1;
use tonic::Status;

/// Converts a status to a failure message.
pub(super) fn failure(status: &Status) -> v1::SessionFailure {
    v1::SessionFailure {
        code: status.code() as i32,
        message: status.message().to_owned(),
        field: invalid_field(status).map(|(field, _)| field).unwrap_or_default(),
        retry_after_ms: retry_after(status)
            .map_or(0, |after| u32::try_from(after.as_millis()).unwrap_or(u32::MAX).max(1)),
    }
}

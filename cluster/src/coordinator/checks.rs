//! Validates requests of clients.

use argus_proto::v1;
use argus_scene::{InvalidField, View};

use super::shared_core::SharedCore;

/// Longest `view_id` or `batch_id`, bytes.
const MAX_VIEW_ID: usize = 128;

/// Converts and validates a view.
///
/// # Errors
/// The view is absent, malformed, or exceeds the limits.
pub(super) fn checked(shared: &SharedCore, wire: Option<&v1::View>) -> Result<View, InvalidField> {
    let wire = wire.cloned().ok_or_else(|| InvalidField::new("view", "must be given"))?;
    let view = View::try_from(wire)?;
    view.validate(&shared.service.limits)?;
    Ok(view)
}

/// Validates an image encoding.
///
/// # Errors
/// No encoding has this number.
pub(super) fn checked_encoding(encoding: i32) -> Result<i32, InvalidField> {
    match v1::Encoding::try_from(encoding) {
        Ok(_) => Ok(encoding),
        Err(_) => Err(InvalidField::new("encoding", format!("{encoding} is not a known value"))),
    }
}

/// Validates a client's name of a view or a batch. `field` is the field's name.
///
/// # Errors
/// The name is too long.
pub(super) fn checked_view_id(field: &'static str, id: &str) -> Result<(), InvalidField> {
    match id.len() {
        0..=MAX_VIEW_ID => Ok(()),
        len => Err(InvalidField::new(field, format!("must be at most {MAX_VIEW_ID} bytes, not {len}"))),
    }
}

/// Validates a request for one view.
///
/// # Errors
/// The invalid field.
pub(super) fn checked_request(
    shared: &SharedCore,
    request: &v1::RenderRequest,
) -> Result<View, InvalidField> {
    let view = checked(shared, request.view.as_ref())?;
    checked_encoding(request.encoding)?;
    checked_view_id("view_id", &request.view_id)?;
    if request.order.is_some() {
        return Err(InvalidField::new("order", "must be absent: only a coordinator gives orders"));
    }
    Ok(view)
}

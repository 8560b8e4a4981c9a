//! Checks of what clients ask for.

use argus_proto::v1;
use argus_scene::{InvalidField, View};

use super::shared_core::SharedCore;

/// The longest `view_id` that is carried around.
const MAX_VIEW_ID: usize = 128;

/// A view as it came.
///
/// # Errors
/// It is absent, no view, or larger than is served here.
pub(super) fn checked(shared: &SharedCore, wire: Option<&v1::View>) -> Result<View, InvalidField> {
    let wire = wire.cloned().ok_or_else(|| InvalidField::new("view", "must be given"))?;
    let view = View::try_from(wire)?;
    view.validate(&shared.service.limits)?;
    Ok(view)
}

/// How the images of a frame shall be packed.
///
/// # Errors
/// No encoding has that number.
pub(super) fn checked_encoding(encoding: i32) -> Result<i32, InvalidField> {
    match v1::Encoding::try_from(encoding) {
        Ok(_) => Ok(encoding),
        Err(_) => Err(InvalidField::new("encoding", format!("{encoding} is not a known value"))),
    }
}

/// A name that a client gave a view, or a batch, in the field of that name.
///
/// # Errors
/// It is too long.
pub(super) fn checked_view_id(field: &'static str, id: &str) -> Result<(), InvalidField> {
    match id.len() {
        0..=MAX_VIEW_ID => Ok(()),
        len => Err(InvalidField::new(field, format!("must be at most {MAX_VIEW_ID} bytes, not {len}"))),
    }
}

/// A request for one view.
///
/// # Errors
/// One of its fields is wrong.
pub(super) fn checked_request(shared: &SharedCore, request: &v1::RenderRequest) -> Result<View, InvalidField> {
    let view = checked(shared, request.view.as_ref())?;
    checked_encoding(request.encoding)?;
    checked_view_id("view_id", &request.view_id)?;
    if request.order.is_some() {
        return Err(InvalidField::new("order", "must be absent: only a coordinator gives orders"));
    }
    Ok(view)
}

//! Conversions of single values between wire and vocabulary.
//!
//! To the wire: `From`, since inside values are valid. From the wire: `TryFrom` with an [`InvalidField`] for missing
//! fields, unknown enum values, non-finite numbers, and plans or rigs that no service could honour.
//! [`argus_scene::View::validate`] checks the size of a view, since limits are the service's own.

mod camera;
mod describe;
mod effects;
mod enums;
mod scene;
mod transforms;
mod view;

pub use describe::Description;
pub use enums::{WireEnum, light_level};
pub use transforms::{affine, rows_of, shared_transforms, space_is_world};
pub use view::face_masks;

use argus_scene::{InvalidField, SceneHash, SpecificationHash};
use bytes::Bytes;
use glam::{DVec3, Vec3};

use crate::v1;

/// The value of a required field.
pub(crate) fn required<T>(value: Option<T>, field: &'static str) -> Result<T, InvalidField> {
    value.ok_or_else(|| InvalidField::new(field, "must be given"))
}

/// The value of an enum's number, which may be "unspecified".
pub(crate) fn known<E: TryFrom<i32>>(number: i32, field: &'static str) -> Result<E, InvalidField> {
    E::try_from(number).map_err(|_| InvalidField::new(field, format!("{number} is not a known value")))
}

/// The error of an unspecified enum that must be specified.
pub(crate) fn unspecified(field: &'static str) -> InvalidField {
    InvalidField::new(field, "must not be unspecified")
}

/// A finite number.
pub(crate) fn finite(value: f64, field: &'static str) -> Result<f64, InvalidField> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(InvalidField::new(field, format!("must be finite, not {value}")))
    }
}

/// A duration, milliseconds, or a mean count: finite and not negative.
pub(crate) fn duration_ms(value: f64, field: &'static str) -> Result<f64, InvalidField> {
    if finite(value, field)? >= 0.0 {
        Ok(value)
    } else {
        Err(InvalidField::new(field, format!("must not be negative, not {value}")))
    }
}

pub(crate) fn point(value: Option<v1::Vec3>, field: &'static str) -> Result<DVec3, InvalidField> {
    let v1::Vec3 { x, y, z } = required(value, field)?;
    let v = DVec3::new(x, y, z);
    if v.is_finite() { Ok(v) } else { Err(InvalidField::new(field, format!("must be finite, not {v}"))) }
}

pub(crate) fn rgb(value: Option<v1::Rgb>, field: &'static str) -> Result<Vec3, InvalidField> {
    let v1::Rgb { r, g, b } = required(value, field)?;
    let v = Vec3::new(r, g, b);
    if v.is_finite() && v.min_element() >= 0.0 {
        Ok(v)
    } else {
        Err(InvalidField::new(field, format!("must be finite and not negative, not {v}")))
    }
}

/// A BLAKE3 hash.
pub(crate) fn hash(value: &Bytes, field: &'static str) -> Result<[u8; 32], InvalidField> {
    let wrong = |_| InvalidField::new(field, format!("must be 32 bytes, not {}", value.len()));
    value.as_ref().try_into().map_err(wrong)
}

/// A scene's hash from the wire.
///
/// # Errors
/// [`InvalidField`] of `field` unless it has 32 bytes.
pub fn scene_hash(value: &Bytes, field: &'static str) -> Result<SceneHash, InvalidField> {
    hash(value, field).map(SceneHash)
}

/// A scene's hash for the wire.
pub fn scene_hash_bytes(hash: SceneHash) -> Bytes {
    Bytes::copy_from_slice(&hash.0)
}

/// A specification's hash from the wire.
///
/// # Errors
/// [`InvalidField`] of `field` unless it has 32 bytes.
pub fn specification_hash(value: &Bytes, field: &'static str) -> Result<SpecificationHash, InvalidField> {
    hash(value, field).map(SpecificationHash)
}

/// A specification's hash for the wire.
pub fn specification_hash_bytes(hash: SpecificationHash) -> Bytes {
    Bytes::copy_from_slice(&hash.0)
}

impl From<DVec3> for v1::Vec3 {
    fn from(v: DVec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<Vec3> for v1::Rgb {
    fn from(v: Vec3) -> Self {
        Self { r: v.x, g: v.y, b: v.z }
    }
}

#[cfg(test)]
mod tests;

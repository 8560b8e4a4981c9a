//! Messages between a page and its bridge.
//!
//! A page sends text messages of one JSON object: a camera, the number of a camera whose image it has shown, or where its
//! viewer is seen by others (`null`: no longer).
//!
//! ```text
//! {"camera": 7, "eye": [0, 1, 5], "target": [0, 1, 0], "up": [0, 1, 0], "fov_deg": 60, "size": [640, 480],
//! "direct": true, "deadline_ms": 80, "quality": 90, "reach": 0.5}
//! {"shown": 7}
//! {"seen": {"eye": [0, 1, 5], "target": [0, 1, 0], "fov_deg": 60}}
//! ```
//!
//! Only `camera`, an ascending number, is required; the other fields have the defaults of `/frame`. With `reach`, the image
//! comes with its relief ([`argus_proto::relief`]), for redraws by a viewer who moves up to that many metres: then planes
//! are off by at most half a pixel, unless the relief says more. The bridge sends images as binary messages: the length of
//! a JSON object (4 bytes, little-endian), the object (see [`about`]), a JPEG of `jpeg_bytes`, and the relief, if any.
//! Errors are text messages with one field: `refused` (the message is invalid), `failed` (a camera has no image) or
//! `trouble` (the service does not answer). Whoever is seen is told where the others are, in a text message `viewers`.

use argus_client::FrameMeta;
use argus_proto::relief::Relief;
use argus_scene::effects::EffectKind;
use argus_scene::{Camera, Frame, Holes, InvalidField, Output, Outputs, Plan, PlanRequest, View};
use glam::DVec3;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

/// Default size of a view in pixels.
pub(super) const USUAL_SIZE: [u32; 2] = [640, 480];

/// A message of a page.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Message {
    /// Requests the view of a camera, which replaces earlier ones.
    Camera {
        /// The page's number of the camera.
        number: u64,
        /// The view. Not yet checked against the service's limits.
        view: Box<View>,
        /// How its image is encoded.
        form: Form,
    },
    /// The page has shown the image of this camera and needs no earlier one.
    Shown(u64),
    /// Where other viewers see this one. Not yet validated. `None`: they do not.
    Seen(Option<Camera>),
}

/// How an image is encoded for a page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Form {
    /// JPEG quality, 1 to 100.
    pub(super) quality: u8,
    /// Metres that the relief is good for; `None`: the image has none.
    pub(super) reach: Option<f64>,
}

/// The usual quality. Below 90 the edges of textures blur visibly; above it the size doubles.
const QUALITY: u8 = 90;

impl Default for Form {
    fn default() -> Self {
        Self { quality: QUALITY, reach: None }
    }
}

/// Parses a message. Missing fields of a camera are taken from `usual`.
///
/// # Errors
/// The invalid or unknown field, and what is wrong with it.
pub(super) fn read(text: &str, usual: Camera, plan: &PlanRequest) -> Result<Message, InvalidField> {
    let fields: Map<String, Value> = serde_json::from_str(text)
        .map_err(|error| InvalidField::new("message", format!("must be a JSON object: {error}")))?;
    if let Some(shown) = fields.get("shown") {
        return match fields.len() {
            1 => Ok(Message::Shown(field("shown", shown)?)),
            _ => Err(InvalidField::new("shown", "must be the only field of its message")),
        };
    }
    if let Some(seen) = fields.get("seen") {
        return match (fields.len(), seen) {
            (1, Value::Null) => Ok(Message::Seen(None)),
            (1, _) => field::<Seen>("seen", seen).map(|seen| Message::Seen(Some(seen.camera()))),
            _ => Err(InvalidField::new("seen", "must be the only field of its message")),
        };
    }
    let (mut camera, mut size, mut plan) = (usual, USUAL_SIZE, *plan);
    let (mut number, mut form) = (None, Form::default());
    for (name, value) in &fields {
        match name.as_str() {
            "camera" => number = Some(field("camera", value)?),
            "eye" => camera.eye = DVec3::from_array(field("eye", value)?),
            "target" => camera.target = DVec3::from_array(field("target", value)?),
            "up" => camera.up = DVec3::from_array(field("up", value)?),
            "fov_deg" => camera.fov_deg = field("fov_deg", value)?,
            "size" => size = field("size", value)?,
            "direct" if field("direct", value)? => {
                plan = PlanRequest { direct: true, ..PlanRequest::default() };
            }
            "direct" => {}
            "deadline_ms" => plan.deadline_ms = Some(field("deadline_ms", value)?),
            "quality" => form.quality = InvalidField::within("quality", field("quality", value)?, 1..=100)?,
            "reach" => {
                let reach: f64 = field("reach", value)?;
                if !(reach > 0.0 && reach.is_finite()) {
                    return Err(InvalidField::new("reach", format!("must be a number above 0, not {reach}")));
                }
                form.reach = Some(reach);
            }
            _ => {
                let known = "camera, eye, target, up, fov_deg, size, direct, deadline_ms, quality, reach, shown and \
                     seen are";
                let name: String = name.chars().take(40).collect();
                return Err(InvalidField::new(
                    "message",
                    format!("the field {name:?} is not known: {known}"),
                ));
            }
        }
    }
    let number = number.ok_or_else(|| InvalidField::new("camera", "the camera's number must be given"))?;
    let [width, height] = size;
    let outputs = match form.reach {
        Some(_) => Outputs::COLOR.with(Output::Range),
        None => Outputs::COLOR,
    };
    let view = Box::new(View { camera, width, height, outputs, plan, pin: None, flow_to: None, rays: None });
    Ok(Message::Camera { number, view, form })
}

/// A viewer's camera, as others see it.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Seen {
    eye: DVec3,
    target: DVec3,
    fov_deg: f64,
}

impl Seen {
    fn camera(&self) -> Camera {
        Camera { fov_deg: self.fov_deg, ..Camera::look_at(self.eye, self.target) }
    }
}

fn field<T: DeserializeOwned>(name: &'static str, value: &Value) -> Result<T, InvalidField> {
    T::deserialize(value).map_err(|error| InvalidField::new(name, error.to_string()))
}

/// The description of an image: how it was rendered and what it cost.
///
/// - `way`: `direct` (rendered from triangles), `samples` or `frames`, each with ` and rays` if rays filled pixels that no
///   sample saw.
/// - `because`: why the service chose that, or null if it was requested.
/// - `samples`: their number, 0 for a direct view.
/// - `stages`: the timed steps with their `ms`; `rendering_ms` is the sum of those that are rendering.
/// - `effects`: milliseconds of each effect of light that was computed for it, by name.
/// - `age_ms`: the time since the request reached the service.
/// - `predicted`: the expected `error` and `ms`, or null.
pub(super) fn about(frame: &Frame, meta: &FrameMeta) -> Map<String, Value> {
    let (search, way, samples) = match &frame.provenance.plan {
        Plan::Direct { .. } => ("direct", "direct", 0),
        Plan::Warp(warp) => {
            let way = match (warp.frames.is_empty(), warp.holes) {
                (true, Holes::Mark) => "samples",
                (true, Holes::Trace) => "samples and rays",
                (false, Holes::Mark) => "frames",
                (false, Holes::Trace) => "frames and rays",
            };
            (warp.search.name(), way, warp.samples.len() + warp.frames.len())
        }
    };
    let effects: Map<String, Value> = EffectKind::ALL
        .into_iter()
        .filter_map(|effect| {
            let ms = effect.ms_of(&frame.stages).filter(|ms| *ms > 0.0)?;
            Some((effect.name().to_owned(), ms.into()))
        })
        .collect();
    let about = json!({
        "search": search,
        "way": way,
        "because": frame.decision.map(|decision| decision.reason.phrase()),
        "samples": samples,
        "unresolved_fraction": frame.unresolved_fraction,
        "rendering_ms": frame.rendering_ms(),
        "age_ms": meta.age_ms,
        "epoch": frame.provenance.state.epoch,
        "light": frame.provenance.state.light,
        "stages": frame.stages,
        "effects": effects,
        "plan": frame.provenance.plan,
        "predicted": frame.predicted,
        "worker": meta.worker,
    });
    match about {
        Value::Object(about) => about,
        _ => Map::new(),
    }
}

/// Assembles an image's message. Adds to its description the length of the JPEG and the figures of the relief.
pub(super) fn image(mut about: Map<String, Value>, jpeg: &[u8], relief: Option<&Relief>) -> Vec<u8> {
    about.insert("jpeg_bytes".to_owned(), json!(jpeg.len()));
    if let Some(Relief { bytes: _, leaves, smallest, step, residual, torn, jumps, median }) = relief {
        let figures = json!({
            "leaves": leaves,
            "smallest": smallest,
            "step": step,
            "residual": residual,
            "torn": torn,
            "jumps": jumps,
            "median": median,
        });
        about.insert("relief".to_owned(), figures);
    }
    let about = Value::Object(about).to_string();
    let relief = relief.map_or(&[][..], |relief| &relief.bytes);
    [&(about.len() as u32).to_le_bytes(), about.as_bytes(), jpeg, relief].concat()
}

/// The reply to an invalid message.
pub(super) fn refused(error: &InvalidField) -> String {
    json!({ "refused": { "field": error.field, "reason": error.reason } }).to_string()
}

/// The message that a camera has no image. `again`: whether another attempt may succeed.
pub(super) fn failed(number: u64, reason: &str, again: bool) -> String {
    json!({ "failed": { "camera": number, "reason": reason, "again": again } }).to_string()
}

/// The message about where other viewers are, from [`super::viewers::others`].
pub(super) fn viewers(others: &Value) -> String {
    json!({ "viewers": others }).to_string()
}

/// The message that the service does not answer and is tried again.
pub(super) fn trouble(reason: &str) -> String {
    json!({ "trouble": reason }).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> Result<Message, InvalidField> {
        read(text, Camera::look_at(DVec3::ONE, DVec3::ZERO), &PlanRequest::default())
    }

    #[test]
    fn a_camera_message_overrides_the_usual_camera() {
        let text =
            r#"{"camera": 7, "eye": [1, -2.5, 3e2], "fov_deg": 45, "size": [320, 200], "direct": true}"#;
        let Message::Camera { number, view, form } = said(text).unwrap() else { panic!("no camera") };
        assert_eq!(form, Form { quality: 90, reach: None });
        assert_eq!(
            (number, view.camera.eye, view.camera.target),
            (7, DVec3::new(1.0, -2.5, 300.0), DVec3::ZERO)
        );
        assert_eq!((view.camera.fov_deg, view.width, view.height, view.plan.direct), (45.0, 320, 200, true));
        let text = r#"{"camera": 0, "direct": false, "reach": 0.25, "quality": 60}"#;
        let Message::Camera { view, form, .. } = said(text).unwrap() else { panic!() };
        assert_eq!((form, view.outputs.has(Output::Range)), (Form { quality: 60, reach: Some(0.25) }, true));
        assert_eq!(([view.width, view.height], view.plan.direct), (USUAL_SIZE, false));
        assert_eq!(said(r#"{"shown": 18446744073709551615}"#).unwrap(), Message::Shown(u64::MAX));
        assert_eq!(said(r#"{"seen": null}"#).unwrap(), Message::Seen(None));
        let text = r#"{"seen": {"eye": [1, 1, 1], "target": [0, 0, 0], "fov_deg": 45}}"#;
        assert_eq!(said(text).unwrap(), Message::Seen(Some(Camera::look_at(DVec3::ONE, DVec3::ZERO))));
    }

    #[test]
    fn an_invalid_message_is_reported_with_its_field() {
        for (text, name) in [
            ("", "message"),
            ("[]", "message"),
            ("{", "message"),
            ("{}", "camera"),
            (r#"{"camera": -1}"#, "camera"),
            (r#"{"camera": "one"}"#, "camera"),
            (r#"{"camera": 1, "eye": [1, 2]}"#, "eye"),
            (r#"{"camera": 1, "target": [1, 2, null]}"#, "target"),
            (r#"{"camera": 1, "up": "y"}"#, "up"),
            (r#"{"camera": 1, "fov_deg": "wide"}"#, "fov_deg"),
            (r#"{"camera": 1, "size": [640]}"#, "size"),
            (r#"{"camera": 1, "size": [-1, 5]}"#, "size"),
            (r#"{"camera": 1, "size": [1e99, 5]}"#, "size"),
            (r#"{"camera": 1, "direct": "yes"}"#, "direct"),
            (r#"{"camera": 1, "quality": 0}"#, "quality"),
            (r#"{"camera": 1, "quality": 101}"#, "quality"),
            (r#"{"camera": 1, "reach": 0}"#, "reach"),
            (r#"{"camera": 1, "reach": -1e9}"#, "reach"),
            (r#"{"camera": 1, "reach": null}"#, "reach"),
            (r#"{"camera": 1, "zoom": 2}"#, "zoom"),
            (r#"{"shown": null}"#, "shown"),
            (r#"{"seen": 5}"#, "seen"),
            (r#"{"seen": {"eye": [0, 0, 0]}}"#, "seen"),
            (r#"{"seen": null, "camera": 2}"#, "seen"),
            (r#"{"shown": 1, "camera": 2}"#, "shown"),
        ] {
            let error = said(text).unwrap_err().to_string();
            assert!(error.contains(name), "{text}: {error}");
        }
    }

    #[test]
    fn an_image_message_is_a_description_a_jpeg_and_the_relief_if_asked() {
        let about = Map::from_iter([("camera_seq".to_owned(), json!(3))]);
        let split = |message: Vec<u8>| {
            let length = u32::from_le_bytes(message[..4].try_into().unwrap()) as usize;
            (message[4..4 + length].to_vec(), message[4 + length..].to_vec())
        };
        let (about_plain, rest) = split(image(about.clone(), b"jpeg", None));
        assert_eq!((&about_plain[..], &rest[..]), (&br#"{"camera_seq":3,"jpeg_bytes":4}"#[..], &b"jpeg"[..]));
        let relief = argus_proto::relief::encode(&[2.0; 6], 3, 2, [1.0, 1.0], 1.0).unwrap();
        let (about, rest) = split(image(about, b"jpeg", Some(&relief)));
        let about: Value = serde_json::from_slice(&about).unwrap();
        assert_eq!((about["jpeg_bytes"].as_u64(), about["relief"]["leaves"].as_u64()), (Some(4), Some(1)));
        assert_eq!(rest, [b"jpeg", &relief.bytes[..]].concat());
    }
}

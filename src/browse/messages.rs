//! Messages between a page and its bridge.
//!
//! A page sends text, one JSON object a message: a camera, or the number of the camera whose image it has shown.
//!
//! ```text
//! {"camera": 7, "eye": [0, 1, 5], "target": [0, 1, 0], "up": [0, 1, 0], "fov_deg": 60, "size": [640, 480], "direct": true}
//! {"shown": 7}
//! ```
//!
//! Only `camera`, its number, must be there; the rest is as for `/frame`. Numbers ascend. The bridge sends images as
//! binary messages: the length of a JSON object in 4 bytes, little-endian; the object, see [`about`]; a JPEG. Errors
//! are text messages with one field: `refused` (the message was not understood), `failed` (a camera has no image) or
//! `trouble` (the service does not answer).

use argus_client::FrameMeta;
use argus_scene::{Camera, Frame, Holes, InvalidField, Outputs, Plan, PlanRequest, View};
use glam::DVec3;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

/// Pixels of a view whose page does not say.
pub(super) const USUAL_SIZE: [u32; 2] = [640, 480];

/// What a page says.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Message {
    /// Asks for the view of a camera, which replaces those before it.
    Camera {
        /// The page's number of it.
        number: u64,
        /// What it sees. Not checked against the service's limits.
        view: Box<View>,
    },
    /// Has shown the image of the camera with that number, and needs none of those before it.
    Shown(u64),
}

/// Reads a message. A camera's fields that are left out are those of `usual`.
///
/// # Errors
/// The field at fault, unknown ones too, and what is wrong with it.
pub(super) fn read(text: &str, usual: Camera, plan: &PlanRequest) -> Result<Message, InvalidField> {
    let fields: Map<String, Value> = serde_json::from_str(text)
        .map_err(|error| InvalidField::new("message", format!("a JSON object is wanted: {error}")))?;
    if let Some(shown) = fields.get("shown") {
        return match fields.len() {
            1 => Ok(Message::Shown(field("shown", shown)?)),
            _ => Err(InvalidField::new("shown", "must be the only field of its message")),
        };
    }
    let (mut camera, mut size, mut plan) = (usual, USUAL_SIZE, *plan);
    let mut number = None;
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
            _ => {
                let known = "camera, eye, target, up, fov_deg, size, direct and shown are";
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
    Ok(Message::Camera {
        number,
        view: Box::new(View { camera, width, height, outputs: Outputs::COLOR, plan, pin: None }),
    })
}

fn field<T: DeserializeOwned>(name: &'static str, value: &Value) -> Result<T, InvalidField> {
    T::deserialize(value).map_err(|error| InvalidField::new(name, error.to_string()))
}

/// What a page shows beside an image: how it was made and what it cost.
///
/// `way` is `direct` (rendered from the triangles), `samples`, or `samples and rays` where rays were traced for
/// pixels that no sample saw. `because` says why that way, or is null where it was requested. `samples` counts them, 0
/// for a direct view. `stages` are the timed steps with their `ms`; `rendering_ms` sums up those that are rendering. `age_ms` is the time since the request reached the service.
/// `predicted` is the expected `error` and `ms`, or null.
pub(super) fn about(frame: &Frame, meta: &FrameMeta) -> Map<String, Value> {
    let (search, way, samples) = match &frame.provenance.plan {
        Plan::Direct { .. } => ("direct", "direct", 0),
        Plan::Warp(warp) => {
            let way = if warp.holes == Holes::Trace { "samples and rays" } else { "samples" };
            (warp.search.name(), way, warp.samples.len())
        }
    };
    let about = json!({
        "search": search,
        "way": way,
        "because": frame.decision.map(|decision| decision.reason.phrase()),
        "samples": samples,
        "unresolved_fraction": frame.unresolved_fraction,
        "rendering_ms": frame.rendering_ms(),
        "age_ms": meta.age_ms,
        "epoch": frame.provenance.epoch,
        "stages": frame.stages,
        "plan": frame.provenance.plan,
        "predicted": frame.predicted,
        "worker": meta.worker,
    });
    match about {
        Value::Object(about) => about,
        _ => Map::new(),
    }
}

/// Puts an image's message together.
pub(super) fn image(about: &Map<String, Value>, jpeg: &[u8]) -> Vec<u8> {
    let about = Value::Object(about.clone()).to_string();
    let mut message = Vec::with_capacity(4 + about.len() + jpeg.len());
    message.extend((about.len() as u32).to_le_bytes());
    message.extend(about.as_bytes());
    message.extend(jpeg);
    message
}

/// Says what was wrong with a message of the page.
pub(super) fn refused(error: &InvalidField) -> String {
    json!({ "refused": { "field": error.field, "reason": error.reason } }).to_string()
}

/// Says that there is no image of a camera. `again` says whether it may succeed if it is asked for again.
pub(super) fn failed(number: u64, reason: &str, again: bool) -> String {
    json!({ "failed": { "camera": number, "reason": reason, "again": again } }).to_string()
}

/// Says that the service does not answer, and that it is asked again.
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
    fn a_camera_says_what_differs_from_the_usual_one() {
        let text =
            r#"{"camera": 7, "eye": [1, -2.5, 3e2], "fov_deg": 45, "size": [320, 200], "direct": true}"#;
        let Message::Camera { number, view } = said(text).unwrap() else { panic!("no camera") };
        assert_eq!(
            (number, view.camera.eye, view.camera.target),
            (7, DVec3::new(1.0, -2.5, 300.0), DVec3::ZERO)
        );
        assert_eq!((view.camera.fov_deg, view.width, view.height, view.plan.direct), (45.0, 320, 200, true));
        let Message::Camera { view, .. } = said(r#"{"camera": 0, "direct": false}"#).unwrap() else {
            panic!()
        };
        assert_eq!(([view.width, view.height], view.plan.direct), (USUAL_SIZE, false));
        assert_eq!(said(r#"{"shown": 18446744073709551615}"#).unwrap(), Message::Shown(u64::MAX));
    }

    #[test]
    fn a_message_that_cannot_be_understood_is_named_by_its_field() {
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
            (r#"{"camera": 1, "zoom": 2}"#, "zoom"),
            (r#"{"shown": null}"#, "shown"),
            (r#"{"shown": 1, "camera": 2}"#, "shown"),
        ] {
            let error = said(text).unwrap_err().to_string();
            assert!(error.contains(name), "{text}: {error}");
        }
    }

    #[test]
    fn an_image_comes_after_its_description() {
        let about = Map::from_iter([("camera_seq".to_owned(), json!(3))]);
        let message = image(&about, b"jpeg");
        let length = u32::from_le_bytes(message[..4].try_into().unwrap()) as usize;
        assert_eq!(&message[4..4 + length], br#"{"camera_seq":3}"#);
        assert_eq!(&message[4 + length..], b"jpeg");
    }
}

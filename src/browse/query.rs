//! The query string of a single frame's address.

use argus_scene::{Camera, InvalidField, Outputs, PlanRequest, View};
use percent_encoding::percent_decode_str;

use super::messages::USUAL_SIZE;
use crate::args;

/// The name of the scene in a query string, if it has one.
pub(super) fn scene(query: &str) -> Option<String> {
    let mut words = query.split('&').filter_map(|word| word.split_once('='));
    let (_, value) = words.find(|(name, _)| *name == "scene")?;
    Some(percent_decode_str(value).decode_utf8_lossy().into_owned())
}

/// Parses a query string. Missing words are taken from `usual` and `plan`. The view is not checked against limits.
///
/// # Errors
/// The invalid or unknown word, and what is wrong with it.
pub(super) fn view(query: &str, usual: Camera, plan: &PlanRequest) -> Result<View, InvalidField> {
    let (mut camera, mut size, mut plan) = (usual, USUAL_SIZE, *plan);
    for word in query.split('&').filter(|word| !word.is_empty()) {
        let (name, value) = word.split_once('=').unwrap_or((word, ""));
        // Invalid UTF-8 is not a number either, and fails as one.
        let value = percent_decode_str(value).decode_utf8_lossy();
        let at_fault = |name| move |reason: String| InvalidField::new(name, reason);
        match name {
            "eye" => camera.eye = args::point(&value).map_err(at_fault("eye"))?,
            "target" => camera.target = args::point(&value).map_err(at_fault("target"))?,
            "up" => camera.up = args::point(&value).map_err(at_fault("up"))?,
            "fov_deg" => {
                camera.fov_deg =
                    value.parse().map_err(|_| InvalidField::new("fov_deg", "must be a number"))?
            }
            "size" => size = args::size(&value).map_err(at_fault("size"))?,
            // Chosen before: see [`scene`].
            "scene" => {}
            "direct" => plan = PlanRequest { direct: true, ..PlanRequest::default() },
            "deadline_ms" => {
                let ms = value.parse().map_err(|_| InvalidField::new("deadline_ms", "must be a number"))?;
                plan.deadline_ms = Some(ms);
            }
            _ => {
                let known = "eye, target, up, fov_deg, size, direct, deadline_ms and scene are";
                return Err(InvalidField::new("query", format!("{name:?} is not known: {known}")));
            }
        }
    }
    let [width, height] = size;
    Ok(View { camera, width, height, outputs: Outputs::COLOR, plan, pin: None, flow_to: None, rays: None })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn asked(query: &str) -> Result<View, InvalidField> {
        view(query, Camera::look_at(DVec3::ONE, DVec3::ZERO), &PlanRequest::default())
    }

    #[test]
    fn a_query_overrides_the_usual_view() {
        let view = asked("eye=1,-2.5,3e2&target=0%2C1%2C0&size=320x200&direct").unwrap();
        assert_eq!((view.camera.eye, view.camera.target), (DVec3::new(1.0, -2.5, 300.0), DVec3::Y));
        assert_eq!(([view.width, view.height], view.plan.direct), ([320, 200], true));
        let view = asked("").unwrap();
        assert_eq!(([view.width, view.height], view.plan.direct), (USUAL_SIZE, false));
    }

    #[test]
    fn a_query_may_name_the_scene() {
        assert_eq!(scene("eye=1,2,3&scene=hall-2").as_deref(), Some("hall-2"));
        assert_eq!(scene("eye=1,2,3&direct&scenes=hall"), None);
        assert!(asked("scene=hall&size=320x200").is_ok());
    }

    #[test]
    fn invalid_words_are_named() {
        for (query, name) in [
            ("eye=1,2", "eye"),
            ("target=1,2,x", "target"),
            ("up=", "up"),
            ("fov_deg=wide", "fov_deg"),
            ("size=640", "size"),
            ("size=-1x5", "size"),
            ("eye=%ff,1,2", "eye"),
            ("eyes=1,2,3", "eyes"),
        ] {
            let error = asked(query).unwrap_err().to_string();
            assert!(error.contains(name), "{query}: {error}");
        }
    }
}

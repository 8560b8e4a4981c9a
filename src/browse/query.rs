//! The query of a single frame's address: the words after the question mark.

use argus_scene::{Camera, InvalidField, Outputs, PlanRequest, View};
use percent_encoding::percent_decode_str;

use super::messages::USUAL_SIZE;
use crate::args;

/// Reads the query of a frame's address. What it leaves out is as `usual` and `plan` say. The view is not checked
/// against limits.
///
/// # Errors
/// The word at fault, unknown ones too, and what is wrong with it.
pub(super) fn view(query: &str, usual: Camera, plan: &PlanRequest) -> Result<View, InvalidField> {
    let (mut camera, mut size, mut plan) = (usual, USUAL_SIZE, *plan);
    for word in query.split('&').filter(|word| !word.is_empty()) {
        let (name, value) = word.split_once('=').unwrap_or((word, ""));
        // What is no UTF-8 is no number either, and is named for that.
        let value = percent_decode_str(value).decode_utf8_lossy();
        let at_fault = |name| move |reason: String| InvalidField::new(name, reason);
        match name {
            "eye" => camera.eye = args::point(&value).map_err(at_fault("eye"))?,
            "target" => camera.target = args::point(&value).map_err(at_fault("target"))?,
            "up" => camera.up = args::point(&value).map_err(at_fault("up"))?,
            "fov_deg" => {
                camera.fov_deg =
                    value.parse().map_err(|_| InvalidField::new("fov_deg", "a number is wanted"))?
            }
            "size" => size = args::size(&value).map_err(at_fault("size"))?,
            "direct" => plan = PlanRequest { direct: true, ..PlanRequest::default() },
            _ => {
                let known = "eye, target, up, fov_deg, size and direct are";
                return Err(InvalidField::new("query", format!("{name:?} is not known: {known}")));
            }
        }
    }
    let [width, height] = size;
    Ok(View { camera, width, height, outputs: Outputs::COLOR, plan, pin: None })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn asked(query: &str) -> Result<View, InvalidField> {
        view(query, Camera::look_at(DVec3::ONE, DVec3::ZERO), &PlanRequest::default())
    }

    #[test]
    fn a_query_says_where_the_viewer_is_and_what_it_leaves_out_is_as_usual() {
        let view = asked("eye=1,-2.5,3e2&target=0%2C1%2C0&size=320x200&direct").unwrap();
        assert_eq!((view.camera.eye, view.camera.target), (DVec3::new(1.0, -2.5, 300.0), DVec3::Y));
        assert_eq!(([view.width, view.height], view.plan.direct), ([320, 200], true));
        let view = asked("").unwrap();
        assert_eq!(([view.width, view.height], view.plan.direct), (USUAL_SIZE, false));
    }

    #[test]
    fn what_cannot_be_understood_is_named() {
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

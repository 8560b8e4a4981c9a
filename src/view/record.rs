//! Records of frames: what made a frame, and the digest of its images. `argus replay` makes such a frame again.

use std::path::Path;

use anyhow::Context;
use argus_client::ClientError;
use argus_proto::Description;
use argus_scene::{Camera, Frame, FrameDigest, Output, Outputs, PlanRequest, Provenance, RayList, View};
use serde::{Deserialize, Serialize};
use tonic::Code;

/// What made a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// Version of the program that wrote it.
    pub(crate) argus: String,
    /// The scene's name; its hash is in the provenance.
    pub(crate) scene: String,
    pub(crate) camera: Camera,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) outputs: Outputs,
    pub(crate) flow_to: Option<Camera>,
    /// The pixels' directions, of a camera of listed rays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rays: Option<RayList>,
    pub(crate) provenance: Provenance,
    /// BLAKE3 of the images, as in `FrameTrailer` of the protocol, hexadecimal.
    pub(crate) digest: FrameDigest,
}

impl Record {
    /// The record of a view's frame.
    pub(crate) fn of(view: &View, scene: &str, frame: &Frame) -> Self {
        Self {
            argus: env!("CARGO_PKG_VERSION").to_owned(),
            scene: scene.to_owned(),
            camera: view.camera,
            width: view.width,
            height: view.height,
            outputs: view.outputs,
            flow_to: view.flow_to,
            rays: view.rays.clone(),
            provenance: frame.provenance.clone(),
            digest: frame.images.digest(),
        }
    }

    /// Writes the record as JSON.
    pub(crate) fn write(&self, path: &Path) -> anyhow::Result<()> {
        let text = serde_json::to_string_pretty(self)?;
        std::fs::write(path, text + "\n").with_context(|| format!("cannot write {}", path.display()))
    }

    /// Reads a record.
    pub(crate) fn read(path: &Path) -> anyhow::Result<Self> {
        let text =
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{} is no record of a frame", path.display()))
    }

    /// The view that makes the frame again, by any device.
    pub(crate) fn view(&self) -> View {
        let pin = Provenance { device: String::new(), ..self.provenance.clone() };
        View {
            camera: self.camera,
            width: self.width,
            height: self.height,
            outputs: self.outputs,
            plan: PlanRequest::default(),
            pin: Some(pin),
            flow_to: self.flow_to,
            rays: self.rays.clone(),
        }
    }

    /// Why a service cannot make the frame again; empty if it may.
    pub(crate) fn obstacles(&self, served: &Description) -> Vec<String> {
        let mut found = Vec::new();
        if served.scene_hash != self.provenance.scene {
            let (was, is) = (self.provenance.scene, served.scene_hash);
            found.push(format!(
                "scene: {} ({was}) is recorded, {} ({is}) is served",
                self.scene, served.scene_name
            ));
        }
        if self.provenance.history {
            found.push(
                "plan: the search of the recorded frame began from an earlier frame of its session"
                    .to_owned(),
            );
        }
        found
    }

    /// What differs between the recorded frame and one of the same view; empty if their images are equal.
    pub(crate) fn differences(&self, again: &Self) -> Vec<String> {
        if self.digest == again.digest {
            return Vec::new();
        }
        let (was, is) = (&self.provenance, &again.provenance);
        let mut found = vec![format!("digest: {} is recorded, {} was made", self.digest, again.digest)];
        let mut compare = |name: &str, was: String, is: String| {
            if was != is {
                found.push(format!("{name}: {was} is recorded, {is} made it again"));
            }
        };
        compare("device", was.device.clone(), is.device.clone());
        compare("version of argus", self.argus.clone(), again.argus.clone());
        compare("scene", was.scene.to_string(), is.scene.to_string());
        compare("plan", format!("{:?}", was.plan), format!("{:?}", is.plan));
        if let (Some(asked), Some(used)) = (was.specification, is.specification)
            && let Some(at) = asked.difference(&used, &is.plan)
        {
            compare(&format!("specification, {}", at.field), at.first.to_string(), at.second.to_string());
        }
        found
    }

    /// Why a service refused to make the frame again, if its provenance is the reason.
    pub(crate) fn refusal(error: &ClientError) -> Option<String> {
        match error {
            ClientError::Server { code: Code::FailedPrecondition, message, .. } => {
                let reason = message.strip_prefix("the pinned provenance cannot be met: ").unwrap_or(message);
                Some(format!("pin: {reason}"))
            }
            ClientError::Invalid { field, reason } if field.starts_with("pin") => {
                Some(format!("pin: {field}: {reason}"))
            }
            _ => None,
        }
    }

    /// The outputs, in the order of their numbers.
    pub(crate) fn outputs(&self) -> Vec<Output> {
        self.outputs.iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use argus_proto::Fault;
    use argus_scene::{Images, InvalidField, Plan, SceneHash, SceneState};
    use glam::DVec3;

    use super::*;

    fn record(image: &'static [u8], device: &str) -> Record {
        let plan = Plan::direct(4);
        let provenance = Provenance {
            device: device.to_owned(),
            ..Provenance::of_plan(SceneHash([7; 32]), SceneState::default(), plan)
        };
        let images = Images::from([(Output::Color, image.to_vec().into())]);
        let frame = Frame { images, ..Frame::without_images(2, 1, provenance) };
        // Numbers whose shortest decimals have all 17 digits.
        let camera = Camera::look_at(DVec3::new(0.1 + 0.2, 1.0 / 3.0, -2.0 / 7.0), DVec3::splat(1e-17));
        let view = View {
            camera,
            width: 2,
            height: 1,
            outputs: Outputs::COLOR,
            plan: PlanRequest::default(),
            pin: None,
            flow_to: Some(camera),
            rays: None,
        };
        Record::of(&view, "rooms", &frame)
    }

    #[test]
    fn a_record_survives_its_file_bit_for_bit_and_pins_its_plan_by_any_device() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("frame.json");
        let record = record(b"abcdef", "a device");
        record.write(&file).unwrap();
        let read = Record::read(&file).unwrap();
        assert_eq!(read, record);
        let pin = read.view().pin.unwrap();
        assert_eq!((pin.device.as_str(), &pin.plan), ("", &record.provenance.plan));
        std::fs::write(&file, "{}").unwrap();
        assert!(Record::read(&file).unwrap_err().to_string().contains("no record of a frame"));
    }

    #[test]
    fn a_refused_pin_is_a_difference_and_other_failures_are_not() {
        let refused = |fault: Fault| Record::refusal(&ClientError::from(tonic::Status::from(fault)));
        let pin = refused(Fault::Pin("indirect cells is not served here, indirect off is".to_owned()));
        assert_eq!(pin.as_deref(), Some("pin: indirect cells is not served here, indirect off is"));
        let field = InvalidField::new("pin.plan.warp.steps", "must be 1 to 4096");
        assert_eq!(refused(field.into()).as_deref(), Some("pin: pin.plan.warp.steps: must be 1 to 4096"));
        assert_eq!(refused(InvalidField::new("camera.up", "must not be 0").into()), None);
        assert_eq!(refused(Fault::Unavailable("no worker".to_owned())), None);
    }

    #[test]
    fn equal_images_do_not_differ_and_others_name_the_device() {
        let first = record(b"abcdef", "a device");
        assert!(first.differences(&record(b"abcdef", "another")).is_empty());
        let found = first.differences(&record(b"abcdeg", "another"));
        assert!(found[0].starts_with("digest: ") && found[1].starts_with("device: a device"), "{found:?}");
        assert_eq!(found.len(), 2);
        assert_eq!(first.differences(&record(b"abcdeg", "a device")).len(), 1);
    }
}

//! What a frame says of itself, and the service of its scene, as JSON.

use argus_client::{ClientError, Description, FrameMeta};
use argus_scene::frame::Decision;
use argus_scene::{
    Camera, Frame, FrameDigest, Outputs, Prediction, Provenance, RayList, Served, Stage, View,
};
use serde::{Serialize, Serializer};
use serde_json::{Value, json};

/// A frame without its images.
#[derive(Serialize)]
pub(crate) struct Report<'a> {
    worker: &'a str,
    age_ms: f64,
    unresolved_fraction: f64,
    served: &'a Served,
    predicted: &'a Option<Prediction>,
    decision: &'a Option<Decision>,
    provenance: &'a Provenance,
    /// The client compared it with the images.
    digest: FrameDigest,
    #[serde(serialize_with = "by_name")]
    cost: &'a [Stage],
    #[serde(skip_serializing_if = "Option::is_none")]
    record: Option<Record<'a>>,
}

impl<'a> Report<'a> {
    pub(crate) fn of(frame: &'a Frame, meta: &'a FrameMeta) -> Self {
        Self {
            worker: &meta.worker,
            age_ms: meta.age_ms,
            unresolved_fraction: frame.unresolved_fraction,
            served: &frame.served,
            predicted: &frame.predicted,
            decision: &frame.decision,
            provenance: &frame.provenance,
            digest: meta.digest,
            cost: &frame.stages,
            record: None,
        }
    }

    /// With what `argus replay` makes the frame again from.
    pub(crate) fn with_record(self, view: &'a View, scene: &'a str) -> Self {
        let record = Record {
            argus: env!("CARGO_PKG_VERSION"),
            scene,
            camera: &view.camera,
            width: view.width,
            height: view.height,
            outputs: view.outputs,
            flow_to: &view.flow_to,
            rays: &view.rays,
            provenance: self.provenance,
            digest: self.digest,
        };
        Self { record: Some(record), ..self }
    }

    /// As JSON.
    ///
    /// # Errors
    /// Something in it has no form in JSON.
    pub(crate) fn text(&self) -> Result<String, ClientError> {
        serde_json::to_string(self).map_err(|error| ClientError::Invalid {
            field: "frame".to_owned(),
            reason: format!("its report is no JSON: {error}"),
        })
    }
}

/// Milliseconds by stage. The times of a pass that ran more than once are added.
fn by_name<S: Serializer>(stages: &[Stage], serializer: S) -> Result<S::Ok, S::Error> {
    let mut cost: Vec<(&str, f64)> = Vec::with_capacity(stages.len());
    for stage in stages {
        match cost.iter_mut().find(|(name, _)| *name == stage.name) {
            Some((_, ms)) => *ms += stage.ms,
            None => cost.push((&stage.name, stage.ms)),
        }
    }
    serializer.collect_map(cost)
}

/// What `argus replay` makes a frame again from.
#[derive(Serialize)]
struct Record<'a> {
    argus: &'static str,
    scene: &'a str,
    camera: &'a Camera,
    width: u32,
    height: u32,
    outputs: Outputs,
    flow_to: &'a Option<Camera>,
    rays: &'a Option<RayList>,
    provenance: &'a Provenance,
    digest: FrameDigest,
}

/// The served scene. Lengths are in metres, +y is up.
pub(crate) fn of_service(description: &Description) -> String {
    let viewpoints: Vec<Value> = description
        .cameras
        .iter()
        .map(|named| json!({ "name": named.name, "camera": named.camera }))
        .collect();
    json!({
        "scene": description.scene_name,
        "scene_hash": description.scene_hash.to_string(),
        "bounds": [description.bounds.min, description.bounds.max],
        "triangles": description.triangles,
        "effects": description.effects,
        "viewpoints": viewpoints,
        "max_side": description.limits.max_side,
        "max_pixels": description.limits.max_pixels,
        "epoch_secs": description.epoch_secs,
        "light": description.light,
        "scenes": description.scenes,
    })
    .to_string()
}

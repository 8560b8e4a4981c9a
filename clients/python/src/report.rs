//! What a frame says of itself, and the service of its scene, as JSON.

use argus_client::{Description, FrameMeta};
use argus_scene::{Frame, View};
use serde_json::{Map, Value, json};

/// A frame without its images: worker, age_ms, unresolved_fraction, served, predicted, decision, provenance, digest, and cost:
/// milliseconds by stage.
pub(crate) fn of_frame(frame: &Frame, meta: &FrameMeta) -> Value {
    let mut cost = Map::new();
    for stage in &frame.stages {
        // The times of a pass that ran more than once are added.
        let before = cost.get(&stage.name).and_then(Value::as_f64).unwrap_or(0.0);
        cost.insert(stage.name.clone(), json!(before + stage.ms));
    }
    json!({
        "worker": meta.worker,
        "age_ms": meta.age_ms,
        "unresolved_fraction": frame.unresolved_fraction,
        "served": frame.served,
        "predicted": frame.predicted,
        "decision": frame.decision,
        "provenance": frame.provenance,
        // The client compared it with the images.
        "digest": meta.digest,
        "cost": cost,
    })
}

/// What `argus replay` makes a frame again from.
pub(crate) fn record(view: &View, scene: &str, frame: &Frame, meta: &FrameMeta) -> Value {
    json!({
        "argus": env!("CARGO_PKG_VERSION"),
        "scene": scene,
        "camera": view.camera,
        "width": view.width,
        "height": view.height,
        "outputs": view.outputs,
        "flow_to": view.flow_to,
        "rays": view.rays,
        "provenance": frame.provenance,
        "digest": meta.digest,
    })
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

//! The description of a service.

use argus_scene::scene::NamedCamera;
use argus_scene::{
    Bounds, Effect, EffectPlan, InvalidField, LightLevel, Limits, PlanRequest, Rig, SceneHash,
};

use super::enums::{WireEnum, light_level};
use super::scene::epoch_secs;
use super::{required, scene_hash, scene_hash_bytes};
use crate::{PROTOCOL_VERSION, v1};

/// The answer to `Describe`: the served scene, its limits and defaults.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// Name of the scene.
    pub scene_name: String,
    /// Hash of the scene.
    pub scene_hash: SceneHash,
    /// Box of the surfaces that viewers look at. What is far away or far larger reaches out of it.
    pub bounds: Bounds,
    /// Triangles, instances counted.
    pub triangles: u64,
    /// Effects in the scene.
    pub effects: Vec<Effect>,
    /// Which effects of light are computed, and why.
    pub effect_plan: EffectPlan,
    /// Recommended viewpoints, each valid; at least one.
    pub cameras: Vec<NamedCamera>,
    /// The largest view that is accepted.
    pub limits: Limits,
    /// The rig of sample cameras.
    pub rig: Rig,
    /// The service's choices for open fields of a plan.
    pub defaults: PlanRequest,
    /// Seconds of scene time from one epoch to the next; 0 in a still scene.
    pub epoch_secs: f64,
    /// The light of the first views. From direct light it rises to full light; any other level stays.
    pub first_light: LightLevel,
    /// The light that the scene is shown in and why, in one line; empty if nothing was chosen.
    pub light: String,
    /// Names of all scenes of the service; the first is that of requests that name none.
    pub scenes: Vec<String>,
}

impl From<&Description> for v1::DescribeResponse {
    fn from(description: &Description) -> Self {
        Self {
            protocol_version: PROTOCOL_VERSION,
            scene: Some(v1::SceneRef {
                name: description.scene_name.clone(),
                hash: scene_hash_bytes(description.scene_hash),
            }),
            bounds: Some(description.bounds.into()),
            triangles: description.triangles,
            effects: description.effects.iter().map(|effect| effect.number()).collect(),
            effect_plan: description.effect_plan.rows.iter().map(Into::into).collect(),
            cameras: description.cameras.iter().map(Into::into).collect(),
            limits: Some(description.limits.into()),
            rig: Some((&description.rig).into()),
            defaults: Some((&description.defaults).into()),
            epoch_secs: description.epoch_secs,
            first_light: description.first_light.number(),
            light: description.light.clone(),
            scenes: description.scenes.clone(),
        }
    }
}

impl TryFrom<v1::DescribeResponse> for Description {
    type Error = InvalidField;

    fn try_from(wire: v1::DescribeResponse) -> Result<Self, InvalidField> {
        let scene = required(wire.scene, "scene")?;
        let effect = |number| Effect::from_number(number, "effects");
        let cameras: Vec<NamedCamera> =
            wire.cameras.into_iter().map(TryInto::try_into).collect::<Result<_, _>>()?;
        if cameras.is_empty() {
            return Err(InvalidField::new("cameras", "must hold at least one viewpoint"));
        }
        Ok(Self {
            scene_hash: scene_hash(&scene.hash, "scene.hash")?,
            scene_name: scene.name,
            bounds: required(wire.bounds, "bounds")?.try_into()?,
            triangles: wire.triangles,
            effects: wire.effects.into_iter().map(effect).collect::<Result<_, _>>()?,
            effect_plan: EffectPlan {
                rows: wire.effect_plan.into_iter().map(TryInto::try_into).collect::<Result<_, _>>()?,
            },
            cameras,
            limits: required(wire.limits, "limits")?.try_into()?,
            rig: required(wire.rig, "rig")?.try_into()?,
            defaults: required(wire.defaults, "defaults")?.try_into()?,
            epoch_secs: epoch_secs(wire.epoch_secs, "epoch_secs")?,
            first_light: light_level(wire.first_light, "first_light")?,
            light: wire.light,
            scenes: wire.scenes,
        })
    }
}

//! What effects cost, by the stages of frames and samples.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{EffectCosts, EffectKind, EffectPlan};
use crate::{Scene, Stage};

/// Pixels of the view from triangles whose milliseconds [`EffectCost`] states: 640×480, each rendered once.
pub const COST_PIXELS: u64 = 640 * 480;

/// What a service measured of an effect: milliseconds for all of the scene's lights, of a view from triangles of
/// [`COST_PIXELS`] pixels in full detail. Views of other sizes are scaled by their pixels.
///
/// Effects that are part of shading have no stage of their own in [`STAGES`], so they are not measured. The costs of samples
/// and of views from samples are not in it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EffectCost {
    /// The effect.
    pub effect: EffectKind,
    /// By small views with the effect, which were rendered only to measure it. `None` if none of its stages ran in them.
    pub predicted_ms: Option<f64>,
    /// By views that were answered, over those in which its stages ran; `None` before.
    pub measured_ms: Option<f64>,
}

impl EffectCost {
    /// The effects whose stages ran in a view from triangles, with their milliseconds at [`COST_PIXELS`]. `pixels` are those that were
    /// rendered, with sub-pixels.
    pub fn ms_by_effect(stages: &[Stage], pixels: u64) -> BTreeMap<EffectKind, f64> {
        let mut costs = BTreeMap::new();
        for stage in stages.iter().filter(|stage| stage.ms > 0.0) {
            if let Some(effect) = EffectKind::of_stage(&stage.name) {
                *costs.entry(effect).or_insert(0.0) += stage.ms * COST_PIXELS as f64 / pixels.max(1) as f64;
            }
        }
        costs
    }

    /// Costs as a view that was rendered to measure them shows them.
    pub fn predicted(stages: &[Stage], pixels: u64) -> Vec<Self> {
        let cost = |(effect, ms)| Self { effect, predicted_ms: Some(ms), measured_ms: None };
        Self::ms_by_effect(stages, pixels).into_iter().map(cost).collect()
    }
}

/// Stages that run for one effect alone, by name. A stage that several effects share belongs to none: reading surfaces
/// back and adding up what arrives at them ([`SHARED_STAGE`]) runs as soon as one effect of direct light casts rays.
pub const STAGES: [(&str, EffectKind); 31] = [
    ("trace shadows", EffectKind::Shadows),
    ("trace penumbras", EffectKind::SoftShadows),
    ("trace emitters", EffectKind::Emitters),
    ("trace sky", EffectKind::SkyVisibility),
    ("add highlights", EffectKind::Highlights),
    ("reflection probes", EffectKind::Reflection),
    ("reflection points", EffectKind::Reflection),
    ("reflection rays", EffectKind::Reflection),
    ("find reflections", EffectKind::Reflection),
    ("add reflections", EffectKind::Reflection),
    ("build trees for reflections", EffectKind::Reflection),
    ("shade points", EffectKind::Reflection),
    ("trace VPLs", EffectKind::Indirect),
    ("group VPLs", EffectKind::Indirect),
    ("maps of VPLs", EffectKind::Indirect),
    ("cull VPLs", EffectKind::Indirect),
    ("gather VPLs", EffectKind::Indirect),
    ("choose receivers", EffectKind::Indirect),
    ("receive light", EffectKind::Indirect),
    ("spread light", EffectKind::Indirect),
    ("filter indirect light", EffectKind::Indirect),
    ("add indirect light", EffectKind::Indirect),
    ("light leaves: build", EffectKind::Indirect),
    ("light leaves: links", EffectKind::Indirect),
    ("light leaves: direct", EffectKind::Indirect),
    ("light leaves: gather", EffectKind::Indirect),
    ("gather paths", EffectKind::Indirect),
    ("test alpha", EffectKind::CutOuts),
    ("trace layers", EffectKind::Transparency),
    ("blend layers", EffectKind::Transparency),
    ("pose", EffectKind::Animation),
];

/// The stage that all effects of direct light by rays share. It runs while at least one of them is on.
pub const SHARED_STAGE: &str = "light surfaces";

impl EffectKind {
    /// The effect that a stage runs for; `None` if several share it, or none.
    pub fn of_stage(name: &str) -> Option<Self> {
        STAGES.iter().find(|(stage, _)| *stage == name).map(|(_, effect)| *effect)
    }

    /// Milliseconds of the stages that run for this effect alone: 0 if none of them ran. `None` if the effect has no stage
    /// of its own in [`STAGES`]; it is then a part of shading.
    pub fn ms_of(self, stages: &[Stage]) -> Option<f64> {
        let own = |name: &str| STAGES.iter().any(|&(stage, effect)| effect == self && stage == name);
        let is_known = STAGES.iter().any(|&(_, effect)| effect == self);
        // From 0.0, because the sum of no floats is -0.0.
        is_known
            .then(|| stages.iter().filter(|stage| own(&stage.name)).fold(0.0, |sum, stage| sum + stage.ms))
    }

    /// For how many lights of a scene an effect casts rays, or 1 if its cost does not depend on lights.
    pub(super) fn lights_of(self, scene: &Scene) -> usize {
        let lights = &scene.lighting.lights;
        let count = match self {
            Self::Shadows | Self::Highlights => lights.len(),
            Self::SoftShadows => lights.iter().filter(|light| light.is_extended()).count(),
            _ => 1,
        };
        count.max(1)
    }
}

impl EffectCosts {
    /// The costs of the effects that ran for a frame or sample of a scene. Effects of lights have the cost of one light.
    /// Effects without a stage in `stages` are absent.
    pub fn of_stages(scene: &Scene, stages: &[Stage]) -> Self {
        let cost = |effect: EffectKind| {
            let ms = effect.ms_of(stages).filter(|ms| *ms > 0.0)?;
            Some((effect, ms / effect.lights_of(scene) as f64))
        };
        Self { ms: EffectKind::ALL.into_iter().filter_map(cost).collect() }
    }

    /// The costs of images with `factor` times as many pixels.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { ms: self.ms.iter().map(|(&effect, ms)| (effect, ms * factor)).collect() }
    }
}

impl EffectPlan {
    /// The plan with costs that were measured. A row that is off states as saved what its effect cost in the views that were
    /// rendered to measure it. A row that is off and has no cause states nothing: whatever rays cost there, they change no pixel.
    #[must_use]
    pub fn with_costs(mut self, costs: &[EffectCost]) -> Self {
        for row in self.rows.iter_mut().filter(|row| row.on || !row.causes.is_empty()) {
            let Some(cost) = costs.iter().find(|cost| cost.effect == row.effect) else { continue };
            row.predicted_ms = cost.predicted_ms.or(row.predicted_ms);
            match row.on {
                true => row.measured_ms = cost.measured_ms,
                false => row.saved_ms = cost.predicted_ms,
            }
        }
        self
    }

    /// Keeps what the effects that are on cost in a frame or sample, by its stages. Effects without stages of their own keep
    /// what they had.
    pub fn measured_in(&mut self, stages: &[Stage]) {
        for row in self.rows.iter_mut().filter(|row| row.on) {
            if let Some(ms) = row.effect.ms_of(stages) {
                row.measured_ms = Some(ms);
            }
        }
    }
}

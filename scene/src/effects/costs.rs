//! What effects cost, by the stages of frames and samples.

use super::{EffectCosts, EffectKind, EffectPlan};
use crate::{Scene, Stage};

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

//! The effect plan: which effects a scene calls for, why, what they cost, and how much they can change.
//!
//! [`EffectPlan::of`] is a pure function of a scene, a request and measured costs. It needs no GPU and renders nothing. A
//! sample set's [`LightEffects`] come from its plan alone, so a row that is off costs nothing.
//!
//! # Bounds
//! A row's bound is the largest change of a pixel when its effect is switched, in display-linear values (after exposure,
//! before sRGB), at most 1. It is computed before anything is rendered, from these quantities per body, an instance with
//! triangles:
//!
//! - a: largest albedo, by factors, vertex colours, and the largest texel;
//! - E: largest irradiance of a light in the body's box, by the box's distance from the light (at least 1 mm, as
//!   [`crate::shading::incident`] clamps it) and the light's range and cone;
//! - h = E / (2πα³): largest highlight, with GGX's largest value 1/(πα²) and Smith's visibility of at most 1/(2α);
//! - L_e and S: largest radiance of emission and sky; x: exposure.
//!
//! | effect | bound, before exposure and clipping |
//! |---|---|
//! | lights | a·E/π |
//! | shadows, soft shadows | Σ (a·E/π + h) over lights; a light without a caster counts by the sine of the angle between shading and triangle normals |
//! | sky visibility | a·S, and 1.05·S where glossy; without occluders a·0.17·(brightest − darkest) |
//! | emitters | a · min(L_e, Σ L_e·area/(π·d²)) |
//! | highlights | Σ h |
//! | reflection | 1.05 · max(L, S), where L = (L_e + a(E/π + S))/(1 − a) |
//! | transmission | t · max(L, S) |
//! | indirect light | a·(L_e + a(E/π + S))/(1 − a) |
//! | glow | L_e |
//! | particles | a·ΣI/(π·clamp²) |
//! | cut-outs, transparency, animation | 1: they are never off |
//!
//! The bounds are those of converged light. Noise of a random estimate, such as that of an emitter close to a surface, is
//! not in them. The sum of several rows' bounds bounds what they change together.

mod costs;
mod lights;
mod request;
mod rows;
mod surfaces;

use std::fmt;

use serde::Serialize;

pub use costs::{COST_PIXELS, EffectCost, SHARED_STAGE, STAGES};
pub use request::{EffectCosts, EffectRequest, Effects, ReflectionRequest};

use crate::tone::srgb_from_linear;
use crate::{Indirect, LightEffects, PathKnobs, Reflections, Scene};

/// Something that light does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectKind {
    /// Diffuse light of directional lights.
    Sun,
    /// Diffuse light of point lights.
    PointLights,
    /// Diffuse light of spot lights.
    SpotLights,
    /// Surfaces block directional, point and spot lights.
    Shadows,
    /// Shadows have penumbras.
    SoftShadows,
    /// Emitting triangles light other surfaces.
    Emitters,
    /// Surfaces block the sky.
    SkyVisibility,
    /// Lights are reflected on glossy surfaces.
    Highlights,
    /// Smooth surfaces reflect the scene.
    Reflection,
    /// Light passes through surfaces.
    Transmission,
    /// Surfaces light one another.
    Indirect,
    /// Emission is seen.
    Glow,
    /// Glowing particles light surfaces.
    Particles,
    /// Parts of surfaces do not exist, by their alpha.
    CutOuts,
    /// Surfaces hide only a part of what is behind them, by their alpha.
    Transparency,
    /// Instances or lights move.
    Animation,
}

impl EffectKind {
    /// All kinds, in the order of a plan's rows.
    pub const ALL: [Self; 16] = [
        Self::Sun,
        Self::PointLights,
        Self::SpotLights,
        Self::Shadows,
        Self::SoftShadows,
        Self::Emitters,
        Self::SkyVisibility,
        Self::Highlights,
        Self::Reflection,
        Self::Transmission,
        Self::Indirect,
        Self::Glow,
        Self::Particles,
        Self::CutOuts,
        Self::Transparency,
        Self::Animation,
    ];

    /// The name in arguments, tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sun => "sun",
            Self::PointLights => "point-lights",
            Self::SpotLights => "spot-lights",
            Self::Shadows => "shadows",
            Self::SoftShadows => "soft-shadows",
            Self::Emitters => "emitters",
            Self::SkyVisibility => "sky-visibility",
            Self::Highlights => "highlights",
            Self::Reflection => "reflection",
            Self::Transmission => "transmission",
            Self::Indirect => "indirect",
            Self::Glow => "glow",
            Self::Particles => "particles",
            Self::CutOuts => "cut-outs",
            Self::Transparency => "transparency",
            Self::Animation => "animation",
        }
    }
}

impl fmt::Display for EffectKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How often an effect is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Paid {
    /// Once for each sample, and for each view from triangles.
    Sample,
    /// For each view.
    View,
    /// Once for each epoch of a sample set.
    Epoch,
    /// Once for each pose of the scene.
    Pose,
}

impl Paid {
    /// The name in tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::View => "view",
            Self::Epoch => "epoch",
            Self::Pose => "pose",
        }
    }
}

/// What causes an effect: ascending indices into the scene's lists. At most [`Causes::MOST`] of each kind are named.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Causes {
    /// Indices into [`Scene::materials`].
    pub materials: Vec<u32>,
    /// Indices into the lights of [`Scene::lighting`].
    pub lights: Vec<u32>,
    /// Indices into [`Scene::nodes`].
    pub nodes: Vec<u32>,
    /// Indices into [`Scene::instances`]: reflectors, and for each light one that may cast a shadow.
    pub instances: Vec<u32>,
    /// Whether the sky is a cause.
    pub sky: bool,
}

impl Causes {
    /// Largest number of causes of one kind that a row names.
    pub const MOST: usize = 64;

    /// Whether nothing in the scene causes the effect.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// One effect of a plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EffectRow {
    /// The effect.
    pub effect: EffectKind,
    /// What causes it.
    pub causes: Causes,
    /// How often it is computed.
    pub paid: Vec<Paid>,
    /// Expected milliseconds each time; `None` without measured costs.
    pub predicted_ms: Option<f64>,
    /// Largest change of a pixel, display-linear, 0 to 1: see the module.
    pub bound: f64,
    /// Whether it is computed.
    pub on: bool,
    /// Why it is on or off.
    pub why: String,
    /// Milliseconds that it cost each time; `None` before something was rendered.
    pub measured_ms: Option<f64>,
    /// Milliseconds that were saved each time because it is off; `None` before they were measured.
    pub saved_ms: Option<f64>,
}

impl EffectRow {
    /// Largest change of a pixel's byte, 0 to 255. One byte of it is rounding. sRGB is concave, so the change from black is
    /// the largest.
    pub fn bound_bytes(&self) -> f64 {
        (bytes(self.bound) + 1.0).min(255.0)
    }
}

/// Bytes of a display-linear change from black, before rounding.
fn bytes(bound: f64) -> f64 {
    255.0 * f64::from(srgb_from_linear(bound as f32))
}

/// The effects of a sample set, one row for each kind.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct EffectPlan {
    /// In the order of [`EffectKind::ALL`].
    pub rows: Vec<EffectRow>,
}

impl EffectPlan {
    /// The plan for a scene.
    pub fn of(scene: &Scene, request: &EffectRequest, costs: Option<&EffectCosts>) -> Self {
        Self { rows: rows::rows(scene, request, costs) }
    }

    /// The row of an effect; `None` if the plan has none, so that it is off.
    pub fn row(&self, effect: EffectKind) -> Option<&EffectRow> {
        self.rows.iter().find(|row| row.effect == effect)
    }

    /// Whether an effect is computed.
    pub fn is_on(&self, effect: EffectKind) -> bool {
        self.row(effect).is_some_and(|row| row.on)
    }

    /// The effects of direct light that a sample set is made with.
    pub fn light_effects(&self) -> LightEffects {
        LightEffects {
            shadows: self.is_on(EffectKind::Shadows),
            soft_shadows: self.is_on(EffectKind::SoftShadows),
            sky_visibility: self.is_on(EffectKind::SkyVisibility),
            emitters: self.is_on(EffectKind::Emitters),
        }
    }

    /// The indirect light that a sample set is made with, where `request` was made of this plan.
    pub fn indirect(&self, request: &EffectRequest) -> Indirect {
        match request.indirect {
            Some(indirect) => indirect,
            None if self.is_on(EffectKind::Indirect) => Indirect::Paths(PathKnobs::default()),
            None => Indirect::Off,
        }
    }

    /// How the sample set's reflections are found, where `request` was made of this plan; `None` if they are off.
    pub fn reflections(&self, scene: &Scene, request: &EffectRequest) -> Option<Reflections> {
        let is_on = self.is_on(EffectKind::Reflection) || self.is_on(EffectKind::Transmission);
        request.reflections.settled(scene).filter(|_| is_on).map(|(knobs, _)| knobs)
    }

    /// Keeps the milliseconds that an effect was measured to cost: what it costs where it is on, and what it would cost,
    /// which is saved, where it is off.
    pub fn measured(&mut self, effect: EffectKind, ms: f64) {
        for row in self.rows.iter_mut().filter(|row| row.effect == effect) {
            if row.on {
                row.measured_ms = Some(ms);
            } else {
                row.saved_ms = Some(ms);
            }
        }
    }
}

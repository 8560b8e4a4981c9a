//! One effect of a plan.

use std::fmt;

use serde::Serialize;

use crate::tone::srgb_from_linear;

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
    /// Indices into [`crate::Scene::materials`].
    pub materials: Vec<u32>,
    /// Indices into the lights of [`crate::Scene::lighting`].
    pub lights: Vec<u32>,
    /// Indices into [`crate::Scene::nodes`].
    pub nodes: Vec<u32>,
    /// Indices into [`crate::Scene::instances`]: reflectors, and for each light one that may cast a shadow.
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
pub(super) fn bytes(bound: f64) -> f64 {
    255.0 * f64::from(srgb_from_linear(bound as f32))
}

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
mod row;
mod rows;
mod surfaces;

use serde::Serialize;

pub use costs::{COST_PIXELS, EffectCost, SHARED_STAGE, STAGES};
pub use request::{EffectCosts, EffectRequest, Effects, ReflectionRequest};
pub use row::{Causes, EffectKind, EffectRow, Paid};

use crate::{CellSettings, Indirect, LightEffects, Reflections, Scene};

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

    /// The indirect light that a sample set is made with, where `request` was made of this plan. A light of interiors has none
    /// between surfaces; what is seen of it is kept in light cells, which cost less than rays of each view.
    pub fn indirect(&self, scene: &Scene, request: &EffectRequest) -> Indirect {
        let is_inside = scene.lighting.sky.reach.is_some() && self.is_on(EffectKind::SkyVisibility);
        match request.indirect {
            Some(indirect) => indirect,
            None if self.is_on(EffectKind::Indirect) => Indirect::Cells(CellSettings::default()),
            None if request.effects == Effects::Auto && is_inside && !scene.is_animated() => {
                Indirect::Cells(CellSettings::of_sky())
            }
            None => Indirect::Off,
        }
    }

    /// How the sample set's reflections are found, where `request` was made of this plan; `None` if they are off.
    pub fn reflections(&self, scene: &Scene, request: &EffectRequest) -> Option<Reflections> {
        let is_on = self.is_on(EffectKind::Reflection) || self.is_on(EffectKind::Transmission);
        request.reflections.settled(scene).filter(|_| is_on).map(|(settings, _)| settings)
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

//! Conversions of the effect plan.

use argus_scene::effects::{Causes, EffectCost, EffectKind, EffectRow, Paid};
use argus_scene::{EffectPlan, InvalidField};

use super::{duration_ms, known, unspecified};
use crate::v1;

/// Pairs of kinds, in the vocabulary and on the wire.
const KINDS: [(EffectKind, v1::EffectKind); 16] = [
    (EffectKind::Sun, v1::EffectKind::Sun),
    (EffectKind::PointLights, v1::EffectKind::PointLights),
    (EffectKind::SpotLights, v1::EffectKind::SpotLights),
    (EffectKind::Shadows, v1::EffectKind::Shadows),
    (EffectKind::SoftShadows, v1::EffectKind::SoftShadows),
    (EffectKind::Emitters, v1::EffectKind::Emitters),
    (EffectKind::SkyVisibility, v1::EffectKind::SkyVisibility),
    (EffectKind::Highlights, v1::EffectKind::Highlights),
    (EffectKind::Reflection, v1::EffectKind::Reflection),
    (EffectKind::Transmission, v1::EffectKind::Transmission),
    (EffectKind::Indirect, v1::EffectKind::Indirect),
    (EffectKind::Glow, v1::EffectKind::Glow),
    (EffectKind::Particles, v1::EffectKind::Particles),
    (EffectKind::CutOuts, v1::EffectKind::CutOuts),
    (EffectKind::Transparency, v1::EffectKind::Transparency),
    (EffectKind::Animation, v1::EffectKind::Animation),
];

impl From<EffectKind> for v1::EffectKind {
    fn from(kind: EffectKind) -> Self {
        KINDS.into_iter().find(|(known, _)| *known == kind).map_or(Self::Unspecified, |(_, wire)| wire)
    }
}

impl TryFrom<v1::EffectKind> for EffectKind {
    type Error = InvalidField;

    fn try_from(wire: v1::EffectKind) -> Result<Self, InvalidField> {
        let found = KINDS.into_iter().find(|(_, known)| *known == wire);
        found.map(|(kind, _)| kind).ok_or_else(|| unspecified("effect_plan.effect"))
    }
}

impl From<Paid> for v1::Paid {
    fn from(paid: Paid) -> Self {
        match paid {
            Paid::Sample => Self::Sample,
            Paid::View => Self::View,
            Paid::Epoch => Self::Epoch,
            Paid::Pose => Self::Pose,
        }
    }
}

impl TryFrom<v1::Paid> for Paid {
    type Error = InvalidField;

    fn try_from(wire: v1::Paid) -> Result<Self, InvalidField> {
        Ok(match wire {
            v1::Paid::Unspecified => return Err(unspecified("effect_plan.paid")),
            v1::Paid::Sample => Self::Sample,
            v1::Paid::View => Self::View,
            v1::Paid::Epoch => Self::Epoch,
            v1::Paid::Pose => Self::Pose,
        })
    }
}

impl From<EffectCost> for v1::EffectCost {
    fn from(EffectCost { effect, predicted_ms, measured_ms }: EffectCost) -> Self {
        Self { effect: v1::EffectKind::from(effect) as i32, predicted_ms, measured_ms }
    }
}

impl TryFrom<v1::EffectCost> for EffectCost {
    type Error = InvalidField;

    fn try_from(wire: v1::EffectCost) -> Result<Self, InvalidField> {
        let ms = |ms: Option<f64>, field| ms.map(|ms| duration_ms(ms, field)).transpose();
        Ok(Self {
            effect: known::<v1::EffectKind>(wire.effect, "effect_costs.effect")?.try_into()?,
            predicted_ms: ms(wire.predicted_ms, "effect_costs.predicted_ms")?,
            measured_ms: ms(wire.measured_ms, "effect_costs.measured_ms")?,
        })
    }
}

impl From<&EffectRow> for v1::EffectRow {
    fn from(row: &EffectRow) -> Self {
        let Causes { materials, lights, nodes, instances, sky } = row.causes.clone();
        Self {
            effect: v1::EffectKind::from(row.effect) as i32,
            materials,
            lights,
            nodes,
            instances,
            sky,
            paid: row.paid.iter().map(|paid| v1::Paid::from(*paid) as i32).collect(),
            predicted_ms: row.predicted_ms,
            bound: row.bound,
            on: row.on,
            why: row.why.clone(),
            measured_ms: row.measured_ms,
            saved_ms: row.saved_ms,
        }
    }
}

impl TryFrom<v1::EffectRow> for EffectRow {
    type Error = InvalidField;

    fn try_from(wire: v1::EffectRow) -> Result<Self, InvalidField> {
        let ms = |ms: Option<f64>, field| ms.map(|ms| duration_ms(ms, field)).transpose();
        let paid = |number| known::<v1::Paid>(number, "effect_plan.paid").and_then(Paid::try_from);
        if !(0.0..=1.0).contains(&wire.bound) {
            return Err(InvalidField::new(
                "effect_plan.bound",
                format!("must be 0 to 1, not {}", wire.bound),
            ));
        }
        Ok(Self {
            effect: known::<v1::EffectKind>(wire.effect, "effect_plan.effect")?.try_into()?,
            causes: Causes {
                materials: wire.materials,
                lights: wire.lights,
                nodes: wire.nodes,
                instances: wire.instances,
                sky: wire.sky,
            },
            paid: wire.paid.into_iter().map(paid).collect::<Result<_, _>>()?,
            predicted_ms: ms(wire.predicted_ms, "effect_plan.predicted_ms")?,
            bound: wire.bound,
            on: wire.on,
            why: wire.why,
            measured_ms: ms(wire.measured_ms, "effect_plan.measured_ms")?,
            saved_ms: ms(wire.saved_ms, "effect_plan.saved_ms")?,
        })
    }
}

/// The rows of a plan, for the wire.
pub(super) fn effect_rows(plan: &EffectPlan) -> Vec<v1::EffectRow> {
    plan.rows.iter().map(Into::into).collect()
}

/// A plan from the wire.
///
/// # Errors
/// The field of a row that is invalid.
pub(super) fn effect_plan(rows: Vec<v1::EffectRow>) -> Result<EffectPlan, InvalidField> {
    Ok(EffectPlan { rows: rows.into_iter().map(TryInto::try_into).collect::<Result<_, _>>()? })
}

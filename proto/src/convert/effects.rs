//! Conversions of the effect plan.

use argus_scene::InvalidField;
use argus_scene::effects::{Causes, EffectCost, EffectKind, EffectRow, Paid};

use super::duration_ms;
use super::enums::WireEnum;
use crate::v1;

impl From<EffectCost> for v1::EffectCost {
    fn from(EffectCost { effect, predicted_ms, measured_ms }: EffectCost) -> Self {
        Self { effect: effect.number(), predicted_ms, measured_ms }
    }
}

impl TryFrom<v1::EffectCost> for EffectCost {
    type Error = InvalidField;

    fn try_from(wire: v1::EffectCost) -> Result<Self, InvalidField> {
        let ms = |ms: Option<f64>, field| ms.map(|ms| duration_ms(ms, field)).transpose();
        Ok(Self {
            effect: EffectKind::from_number(wire.effect, "effect_costs.effect")?,
            predicted_ms: ms(wire.predicted_ms, "effect_costs.predicted_ms")?,
            measured_ms: ms(wire.measured_ms, "effect_costs.measured_ms")?,
        })
    }
}

impl From<&EffectRow> for v1::EffectRow {
    fn from(row: &EffectRow) -> Self {
        let Causes { materials, lights, nodes, instances, sky } = row.causes.clone();
        Self {
            effect: row.effect.number(),
            materials,
            lights,
            nodes,
            instances,
            sky,
            paid: row.paid.iter().map(|paid| paid.number()).collect(),
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
        let paid = |number| Paid::from_number(number, "effect_plan.paid");
        Ok(Self {
            effect: EffectKind::from_number(wire.effect, "effect_plan.effect")?,
            causes: Causes {
                materials: wire.materials,
                lights: wire.lights,
                nodes: wire.nodes,
                instances: wire.instances,
                sky: wire.sky,
            },
            paid: wire.paid.into_iter().map(paid).collect::<Result<_, _>>()?,
            predicted_ms: ms(wire.predicted_ms, "effect_plan.predicted_ms")?,
            bound: InvalidField::within("effect_plan.bound", wire.bound, 0.0..=1.0)?,
            on: wire.on,
            why: wire.why,
            measured_ms: ms(wire.measured_ms, "effect_plan.measured_ms")?,
            saved_ms: ms(wire.saved_ms, "effect_plan.saved_ms")?,
        })
    }
}

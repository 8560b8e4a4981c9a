//! What effects of light cost in views from triangles on this worker.

use std::collections::BTreeMap;

use argus_scene::Stage;
use argus_scene::effects::{EffectCost, EffectKind};

use crate::core::smooth::Smoothed;

/// Weight of the newest view in the cost by answered views.
const WEIGHT: f64 = 0.2;

/// Costs by effect, milliseconds as in [`EffectCost`].
#[derive(Debug, Default)]
pub(super) struct EffectMeter {
    /// By views that were rendered to measure them, with the pixels of the view.
    predicted: BTreeMap<EffectKind, (u64, f64)>,
    /// By views that were answered.
    measured: BTreeMap<EffectKind, Smoothed>,
}

impl EffectMeter {
    /// Records a view that was rendered to measure its effects. `pixels` are those that were rendered, with sub-pixels. Of
    /// several views, the one with most pixels counts; of equal ones the fastest, since other processes use the same cores.
    pub(super) fn predict(&mut self, pixels: u64, stages: &[Stage]) {
        for (effect, ms) in EffectCost::ms_by_effect(stages, pixels) {
            let known = self.predicted.entry(effect).or_insert((pixels, ms));
            if pixels > known.0 || (pixels == known.0 && ms < known.1) {
                *known = (pixels, ms);
            }
        }
    }

    /// Records a view that was answered, in full detail.
    pub(super) fn observe(&mut self, pixels: u64, stages: &[Stage]) {
        for (effect, ms) in EffectCost::ms_by_effect(stages, pixels) {
            self.measured.entry(effect).or_insert_with(|| Smoothed::new(WEIGHT)).observe(ms);
        }
    }

    /// What is known, by effect.
    pub(super) fn costs(&self) -> Vec<EffectCost> {
        let cost = |effect| EffectCost {
            effect,
            predicted_ms: self.predicted.get(&effect).map(|(_, ms)| *ms),
            measured_ms: self.measured.get(&effect).and_then(Smoothed::value),
        };
        let is_known = |cost: &EffectCost| cost.predicted_ms.or(cost.measured_ms).is_some();
        EffectKind::ALL.into_iter().map(cost).filter(is_known).collect()
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::effects::COST_PIXELS;

    use super::*;

    #[test]
    fn costs_are_those_of_the_largest_view_and_apart_from_those_of_answered_views() {
        let mut meter = EffectMeter::default();
        let stages = |shadows| [("shade view", 9.0), ("trace shadows", shadows), ("trace sky", 0.0)];
        let stages = |shadows| stages(shadows).map(|(name, ms)| Stage::new(name, ms));
        for (part, ms) in [(100, 1.0), (4, 3.0), (4, 2.0), (4, 5.0), (16, 0.1)] {
            meter.predict(COST_PIXELS / part, &stages(ms));
        }
        let shadows = |measured_ms| {
            vec![EffectCost { effect: EffectKind::Shadows, predicted_ms: Some(8.0), measured_ms }]
        };
        assert_eq!(meter.costs(), shadows(None), "a quarter of the pixels took 2 ms");
        // The first views of a size may wait for a compiler.
        for ms in [400.0, 12.0, 14.0] {
            meter.observe(2 * COST_PIXELS, &stages(ms));
        }
        assert_eq!(meter.costs(), shadows(Some(7.0)));
    }
}

//! What effects of light cost, over all workers.

use argus_scene::effects::{EffectCost, EffectKind};

use super::Workers;
use crate::core::smooth::median;

impl Workers {
    /// What each measured effect costs: the median over the workers, by their newest reports.
    pub(in crate::core) fn effect_costs(&self) -> Vec<EffectCost> {
        let reports = || self.iter().flat_map(|worker| &worker.report().effect_costs);
        medians(|effect| reports().filter(move |cost| cost.effect == effect))
    }
}

/// Medians of the costs `of` each effect. Effects without costs are absent.
fn medians<'a, I: Iterator<Item = &'a EffectCost>>(of: impl Fn(EffectKind) -> I) -> Vec<EffectCost> {
    let over = |effect| EffectCost {
        effect,
        predicted_ms: median(of(effect).filter_map(|cost| cost.predicted_ms).collect()),
        measured_ms: median(of(effect).filter_map(|cost| cost.measured_ms).collect()),
    };
    let is_known = |cost: &EffectCost| cost.predicted_ms.or(cost.measured_ms).is_some();
    EffectKind::ALL.into_iter().map(over).filter(is_known).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cost_of_an_effect_is_the_median_of_the_workers_that_measured_it() {
        let cost = |predicted_ms, measured_ms| EffectCost {
            effect: EffectKind::Shadows,
            predicted_ms: Some(predicted_ms),
            measured_ms,
        };
        let reported = [cost(3.0, None), cost(90.0, Some(5.0)), cost(4.0, None), cost(2.0, Some(7.0))];
        let of = |effect| reported.iter().filter(move |cost| cost.effect == effect);
        assert_eq!(medians(of), [cost(3.0, Some(5.0))]);
        assert_eq!(median(Vec::new()), None);
    }
}

//! The table: each rendering beside that of `auto`.

use anyhow::Result;
use argus_scene::effects::{EffectKind, EffectRow, SHARED_STAGE};
use argus_scene::{EffectPlan, LightEffects, Stage};
use serde_json::{Map, Value, json};

use super::judgement::{Against, Change, Found, Verdicts, bound_bytes};
use super::rendering::Images;
use super::stages::{ms_of, typical};
use super::subject::Subject;
use super::switches::{SWITCHABLE, is_on, neutral};
use crate::report;

impl Subject<'_> {
    /// The table's rows. `plan` is that of `auto`, whose bounds are judged, with predicted costs.
    pub(super) fn rows(&self, mut plan: EffectPlan) -> Result<Vec<Map<String, Value>>> {
        let of_auto = plan.light_effects();
        let auto = self.rendering(of_auto)?;
        plan.measured_in(&typical(&auto.views));
        let neutral = neutral(&plan);
        let mut rows = Vec::new();
        for (name, effects) in self.cases(&plan) {
            let rendering = self.rendering(effects)?;
            // Soft shadows beyond an `auto` without shadows add both.
            let changed: Vec<EffectKind> = SWITCHABLE
                .into_iter()
                .filter(|&effect| is_on(effects, effect) != is_on(of_auto, effect))
                .collect();
            let against = match changed.first() {
                None => Against::Itself,
                Some(&effect) if is_on(of_auto, effect) => Against::Off,
                Some(_) => Against::On,
            };
            let has_more = if against == Against::On { rendering } else { auto };
            let stages = [typical(&has_more.views), typical(&has_more.samples)];
            let alone = !of_auto.any() || !effects.any();
            let cost = |stages: &[Stage]| -> f64 {
                let own: f64 = changed.iter().filter_map(|effect| effect.ms_of(stages)).sum();
                own + if alone { ms_of(stages, SHARED_STAGE) } else { 0.0 }
            };
            let share = (cost(&stages[0]) / has_more.view_ms()).max(cost(&stages[1]) / has_more.sample_ms());
            if against == Against::On {
                for &effect in &changed {
                    if let Some(ms) = effect.ms_of(&stages[0]) {
                        plan.measured(effect, ms);
                    }
                }
            }
            let shown = Change::between(&auto.images.views, &rendering.images.views)?;
            let views = Change::between(&auto.judged.views, &rendering.judged.views)?;
            let by_rays = |effects: LightEffects| match neutral {
                Some(neutral) if !effects.any() => neutral,
                _ => effects,
            };
            let [before, after] = [of_auto, effects]
                .map(|effects| self.rendering(by_rays(effects)).map(|with| &with.judged.sample));
            let sample = Change::between(before?, after?)?;
            let judged = views.most.max(sample.most);
            let whole = Change::between(&auto.judged.sample, &rendering.judged.sample)?;
            let emits = plan.row(EffectKind::Emitters).is_some_and(|row| row.bound > 0.0);
            let noise = match emits && changed.contains(&EffectKind::Emitters) {
                true => {
                    let emits = if effects.emitters { rendering } else { auto };
                    let of = |images: &Images| {
                        images.views.iter().chain(&images.sample).cloned().collect::<Vec<_>>()
                    };
                    Change::between(&of(&emits.halved), &of(&emits.judged))?.most
                }
                false => 0,
            };
            let bound = bound_bytes(&plan, &changed);
            let found = Found { against, bound, changed: judged, noise, share };
            let verdicts = Verdicts::of(&found);
            // Of rows in which one effect is switched, with those that it needs.
            let of_plan = |cost: fn(&EffectRow) -> Option<f64>| match name.starts_with("auto w") {
                true => changed.iter().filter_map(|&effect| cost(plan.row(effect)?)).reduce(|a, b| a + b),
                false => None,
            };
            rows.push(report::row(json!({
                "scene": self.bench.scene.name,
                "row": name,
                "effects": effects.to_string(),
                "view_ms": rendering.view_ms(),
                "view_times_auto": rendering.view_ms() / auto.view_ms(),
                "sample_ms": rendering.sample_ms(),
                "sample_times_auto": rendering.sample_ms() / auto.sample_ms(),
                "light_ms": ms_of(&typical(&rendering.views), SHARED_STAGE),
                "predicted_ms": of_plan(|row| row.predicted_ms),
                "measured_ms": of_plan(|row| row.measured_ms),
                "saved_ms": of_plan(|row| row.saved_ms),
                "share": (against != Against::Itself).then_some(share),
                "bound_bytes": bound.filter(|_| against != Against::Itself),
                "changed_bytes": shown.most,
                "mean_bytes": shown.mean,
                "flip": shown.flip,
                "judged_bytes": judged,
                "path_bytes": whole.most.saturating_sub(sample.most),
                "noise_bytes": noise,
                "within": verdicts.within,
                "moves": verdicts.moves,
                "cheap": verdicts.cheap,
                "passed": verdicts.passed(),
            })));
        }
        Ok(rows)
    }
}

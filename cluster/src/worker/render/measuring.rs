//! Measures the cost of views from triangles, once a new sampler can render them, and what effects of light cost in them.
//!
//! Views that wait come first: the cost is measured as background work, a small view at a time, between which waiting views
//! are answered. These views also show what the set's effects cost. What effects that are off would cost is measured later,
//! where a sampler can render a view with them: where it has any effect of direct light. So with no effect, and for reflection
//! and indirect light that are off, it is not measured.

use std::time::Instant;

use argus_scene::{Detail, Frame, LightEffects, RenderError, Sampler};
use tracing::{debug, warn};

use super::{Renderer, ms_since, sub_pixels};
use crate::worker::effect_meter::EffectMeter;
use crate::worker::queue::{Background, Work};
use crate::worker::slices::Slices;
use crate::worker::view_costs::ViewKind;
use crate::worker::warm::{self, EffectTrial};

impl Renderer {
    /// Measures the cost of views from triangles with the present sampler, if there is one: the next one is measured when it
    /// is made.
    pub(super) fn measure_direct(&mut self) {
        self.measures_direct = false;
        let (Some(scene), Some(set)) = (self.scene.clone(), self.set.clone()) else { return };
        let Some(mut sampler) = self.sampler.take() else { return };
        let (began, rebuilt, mut slices) = (Instant::now(), self.rebuilt, Slices::default());
        let meter = self.meter.clone();
        // Those of an earlier device or scene are none of this one.
        meter.effects(|effects| *effects = EffectMeter::default());
        let measured = self.guarded(|own| {
            let queue = own.queue.clone();
            let mut between = |sampler: &mut dyn Sampler| {
                slices.end();
                queue.give_way(slices.last(), true, |work| match work {
                    Work::Pixels(tasks) => own.pixels_by(Some(&mut *sampler), tasks),
                    Work::Direct(tasks) => own.direct_by(Some(&mut *sampler), tasks),
                    Work::Views(tasks) => own.views(tasks),
                    _ => {}
                });
                slices.begin();
            };
            for (kind, detail) in [(ViewKind::Direct, Detail::Full), (ViewKind::FewRays, Detail::FewRays)] {
                let mut seen = |frame: &Frame| {
                    if detail == Detail::Full {
                        meter.effects(|effects| effects.predict(sub_pixels(frame), &frame.stages));
                    }
                };
                let cost =
                    warm::direct_cost(sampler.as_mut(), &scene, &set, detail, &mut seen, &mut between)?;
                debug!(?kind, ?cost, "views from triangles measured");
                // At once, since views wait for prices.
                meter.set_cost(kind, cost);
            }
            Ok(Vec::<Result<(), RenderError>>::new())
        });
        // If the device was lost meanwhile, the sampler is useless.
        if self.rebuilt == rebuilt {
            self.sampler = Some(sampler);
        }
        if let Err(error) = measured {
            warn!(%error, "views from triangles cannot be measured");
        }
        debug!(ms = ms_since(began), %slices, "prices of views from triangles are known");
        self.measures_effects = true;
    }

    /// Queues the measurement of effects, once prices are known and no better light is being prepared. No decision needs it, so
    /// it never takes cores from either.
    pub(super) fn seek_effects(&mut self) {
        let (true, false, false, Some(set)) =
            (self.measures_effects, self.measures_direct, self.light_rises, &self.set)
        else {
            return;
        };
        self.measures_effects = false;
        // Views for prices have shown what the set's effects cost in its first light.
        if set.effects != LightEffects::ALL {
            self.queue.push_background(Background::MeasureEffects(EffectTrial::Begin));
        }
        if self.light != set.first_light() {
            self.queue.push_background(Background::MeasureEffects(EffectTrial::Own));
        }
    }

    /// Measures what effects cost by one small view.
    pub(super) fn measure_effects(&mut self, trial: EffectTrial) {
        let (Some(scene), Some(set), true) = (self.scene.clone(), self.set.clone(), self.sampler.is_some())
        else {
            return;
        };
        let (began, light) = (Instant::now(), self.light);
        let frames = self.guarded(|own| {
            let frame = warm::view_of_effects(own.sampler()?, &scene, &set, trial, light)?;
            Ok(frame.into_iter().map(Ok).collect())
        });
        match frames {
            Err(error) => warn!(%error, "the cost of effects cannot be measured"),
            Ok(frames) => {
                for frame in frames.iter().flatten() {
                    self.meter.effects(|effects| effects.predict(sub_pixels(frame), &frame.stages));
                }
                let ms = ms_since(began);
                debug!(ms, ?trial, measured = frames.len(), "cost of effects measured");
                if trial == EffectTrial::Begin && !frames.is_empty() && warm::is_larger_quick(ms) {
                    self.queue.push_background(Background::MeasureEffects(EffectTrial::All));
                }
            }
        }
    }
}

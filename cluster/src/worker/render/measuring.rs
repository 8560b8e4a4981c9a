//! Measures the cost of views from triangles, once a new sampler can render them.
//!
//! Views that wait come first: the cost is measured as background work, a small view at a time, between which waiting views
//! are answered.

use std::time::Instant;

use argus_scene::{Detail, RenderError, Sampler};
use tracing::{debug, warn};

use super::{Renderer, ms_since};
use crate::worker::meter::ViewKind;
use crate::worker::queue::Work;
use crate::worker::slices::Slices;
use crate::worker::warm;

impl Renderer {
    /// Measures the cost of views from triangles with the present sampler, if there is one: the next one is measured when it
    /// is made.
    pub(super) fn measure_direct(&mut self) {
        self.measures_direct = false;
        let (Some(scene), Some(set)) = (self.scene.clone(), self.set.clone()) else { return };
        let Some(mut sampler) = self.sampler.take() else { return };
        let (began, rebuilt, mut slices) = (Instant::now(), self.rebuilt, Slices::default());
        let meter = self.meter.clone();
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
                let cost = warm::direct_cost(sampler.as_mut(), &scene, &set, detail, &mut between)?;
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
    }
}

//! Direct views that no client waits for, in slices between which waiting views are answered.

use std::sync::Arc;
use std::time::Instant;

use argus_scene::RenderError;
use tracing::debug;

use super::{Renderer, ms_since};
use crate::worker::claim::Batch;
use crate::worker::meter::Kind;
use crate::worker::queue::{SlicedTask, Work};
use crate::worker::slices::Slices;

impl Renderer {
    /// Renders a view in slices. It is cancelled if its caller gives up, or if work waits that does not go between slices.
    pub(super) fn sliced(&mut self, SlicedTask { job, claimed, reply }: SlicedTask) {
        let batch = Arc::new(Batch::default());
        if !claimed.join(&batch) {
            return;
        }
        if self.sampler.is_none() {
            // It is being made, or will be for the first view. Nobody waits for this one.
            let _ = reply.send(Err(RenderError::Cancelled));
            return;
        }
        let (mut slices, mut began) = (Slices::default(), Instant::now());
        let started = began;
        let results = self.guarded(|own| {
            let rebuilt = own.rebuilt;
            let none = || RenderError::Internal("no sampler".to_owned());
            let mut sampler = own.sampler.take().ok_or_else(none)?;
            let queue = own.queue.clone();
            let frame = sampler.render_view_in_slices(&job, &batch.cancel, &mut |sampler, _| {
                slices.end();
                let gave_way = Instant::now();
                queue.give_way(slices.last(), true, |work| match work {
                    Work::Pixels(tasks) => own.pixels_by(Some(sampler), tasks),
                    Work::Direct(tasks) => own.direct_by(Some(sampler), tasks),
                    Work::Views(tasks) => own.views(tasks),
                    _ => {}
                });
                began += gave_way.elapsed();
                slices.begin();
                if own.rebuilt != rebuilt || queue.has_urgent_work() {
                    batch.cancel.cancel();
                }
            });
            if own.rebuilt != rebuilt {
                let reason = "the device was lost while views were composed between two slices of a view";
                return Err(RenderError::DeviceLost(reason.to_owned()));
            }
            own.sampler = Some(sampler);
            Ok(vec![frame])
        });
        slices.end();
        debug!(%slices, ms = ms_since(started), "a view was rendered in slices");
        if results.as_ref().is_ok_and(|frames| frames.iter().all(Result::is_ok)) {
            // It is a sample of later views.
            let took = began.elapsed();
            self.meter.add(Kind::Sample, 1, took, took);
        }
        let missing = || Err(RenderError::Internal("a result is missing".to_owned()));
        let frame = results.and_then(|frames| frames.into_iter().next().unwrap_or_else(missing));
        // The caller may have given up.
        let _ = reply.send(frame);
    }
}

//! Uploads samples to the compositor, in slices and before views need them, and releases unused ones.

use std::sync::Arc;
use std::time::Instant;

use argus_scene::{Compositor, RenderError, Sample, SampleId, SampleSet, SampleSetInfo, Scene};
use tracing::{debug, warn};

use super::{Amount, Held, Renderer, ms_since};
use crate::core::quality::Cost;
use crate::worker::claim::Batch;
use crate::worker::queue::{BackendCosts, Background, Work};
use crate::worker::slices::Slices;
use crate::worker::view_costs::ViewKind;
use crate::worker::warm;

/// The channel for a result.
type Reply<T> = tokio::sync::oneshot::Sender<Result<T, RenderError>>;

impl Renderer {
    /// Measures the cost of views from samples, unless that was measured or the compositor was used before, and the
    /// visibility backends if requested. The result is sent after the samples that are queued for the compositor:
    /// once the coordinator knows the cost, it may order views from them.
    pub(super) fn measure(&mut self, info: &Arc<SampleSetInfo>, backends: bool, reply: Reply<BackendCosts>) {
        let warp_cost = match std::mem::replace(&mut self.is_measured, true) {
            true => None,
            false => {
                self.measure_frames(info);
                self.warm_compositor(info)
            }
        };
        let backend_costs = match backends {
            true => self.sampler().and_then(|sampler| sampler.measure_backends(info)),
            false => Ok(BackendCosts::new()),
        };
        self.upload_waiting();
        self.queue.push_background(Background::Measured { warp_cost, backend_costs, reply });
    }

    /// Queues the samples that arrived before the compositor was used, now that it is.
    pub(super) fn upload_waiting(&mut self) {
        self.is_warm = true;
        for (info, sample) in std::mem::take(&mut self.unheld) {
            if let Some(sample) = sample.upgrade() {
                self.queue.push_background(Background::Hold { info, sample, reply: None });
            }
        }
    }

    /// Makes the compositor's programs, and measures views from samples. Answers views from triangles meanwhile.
    fn warm_compositor(&mut self, info: &Arc<SampleSetInfo>) -> Option<Cost> {
        let scene = self.scene.clone()?;
        let sets = self.small_sets(&scene, info)?;
        let began = Instant::now();
        let cost =
            self.composing(|compositor, between| warm::compositor(compositor, &scene, info, sets, between));
        debug!(ms = ms_since(began), ?cost, "views from samples measured");
        cost.flatten()
    }

    /// Calls the compositor. Whenever the call pauses, views from triangles are answered, and light that is ready is taken. `None` if
    /// it failed.
    pub(super) fn composing<T>(
        &mut self,
        call: impl FnOnce(&mut dyn Compositor, &mut dyn FnMut()) -> Result<T, RenderError>,
    ) -> Option<T> {
        let (mut slices, mut result) = (Slices::default(), None);
        let called = self.guarded(|own| {
            own.compositor()?;
            let rebuilt = own.rebuilt;
            let none = || RenderError::Internal("no compositor".to_owned());
            let mut compositor = own.compositor.take().ok_or_else(none)?;
            let queue = own.queue.clone();
            let called = call(compositor.as_mut(), &mut || {
                slices.end();
                queue.give_way(slices.last(), false, |work| match work {
                    Work::Pixels(tasks) => own.pixels(tasks),
                    Work::Direct(tasks) => own.direct(tasks),
                    _ => {}
                });
                // Programs of a software driver take many seconds. Views get better light meanwhile.
                own.prepare_light();
                slices.begin();
            });
            // If the device was lost meanwhile, the compositor is useless.
            if own.rebuilt == rebuilt {
                own.compositor = Some(compositor);
            }
            result = Some(called?);
            Ok(Vec::<Result<(), RenderError>>::new())
        });
        debug!(%slices, ok = called.is_ok(), "the compositor was called in slices");
        result
    }

    /// Renders the small samples from which views are measured.
    fn small_sets(&mut self, scene: &Scene, info: &Arc<SampleSetInfo>) -> Option<[SampleSet; 2]> {
        let visibility = self.queue.usual_visibility();
        let set = |side| {
            let job = warm::small_samples(scene, info, visibility, side);
            let mut began = Instant::now();
            let samples = self.samples_in_slices(&job, &Batch::default(), &mut began);
            let samples = samples.and_then(|samples| samples.into_iter().collect::<Result<Vec<Sample>, _>>());
            let samples = samples.inspect_err(|error| warn!(%error, "views from samples cannot be measured"));
            Some(SampleSet { info: job.info, samples: samples.ok()?.into_iter().map(Arc::new).collect() })
        };
        let [small, large] = warm::SIDES.map(set);
        Some([small?, large?])
    }

    /// Does a slice of background work, and queues the rest.
    pub(super) fn background(&mut self, work: Background) {
        match work {
            Background::MeasureDirect => self.measure_direct(),
            Background::MeasureEffects(trial) => self.measure_effects(trial),
            Background::FillLight => self.fill_light(),
            Background::Sliced(task) => self.sliced(task),
            Background::Measured { warp_cost, backend_costs, reply } => {
                self.meter.set_cost(ViewKind::Warp, warp_cost);
                // The receiver is gone if a newer assignment arrived.
                let _ = reply.send(backend_costs);
            }
            Background::Hold { info, sample, reply } => {
                let is_wanted = reply.as_ref().is_none_or(|reply| !reply.is_closed());
                if is_wanted && !self.upload_slice(&info, &sample) {
                    return self.queue.put_back(Background::Hold { info, sample, reply });
                }
                if !is_wanted
                    && !self.held.contains_key(&sample.id)
                    && let Some(compositor) = &mut self.compositor
                {
                    // A part of it was uploaded, and takes memory.
                    compositor.release(&[sample.id]);
                }
                if let Some(reply) = reply {
                    // The caller may have given up.
                    let _ = reply.send(());
                }
            }
        }
    }

    /// Uploads a slice of a sample to the compositor. Returns whether that was the last one. If the compositor's
    /// memory is full, the sample is uploaded when a view needs it.
    fn upload_slice(&mut self, info: &Arc<SampleSetInfo>, sample: &Arc<Sample>) -> bool {
        if !self.is_warm {
            self.unheld.retain(|(_, sample)| sample.strong_count() > 0);
            self.unheld.push((info.clone(), Arc::downgrade(sample)));
            return true;
        }
        let (began, mut is_held) = (Instant::now(), true);
        let held = self.guarded(|own| {
            is_held = own.hold(info, std::slice::from_ref(sample), Amount::Slice)?;
            Ok(Vec::<Result<(), RenderError>>::new())
        });
        debug!(ms = ms_since(began), ok = held.is_ok(), is_held, "slice of a sample uploaded");
        is_held
    }

    /// Uploads samples to the compositor, all or a slice. Releases samples that the store dropped. Returns whether
    /// the compositor holds all of `needed`.
    pub(super) fn hold(
        &mut self,
        info: &Arc<SampleSetInfo>,
        needed: &[Arc<Sample>],
        amount: Amount,
    ) -> Result<bool, RenderError> {
        let gone: Vec<SampleId> =
            self.held.iter().filter(|(_, held)| held.sample.strong_count() == 0).map(|(id, _)| *id).collect();
        if !gone.is_empty() {
            self.compositor()?.release(&gone);
            self.held.retain(|id, _| !gone.contains(id));
        }
        let is_held = |sample: &Arc<Sample>| {
            let Some(held) = self.held.get(&sample.id) else { return false };
            // A held sample with more faces serves the same views.
            let has_more = |held: &Sample| held.faces != sample.faces && held.faces.contains(sample.faces);
            std::ptr::eq(held.sample.as_ptr(), Arc::as_ptr(sample))
                || held.sample.upgrade().is_some_and(|held| has_more(&held))
        };
        let used = self.batches;
        let samples: Vec<Arc<Sample>> = needed.iter().filter(|s| !is_held(s)).cloned().collect();
        for sample in needed {
            if let Some(held) = self.held.get_mut(&sample.id) {
                held.used = used;
            }
        }
        if samples.is_empty() {
            return Ok(true);
        }
        let set = SampleSet { info: info.clone(), samples };
        loop {
            let compositor = self.compositor()?;
            let is_held = match amount {
                Amount::All => compositor.hold(&set).map(|()| true),
                Amount::Slice => compositor.hold_slice(&set),
            };
            match is_held {
                Ok(true) => break,
                Ok(false) => return Ok(false),
                Err(error) => {
                    let full = matches!(error, RenderError::OutOfMemory(_));
                    let Some(oldest) = self.least_recently_used().filter(|_| full) else { return Err(error) };
                    self.compositor()?.release(&[oldest]);
                    self.held.remove(&oldest);
                }
            }
        }
        self.held.extend(
            set.samples.iter().map(|sample| (sample.id, Held { sample: Arc::downgrade(sample), used })),
        );
        Ok(true)
    }

    /// The least recently used sample that this batch does not need.
    fn least_recently_used(&self) -> Option<SampleId> {
        let unused = self.held.iter().filter(|(_, held)| held.used < self.batches);
        unused.min_by_key(|(id, held)| (held.used, **id)).map(|(id, _)| *id)
    }

    /// Releases dropped samples, and all samples if this worker is a sampler that has not composed for a while.
    pub(super) fn tidy(&mut self) {
        if self.tidied.elapsed() < self.rest_after / 4 {
            return;
        }
        self.tidied = Instant::now();
        let none = !self.role.composites() && self.composed.elapsed() >= self.rest_after;
        let gone = |held: &Held| none || held.sample.strong_count() == 0;
        let gone: Vec<SampleId> =
            self.held.iter().filter(|(_, held)| gone(held)).map(|(id, _)| *id).collect();
        if let Some(compositor) = self.compositor.as_mut().filter(|_| !gone.is_empty()) {
            compositor.release(&gone);
            self.held.retain(|id, _| !gone.contains(id));
            debug!(released = gone.len(), held = self.held.len(), "samples released");
        }
        self.health.holds(self.held.len());
    }
}

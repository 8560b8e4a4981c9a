//! What the compositor holds: samples are taken up ahead of views, in slices, and given up when nothing uses them.

use std::sync::Arc;
use std::time::Instant;

use argus_scene::{RenderError, Sample, SampleId, SampleSet, SampleSetInfo, Scene};
use tracing::{debug, warn};

use super::{Held, Most, Renderer, ms_since};
use crate::core::quality::Cost;
use crate::worker::claim::Batch;
use crate::worker::meter::Kind;
use crate::worker::queue::{BackendCosts, Background, Work};
use crate::worker::slices::Slices;
use crate::worker::warm;

/// Where a result goes.
type Reply<T> = tokio::sync::oneshot::Sender<Result<T, RenderError>>;

impl Renderer {
    /// Measures what a view from samples costs, if the compositor has not been used yet, and the visibility backends. It is
    /// told once the compositor has taken up what came before, since views from samples may be ordered from then on.
    pub(super) fn measure(&mut self, info: &Arc<SampleSetInfo>, backends: bool, reply: Reply<BackendCosts>) {
        let warp_cost = match std::mem::replace(&mut self.is_measured, true) {
            true => None,
            false => self.warm_compositor(info),
        };
        let backend_costs = match backends {
            true => self.sampler().and_then(|sampler| sampler.measure_backends(info)),
            false => Ok(BackendCosts::new()),
        };
        self.warms_up();
        self.queue.push_background(Background::Measured { warp_cost, backend_costs, reply });
    }

    /// The compositor composes views from now on: what came before is taken up when nothing else is to be done.
    pub(super) fn warms_up(&mut self) {
        self.is_warm = true;
        for (info, sample) in std::mem::take(&mut self.unheld) {
            if let Some(sample) = sample.upgrade() {
                self.queue.push_background(Background::TakeUp { info, sample, reply: None });
            }
        }
    }

    /// Has the compositor's programs made, and measures views from samples. Views from triangles are answered meanwhile.
    fn warm_compositor(&mut self, info: &Arc<SampleSetInfo>) -> Option<Cost> {
        let scene = self.scene.clone()?;
        let sets = self.small_sets(&scene, info)?;
        let (began, mut slices, mut cost) = (Instant::now(), Slices::default(), None);
        let warmed = self.guarded(|own| {
            own.compositor()?;
            let rebuilt = own.rebuilt;
            let none = || RenderError::Internal("no compositor".to_owned());
            let mut compositor = own.compositor.take().ok_or_else(none)?;
            let queue = own.queue.clone();
            let measured = warm::compositor(compositor.as_mut(), &scene, info, sets, &mut || {
                slices.end();
                queue.give_way(slices.last(), false, |work| match work {
                    Work::Pixels(tasks) => own.pixels(tasks),
                    Work::Direct(tasks) => own.direct(tasks),
                    _ => {}
                });
                slices.begin();
            });
            // One of a device that was given up meanwhile is of no use.
            if own.rebuilt == rebuilt {
                own.compositor = Some(compositor);
            }
            cost = measured?;
            Ok(Vec::<Result<(), RenderError>>::new())
        });
        debug!(ms = ms_since(began), %slices, ?cost, ok = warmed.is_ok(), "compositor measured");
        cost
    }

    /// Renders the small samples by which views from samples are measured.
    fn small_sets(&mut self, scene: &Scene, info: &Arc<SampleSetInfo>) -> Option<[SampleSet; 2]> {
        let visibility = self.queue.usual_visibility();
        let set = |side| {
            let job = warm::small_samples(scene, info, visibility, side);
            let mut began = Instant::now();
            let samples = self.samples_in_slices(&job, &Batch::default(), &mut began);
            let samples = samples.and_then(|samples| samples.into_iter().collect::<Result<Vec<Sample>, _>>());
            let samples = samples.inspect_err(|error| warn!(%error, "views from samples are not measured"));
            Some(SampleSet { info: job.info, samples: samples.ok()?.into_iter().map(Arc::new).collect() })
        };
        let [small, large] = warm::SIDES.map(set);
        Some([small?, large?])
    }

    /// Does a slice of background work, and puts the rest back.
    pub(super) fn background(&mut self, work: Background) {
        match work {
            Background::Measured { warp_cost, backend_costs, reply } => {
                self.meter.set_cost(Kind::View, warp_cost);
                // The receiver is gone once the assignment is overtaken.
                let _ = reply.send(backend_costs);
            }
            Background::TakeUp { info, sample, reply } => {
                let is_wanted = reply.as_ref().is_none_or(|reply| !reply.is_closed());
                if is_wanted && !self.take_up(&info, &sample) {
                    return self.queue.put_back(Background::TakeUp { info, sample, reply });
                }
                if !is_wanted
                    && !self.held.contains_key(&sample.id)
                    && let Some(compositor) = &mut self.compositor
                {
                    // What of it was taken up takes memory.
                    compositor.release(&[sample.id]);
                }
                if let Some(reply) = reply {
                    // A caller that gave up misses nothing.
                    let _ = reply.send(());
                }
            }
        }
    }

    /// Has the compositor take up a slice of a sample that views will ask for; returns whether that was the last one. Where
    /// the compositor is full, views take the sample up themselves.
    fn take_up(&mut self, info: &Arc<SampleSetInfo>, sample: &Arc<Sample>) -> bool {
        if !self.is_warm {
            self.unheld.retain(|(_, sample)| sample.strong_count() > 0);
            self.unheld.push((info.clone(), Arc::downgrade(sample)));
            return true;
        }
        let (began, mut is_held) = (Instant::now(), true);
        let held = self.guarded(|own| {
            is_held = own.hold(info, std::slice::from_ref(sample), Most::Slice)?;
            Ok(Vec::<Result<(), RenderError>>::new())
        });
        debug!(ms = ms_since(began), ok = held.is_ok(), is_held, "slice of a sample taken up ahead of views");
        is_held
    }

    /// Makes the compositor hold what views need, or a slice more of it, and no longer what the store has forgotten; returns
    /// whether it holds all.
    pub(super) fn hold(
        &mut self,
        info: &Arc<SampleSetInfo>,
        needed: &[Arc<Sample>],
        most: Most,
    ) -> Result<bool, RenderError> {
        let gone: Vec<SampleId> =
            self.held.iter().filter(|(_, held)| held.sample.strong_count() == 0).map(|(id, _)| *id).collect();
        if !gone.is_empty() {
            self.compositor()?.release(&gone);
            self.held.retain(|id, _| !gone.contains(id));
        }
        let is_held = |sample: &Arc<Sample>| {
            let Some(held) = self.held.get(&sample.id) else { return false };
            // One with more faces serves every view that this one serves.
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
            let is_held = match most {
                Most::All => compositor.hold(&set).map(|()| true),
                Most::Slice => compositor.hold_slice(&set),
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

    /// The sample that the compositor can do without for longest, none of this batch's.
    fn least_recently_used(&self) -> Option<SampleId> {
        let unused = self.held.iter().filter(|(_, held)| held.used < self.batches);
        unused.min_by_key(|(id, held)| (held.used, **id)).map(|(id, _)| *id)
    }

    /// Gives up samples that composing has not used for a while, where samples are this worker's work.
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

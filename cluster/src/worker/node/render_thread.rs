//! Submits work to the render thread, and awaits the results.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_proto::Fault;
use argus_proto::trace::{self, TARGET};
use argus_scene::{FaceMask, Frame, PixelJob, Pixels, RenderError, Sample, SampleId, SampleSetInfo, ViewJob};
use tokio::sync::{Notify, oneshot};
use tracing::{Span, debug_span};

use super::served_set::ServedSet;
use crate::core::{Report, Role};
use crate::worker::claim::claim;
use crate::worker::config::RETRY;
use crate::worker::policy::Waiting;
use crate::worker::queue::{
    BackendCosts, Background, PixelTask, Queue, Rendered, SampleTask, SlicedTask, ViewTask, Work,
};
use crate::worker::store::Store;

/// The render thread's queues, and the store of its samples.
pub(in crate::worker) struct RenderThread {
    queue: Arc<Queue>,
    store: Arc<Store>,
    served: Arc<ServedSet>,
    /// Requests an early report.
    news: Arc<Notify>,
}

impl RenderThread {
    pub(super) fn new(
        queue: Arc<Queue>,
        store: Arc<Store>,
        served: Arc<ServedSet>,
        news: Arc<Notify>,
    ) -> Self {
        Self { queue, store, served, news }
    }

    /// Makes the sampler, which every role needs.
    ///
    /// # Errors
    /// The error of making it.
    pub(in crate::worker) async fn prepare(&self, role: Role) -> Result<(), RenderError> {
        let info = self.served.set_to_render()?;
        let (reply, done) = oneshot::channel();
        self.queue.order(Work::Prepare { info, role, reply });
        done.await.unwrap_or_else(|_| Err(stopped()))
    }

    /// Measures the cost of views from samples. If `backends` is set, also measures the visibility backends and returns
    /// their costs.
    ///
    /// # Errors
    /// The error of a measurement.
    pub(in crate::worker) async fn measure(&self, backends: bool) -> Result<BackendCosts, RenderError> {
        let info = self.served.set_to_render()?;
        let (reply, done) = oneshot::channel();
        self.queue.order(Work::Measure { info, backends, reply });
        done.await.unwrap_or_else(|_| Err(stopped()))
    }

    /// Uploads a sample to the compositor before views need it, and then announces it to the coordinator.
    pub(in crate::worker) async fn hold(&self, info: Arc<SampleSetInfo>, sample: Arc<Sample>) {
        let id = sample.id;
        let (reply, done) = oneshot::channel();
        self.queue.push_background(Background::Hold { info, sample, reply: Some(reply) });
        // A stopped thread drops the reply. No view needs the sample then.
        let _ = done.await;
        self.store.announce(id);
        self.news.notify_one();
    }

    /// Renders a view from samples that are in the store. Dropping the future cancels the view.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if the queue is full; [`Fault::Unavailable`] if another scene is served meanwhile; else the error of
    /// rendering.
    pub(in crate::worker) async fn render_view(
        &self,
        job: ViewJob,
        info: Arc<SampleSetInfo>,
        samples: Vec<Arc<Sample>>,
        alone: bool,
    ) -> Result<Rendered, Fault> {
        let (reply, done) = oneshot::channel();
        let (waiting, claimed) = claim();
        let queued = Instant::now();
        let task = ViewTask { job, info: info.clone(), samples, alone, queued, claimed, reply };
        self.queue.push_view(task).map_err(|_| self.overloaded("views"))?;
        let rendered = done.await.unwrap_or_else(|_| Err(stopped()));
        drop(waiting);
        self.served.check_scene(&info)?;
        Ok(rendered?)
    }

    /// Renders a direct view that no client waits for, in slices between views. Dropping the future cancels it.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`] if other work needs the render thread; [`Fault::Unavailable`] if another scene is served meanwhile;
    /// else the error of rendering.
    pub(in crate::worker) async fn render_in_slices(
        &self,
        job: ViewJob,
        info: &Arc<SampleSetInfo>,
    ) -> Result<Frame, Fault> {
        let (reply, done) = oneshot::channel();
        let (waiting, claimed) = claim();
        self.queue.push_background(Background::Sliced(SlicedTask { job, claimed, reply }));
        let rendered = done.await.unwrap_or_else(|_| Err(stopped()));
        drop(waiting);
        self.served.check_scene(info)?;
        Ok(rendered?)
    }

    /// Renders a sample with these faces and stores it. Retries once after a lost device. Dropping the future cancels it.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if the queue is full; [`Fault::Unavailable`] if another set is served meanwhile; else the
    /// error of rendering.
    pub(in crate::worker) async fn render_sample(
        &self,
        sample: (SampleId, FaceMask),
        info: Arc<SampleSetInfo>,
        to_host: bool,
    ) -> Result<Arc<Sample>, Fault> {
        self.render_or_prefetch(sample, info, to_host, false).await
    }

    /// Renders a sample like [`Self::render_sample`], once the render thread has no other work. Does not announce it.
    ///
    /// # Errors
    /// Those of [`Self::render_sample`].
    pub(in crate::worker) async fn prefetch_sample(
        &self,
        sample: (SampleId, FaceMask),
        info: Arc<SampleSetInfo>,
        to_host: bool,
    ) -> Result<Arc<Sample>, Fault> {
        self.render_or_prefetch(sample, info, to_host, true).await
    }

    async fn render_or_prefetch(
        &self,
        (id, faces): (SampleId, FaceMask),
        info: Arc<SampleSetInfo>,
        to_host: bool,
        prefetch: bool,
    ) -> Result<Arc<Sample>, Fault> {
        // Part of the trace of the waiting view. A prefetched sample is part of no trace.
        let span = match Span::current().is_disabled() {
            true => Span::none(),
            false => debug_span!(target: TARGET, "render sample", %id),
        };
        let mut again = true;
        loop {
            let (reply, done) = oneshot::channel();
            let (waiting, claimed) = claim();
            // The result replaces the held sample, so it must have that one's faces too.
            let faces = faces.union(self.store.faces(id));
            let task = SampleTask { id, faces, info: info.clone(), to_host, prefetch, claimed, reply };
            self.queue.push_sample(task).map_err(|_| self.overloaded("samples"))?;
            let rendered = done.await.unwrap_or_else(|_| Err(stopped()));
            drop(waiting);
            match rendered {
                Err(RenderError::DeviceLost(_)) if again => again = false,
                rendered => {
                    self.served.check(&info)?;
                    let rendered = rendered?;
                    if !rendered.faces.contains(faces) {
                        let reason = format!("the sampler left out a requested face of sample {id}");
                        return Err(RenderError::Internal(reason).into());
                    }
                    let sample = match prefetch {
                        true => self.store.insert_quietly(rendered),
                        false => self.store.insert(rendered),
                    };
                    trace::stages(&span, sample.stages.iter().map(|stage| (stage.name.as_str(), stage.ms)));
                    if !prefetch {
                        // An early report lets the coordinator plan with the sample at once.
                        self.news.notify_one();
                    }
                    return Ok(sample);
                }
            }
        }
    }

    /// Traces pixels of a view. Retries once after a lost device. Dropping the future cancels it.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if the queue is full; [`Fault::Unavailable`] if another scene is served meanwhile; else the error of
    /// rendering.
    pub(in crate::worker) async fn render_pixels(&self, job: &PixelJob) -> Result<Pixels, Fault> {
        let (mut again, (set, _)) = (true, self.served.set()?);
        loop {
            let (reply, done) = oneshot::channel();
            let (waiting, claimed) = claim();
            let task = PixelTask { job: job.clone(), claimed, reply };
            self.queue.push_pixels(task).map_err(|_| self.overloaded("pixels"))?;
            let rendered = done.await.unwrap_or_else(|_| Err(stopped()));
            drop(waiting);
            match rendered {
                Err(RenderError::DeviceLost(_)) if again => again = false,
                rendered => {
                    self.served.check_scene(&set)?;
                    let pixels = rendered?;
                    let measured = pixels.stages.iter().map(|stage| (stage.name.as_str(), stage.ms));
                    trace::stages(&Span::current(), measured);
                    return Ok(pixels);
                }
            }
        }
    }

    /// Work that is queued or in progress.
    pub(in crate::worker) fn backlog(&self) -> Waiting {
        self.queue.backlog()
    }

    /// How long the render thread has been at its present work; zero while it waits.
    pub(in crate::worker) fn busy_for(&self) -> Duration {
        self.queue.busy_for()
    }

    /// Stops the render thread after its present work. Queued work is dropped.
    pub(in crate::worker) fn stop(&self) {
        self.queue.order(Work::Stop);
    }

    /// Fills in the queues and the held samples of a report.
    pub(super) fn fill(&self, report: &mut Report) {
        let backlog = self.backlog();
        report.queued_samples = backlog.samples as u32;
        report.queued_views = (backlog.warped + backlog.direct + backlog.pixels) as u32;
        report.piece_ms = self.queue.at_piece_for().as_secs_f64() * 1e3;
        report.held = self.store.ids();
        report.partial = self.store.partial();
        report.sample_bytes = self.store.largest();
        report.light = self.queue.light();
    }

    fn overloaded(&self, what: &str) -> Fault {
        let Waiting { samples, warped, direct, .. } = self.backlog();
        let views = warped + direct;
        let what = format!("the queue for {what} is full: {samples} samples and {views} views wait");
        Fault::Overloaded { what, retry_after: RETRY }
    }
}

/// The error of work that a stopped render thread dropped.
fn stopped() -> RenderError {
    RenderError::DeviceLost("the worker is shutting down".to_owned())
}

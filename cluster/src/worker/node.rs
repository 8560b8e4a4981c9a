//! What the parts of a worker share: what it was told, what it holds, and the way to its render thread.

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use argus_proto::trace::{self, TARGET};
use argus_proto::{Fault, v1};
use argus_scene::{
    FaceMask, InvalidField, Limits, PixelJob, Pixels, RenderError, Sample, SampleId, SampleSetInfo, Scene,
    SceneState, SpecificationHash, Version, ViewJob, Visibility,
};
use parking_lot::Mutex;
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore, oneshot, watch};
use tracing::{Span, debug_span};

use super::claim::claim;
use super::config::{Config, RETRY};
use super::fetches::Fetches;
use super::frame_memory::FrameMemory;
use super::health::Health;
use super::histories::Histories;
use super::meter::Meter;
use super::policy::{self, Waiting};
use super::prefetches::Prefetches;
use super::probes::Probes;
use super::queue::{BackendCosts, Background, PixelTask, Queue, Rendered, SampleTask, ViewTask, Work};
use super::store::Store;
use crate::core::{Hello, Report, Role};
use crate::net::Channels;
use crate::sealed::{Kind, RedeemedSerials, SealKey};

/// Versions whose sets are kept: those of views in work, and the next ones.
const VERSIONS_AT_HAND: usize = 16;

/// What the coordinator told and what has taken effect.
#[derive(Debug, Default)]
struct Told {
    set: Option<Arc<SampleSetInfo>>,
    /// The same set in the versions that were asked for last, newest first.
    versions: VecDeque<Arc<SampleSetInfo>>,
    scene: Option<Arc<Scene>>,
    limits: Limits,
    acting: Option<Role>,
    /// Whether that is by the word of a coordinator that is still there.
    is_led: bool,
    applied: u64,
    leaving: bool,
    /// What was measured for the newest assignment, if it asked for that.
    backend_costs: BackendCosts,
    /// It is not settled how triangles are seen.
    visibility_is_open: bool,
}

/// A worker.
pub(super) struct Node {
    pub(super) config: Config,
    pub(super) hello: Hello,
    pub(super) channels: Channels,
    pub(super) store: Arc<Store>,
    pub(super) fetches: Fetches,
    pub(super) prefetches: Prefetches,
    /// Rings when a report is due before its time.
    pub(super) news: Notify,
    /// Turns of packing frames and samples.
    pub(super) packing: Semaphore,
    /// Memory for frames.
    pub(super) frame_memory: FrameMemory,
    /// What the last frames of sessions left.
    pub(super) histories: Histories,
    /// How well errors were predicted.
    pub(super) probes: Probes,
    queue: Arc<Queue>,
    meter: Arc<Meter>,
    pub(super) health: Arc<Health>,
    told: Mutex<Told>,
    /// Addresses of workers that seem to hang.
    pub(super) suspected: watch::Sender<HashSet<String>>,
    /// By which clients show that they were sent here, and the tickets that were shown.
    door: Mutex<Option<Door>>,
    /// Places of clients that fetch frames: half of the queue's, so that nobody's hoard of tickets keeps the coordinator's
    /// own orders out.
    fetching: Arc<Semaphore>,
    /// Highest term seen.
    term: AtomicU64,
    /// Requests in work.
    active: AtomicUsize,
}

/// How clients get in.
struct Door {
    key: SealKey,
    shown: RedeemedSerials,
}

/// A request in work, as long as it lives.
pub(super) struct Active(Arc<Node>);

impl Drop for Active {
    fn drop(&mut self) {
        self.0.active.fetch_sub(1, Ordering::AcqRel);
    }
}

impl Node {
    pub(super) fn new(
        config: Config,
        hello: Hello,
        queue: Arc<Queue>,
        store: Arc<Store>,
        meter: Arc<Meter>,
        health: Arc<Health>,
    ) -> Arc<Self> {
        Arc::new(Self {
            packing: Semaphore::new(policy::threads_beside(hello.cores)),
            fetching: Arc::new(Semaphore::new((config.max_queued_views / 2).max(1))),
            frame_memory: FrameMemory::new(config.frame_bytes),
            histories: Histories::new(config.history_bytes),
            probes: Probes::default(),
            channels: Channels::new(config.connect_timeout, config.security.clone(), config.network.clone()),
            config,
            hello,
            store,
            fetches: Fetches::default(),
            prefetches: Prefetches::default(),
            news: Notify::new(),
            queue,
            meter,
            health,
            told: Mutex::default(),
            suspected: watch::Sender::default(),
            door: Mutex::new(None),
            term: AtomicU64::new(0),
            active: AtomicUsize::new(0),
        })
    }

    /// What comes from another worker, unless that one seems to hang, or begins to meanwhile.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] then; else as `answer`.
    pub(super) async fn unless_suspected<T>(
        &self,
        address: &str,
        answer: impl Future<Output = Result<T, Fault>>,
    ) -> Result<T, Fault> {
        let mut suspected = self.suspected.subscribe();
        tokio::select! {
            answer = answer => answer,
            // The sender lives as long as this worker.
            _ = suspected.wait_for(|all| all.contains(address)) => {
                Err(Fault::Unavailable(format!("{address} seems to hang")))
            }
        }
    }

    /// Takes a term in.
    ///
    /// # Errors
    /// [`Fault::StaleTerm`] for one lower than the highest seen.
    pub(super) fn check_term(&self, theirs: u64) -> Result<(), Fault> {
        let ours = self.term.fetch_max(theirs, Ordering::AcqRel);
        if theirs < ours { Err(Fault::StaleTerm { ours, theirs }) } else { Ok(()) }
    }

    /// Takes in the key of an assignment: clients that were sent here show tickets that it seals.
    pub(super) fn open_door(&self, key: Option<SealKey>) {
        let mut door = self.door.lock();
        if door.as_ref().map(|door| &door.key) != key.as_ref() {
            *door = key.map(|key| Door { key, shown: RedeemedSerials::default() });
        }
    }

    /// What a ticket says, and the key for its receipt.
    ///
    /// # Errors
    /// `ticket` where it is not this worker's, of its present leadership, or was shown before.
    pub(super) fn admit(&self, sealed: &v1::Sealed) -> Result<(v1::RedirectTicket, SealKey), InvalidField> {
        let refused = |reason: &str| InvalidField::new("ticket", reason);
        let stranger = || refused("was not given out for this worker by who leads now");
        let key = self.door.lock().as_ref().map(|door| door.key.clone());
        let key = key.ok_or_else(|| refused("clients are not sent to this worker"))?;
        // Strangers' bytes are hashed, too, and not while others wait for the lock.
        let ticket: v1::RedirectTicket = key.open(Kind::RedirectTicket, sealed).ok_or_else(stranger)?;
        let mut door = self.door.lock();
        let door = door.as_mut().filter(|door| door.key == key).ok_or_else(stranger)?;
        match door.shown.first_time(ticket.serial) {
            true => Ok((ticket, key)),
            false => Err(refused("was shown before: each is good once")),
        }
    }

    /// Whether clients are sent here.
    pub(super) fn has_door(&self) -> bool {
        self.door.lock().is_some()
    }

    /// A place of a client that fetches its frame.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if all are taken.
    pub(super) fn begin_fetch(self: &Arc<Self>) -> Result<OwnedSemaphorePermit, Fault> {
        self.fetching.clone().try_acquire_owned().map_err(|_| {
            let what = "as many clients as there are places for fetch frames here".to_owned();
            Fault::Overloaded { what, retry_after: RETRY }
        })
    }

    /// The set that is served.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] until the scene is there.
    pub(super) fn set(&self) -> Result<(Arc<SampleSetInfo>, Limits), Fault> {
        let told = self.told.lock();
        let set =
            told.set.clone().ok_or_else(|| Fault::Unavailable("the scene is not loaded yet".to_owned()))?;
        Ok((set, told.limits))
    }

    /// The set in a version. Samples of one version share it, so that what they have in common is compared by address. A
    /// coordinator that begins anew numbers its versions anew: samples that are held under the number of a version that is not
    /// known here may show something else, and are forgotten.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] until the scene is there; [`Fault::NotFound`] for another state of a scene that is held still.
    pub(super) fn set_in(&self, version: Version) -> Result<(Arc<SampleSetInfo>, Limits), Fault> {
        let (info, limits) = self.set_showing(version.state)?;
        let mut told = self.told.lock();
        if let Some(known) = told.versions.iter().find(|info| info.version == version) {
            return Ok((known.clone(), limits));
        }
        let info = Arc::new(SampleSetInfo { version, ..(*info).clone() });
        told.versions.retain(|known| known.version.number != version.number);
        self.store.forget_version(version.number);
        told.versions.push_front(info.clone());
        told.versions.truncate(VERSIONS_AT_HAND);
        Ok((info, limits))
    }

    /// The set as it shows a state of the scene, in whichever version: for what is rendered from triangles.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] until the scene is there; [`Fault::NotFound`] for another state of a scene that is held still.
    pub(super) fn set_showing(&self, state: SceneState) -> Result<(Arc<SampleSetInfo>, Limits), Fault> {
        let (set, limits) = self.set()?;
        if let Some(known) = self.told.lock().versions.iter().find(|info| info.version.state == state) {
            return Ok((known.clone(), limits));
        }
        if set.epoch_secs == 0.0 && state != set.version.state {
            let (asked, served) = (state.epoch, set.version.state.epoch);
            return Err(Fault::NotFound(format!("epoch {asked} is not served here, epoch {served} is")));
        }
        let scene =
            self.scene().ok_or_else(|| Fault::Unavailable("the scene is not loaded yet".to_owned()))?;
        let version = Version { state, ..set.version };
        Ok((Arc::new(set.at_version(&scene, version)), limits))
    }

    /// The scene that is loaded.
    pub(super) fn scene(&self) -> Option<Arc<Scene>> {
        self.told.lock().scene.clone()
    }

    /// Serves another set from now on; samples of the old one are forgotten. Whether another sampler is needed for it.
    pub(super) fn serve_set(&self, scene: &Arc<Scene>, set: SampleSetInfo, limits: Limits) -> bool {
        let mut told = self.told.lock();
        let set = Arc::new(set);
        // A sampler is made for one scene and one way to light it.
        let as_sampler = |set: &SampleSetInfo| (set.sub_samples, set.indirect);
        let same_sampler = told.set.as_deref().is_some_and(|old| as_sampler(old) == as_sampler(&set));
        let same_scene = told.scene.as_ref().is_some_and(|old| Arc::ptr_eq(old, scene));
        let new_sampler = !(same_scene && same_sampler);
        if new_sampler {
            told.scene = Some(scene.clone());
            self.queue.order(Work::Scene { scene: scene.clone(), set: set.clone() });
        }
        // Another version of the same set leaves the samples of this one as they are.
        let same = |old: &SampleSetInfo| SampleSetInfo { version: set.version, ..old.clone() } == *set;
        if !told.set.as_deref().is_some_and(same) {
            told.versions =
                if set.epoch_secs == 0.0 { VecDeque::from([set.clone()]) } else { VecDeque::new() };
            told.set = Some(set);
            self.store.clear();
            self.histories.clear();
        }
        told.limits = limits;
        new_sampler
    }

    /// Whether a set is rendered as the one that is served: what was rendered for an older one is of no use.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] where it is not.
    fn check_set(&self, info: &SampleSetInfo) -> Result<(), Fault> {
        let (served, _) = self.set()?;
        // All of the specification but the exposure, which lights have at each moment.
        let rendered_by = |set: &SampleSetInfo| {
            (set.scene, set.visibility, set.sampling, set.sub_samples, set.indirect, set.reflections)
        };
        match rendered_by(&served) == rendered_by(info) {
            true => Ok(()),
            false => Err(Fault::Unavailable("another sample set is served by now".to_owned())),
        }
    }

    /// Takes in whether it is settled how triangles are seen.
    pub(super) fn settle_visibility(&self, is_open: bool) {
        self.told.lock().visibility_is_open = is_open;
    }

    /// How views from triangles see them, of a set: as is settled for all samples, or else as is expected to be best here.
    pub(super) fn visibility_of(&self, info: &SampleSetInfo) -> Visibility {
        match self.told.lock().visibility_is_open {
            true => self.queue.usual_visibility(),
            false => info.visibility,
        }
    }

    /// The role it acts in.
    pub(super) fn acting(&self) -> Option<Role> {
        self.told.lock().acting
    }

    /// A role has taken effect by that assignment; `applied` 0: a new coordinator's first is awaited.
    pub(super) fn act(&self, role: Option<Role>, applied: u64) {
        let mut told = self.told.lock();
        told.acting = role.or(told.acting);
        told.applied = applied;
        told.is_led = applied > 0;
        drop(told);
        self.news.notify_one();
    }

    /// The coordinator is gone: what it told holds until another one, or itself, says something else.
    pub(super) fn lose_coordinator(&self) {
        self.told.lock().is_led = false;
    }

    /// Whether a coordinator is there that knows of the role.
    pub(super) fn is_led(&self) -> bool {
        self.told.lock().is_led
    }

    /// Says in the next report, which is due now, that it is about to leave.
    pub(super) fn leave(&self) {
        self.told.lock().leaving = true;
        self.news.notify_one();
    }

    /// Whether it is about to leave.
    pub(super) fn is_leaving(&self) -> bool {
        self.told.lock().leaving
    }

    /// How long the render thread has been at what it does now.
    pub(super) fn busy_for(&self) -> Duration {
        self.queue.busy_for()
    }

    /// The state of things.
    pub(super) fn report(&self) -> Report {
        let backlog = self.queue.backlog();
        let told = self.told.lock();
        let mut report = Report {
            applied: told.applied,
            queued_samples: backlog.samples as u32,
            queued_views: (backlog.warped + backlog.direct + backlog.pixels) as u32,
            held: self.store.ids(),
            partial: self.store.partial(),
            leaving: told.leaving,
            piece_ms: self.queue.at_piece_for().as_secs_f64() * 1e3,
            sample_bytes: self.store.largest(),
            backend_costs: told.backend_costs.clone(),
            probed: self.probes.found(),
            ..Report::default()
        };
        drop(told);
        self.meter.fill(&mut report);
        report
    }

    /// A sample came from another worker, and it took so long to unpack.
    pub(super) fn received(&self, unpacking: Duration) {
        self.meter.add_received(unpacking);
    }

    /// Whether a view, or a part of one, waits for the render thread or is in work.
    pub(super) fn has_views(&self) -> bool {
        let Waiting { warped, direct, pixels, .. } = self.backlog();
        warped + direct + pixels > 0
    }

    pub(super) fn backlog(&self) -> Waiting {
        self.queue.backlog()
    }

    /// Counts a request until what is returned is dropped.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] if too many are in work.
    pub(super) fn begin(self: &Arc<Self>) -> Result<Active, Fault> {
        let before = self.active.fetch_add(1, Ordering::AcqRel);
        let active = Active(self.clone());
        if before >= self.config.max_requests {
            let (what, retry_after) = (format!("{before} requests are in work here"), RETRY);
            return Err(Fault::Overloaded { what, retry_after });
        }
        Ok(active)
    }

    /// Whether no request is in work.
    pub(super) fn is_idle(&self) -> bool {
        self.requests() == 0
    }

    /// Requests in work.
    pub(super) fn requests(&self) -> usize {
        self.active.load(Ordering::Acquire)
    }

    /// Has all that a role needs.
    pub(super) async fn prepare(&self, role: Role) -> Result<(), RenderError> {
        let info = self.told_set()?;
        let (reply, done) = oneshot::channel();
        self.queue.order(Work::Prepare { info, role, reply });
        done.await.unwrap_or_else(|_| Err(stopped()))
    }

    fn told_set(&self) -> Result<Arc<SampleSetInfo>, RenderError> {
        self.told.lock().set.clone().ok_or_else(|| RenderError::Internal("no set yet".to_owned()))
    }

    /// Measures what a view from samples costs and, if `backends` are wanted, each way to see triangles: to be said in
    /// every report until the next assignment.
    pub(super) async fn measure(&self, backends: bool) -> Result<(), RenderError> {
        let info = self.told_set()?;
        let (reply, done) = oneshot::channel();
        self.queue.order(Work::Measure { info, backends, reply });
        let backend_costs = done.await.unwrap_or_else(|_| Err(stopped()))?;
        self.told.lock().backend_costs = backend_costs;
        Ok(())
    }

    /// Has the compositor hold a sample before views ask for it, and only then says that it is here.
    pub(super) async fn hold(&self, info: Arc<SampleSetInfo>, sample: Arc<Sample>) {
        let id = sample.id;
        let (reply, done) = oneshot::channel();
        self.queue.push_background(Background::TakeUp { info, sample, reply: Some(reply) });
        // A thread that stops takes nothing up; no view will ask for it.
        let _ = done.await;
        self.store.announce(id);
        self.news.notify_one();
    }

    /// Forgets what was measured: it was taken in.
    pub(super) fn forget_backend_costs(&self) {
        self.told.lock().backend_costs = BackendCosts::new();
    }

    /// Renders a view, its samples being at hand. Dropping the future takes it back.
    pub(super) async fn render_view(
        &self,
        job: ViewJob,
        info: Arc<SampleSetInfo>,
        samples: Vec<Arc<Sample>>,
        alone: bool,
    ) -> Result<Rendered, Fault> {
        let (reply, done) = oneshot::channel();
        let (waiting, claimed) = claim();
        let task = ViewTask { job, info, samples, alone, queued: Instant::now(), claimed, reply };
        self.queue.push_view(task).map_err(|_| self.overloaded("views"))?;
        let rendered = done.await.unwrap_or_else(|_| Err(stopped()));
        drop(waiting);
        Ok(rendered?)
    }

    /// Renders a sample with these faces and keeps it; after a lost device, once more. Dropping the future takes it back.
    pub(super) async fn render_sample(
        &self,
        sample: (SampleId, FaceMask),
        info: Arc<SampleSetInfo>,
        to_host: bool,
    ) -> Result<Arc<Sample>, Fault> {
        self.render_sample_in(sample, info, to_host, false).await
    }

    /// Renders a sample with these faces ahead of demand, when nothing else is left to do, and keeps it.
    pub(super) async fn prefetch_sample(
        &self,
        sample: (SampleId, FaceMask),
        info: Arc<SampleSetInfo>,
        to_host: bool,
    ) -> Result<Arc<Sample>, Fault> {
        self.render_sample_in(sample, info, to_host, true).await
    }

    async fn render_sample_in(
        &self,
        (id, faces): (SampleId, FaceMask),
        info: Arc<SampleSetInfo>,
        to_host: bool,
        prefetch: bool,
    ) -> Result<Arc<Sample>, Fault> {
        // The trace of the view that waits for it. A sample ahead of demand is part of no trace.
        let span = match Span::current().is_disabled() {
            true => Span::none(),
            false => debug_span!(target: TARGET, "render sample", %id),
        };
        let mut again = true;
        loop {
            let (reply, done) = oneshot::channel();
            let (waiting, claimed) = claim();
            // It replaces the sample that is held, and keeps the faces of that.
            let faces = faces.union(self.store.faces(id));
            let task = SampleTask { id, faces, info: info.clone(), to_host, prefetch, claimed, reply };
            self.queue.push_sample(task).map_err(|_| self.overloaded("samples"))?;
            let rendered = done.await.unwrap_or_else(|_| Err(stopped()));
            drop(waiting);
            match rendered {
                Err(RenderError::DeviceLost(_)) if again => again = false,
                rendered => {
                    self.check_set(&info)?;
                    let rendered = rendered?;
                    if !rendered.faces.contains(faces) {
                        let reason = format!("sample {id} was rendered without a face that was asked for");
                        return Err(RenderError::Internal(reason).into());
                    }
                    let sample = match prefetch {
                        true => self.store.insert_quietly(rendered),
                        false => self.store.insert(rendered),
                    };
                    trace::stages(&span, sample.stages.iter().map(|stage| (stage.name.as_str(), stage.ms)));
                    if !prefetch {
                        // Views may be planned with it, and given to this worker, from now on.
                        self.news.notify_one();
                    }
                    return Ok(sample);
                }
            }
        }
    }

    /// Renders some pixels of a view; after a lost device, once more. Dropping the future takes it back.
    pub(super) async fn render_pixels(&self, job: &PixelJob) -> Result<Pixels, Fault> {
        let mut again = true;
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
                    let pixels = rendered?;
                    let measured = pixels.stages.iter().map(|stage| (stage.name.as_str(), stage.ms));
                    trace::stages(&Span::current(), measured);
                    return Ok(pixels);
                }
            }
        }
    }

    fn overloaded(&self, what: &str) -> Fault {
        let Waiting { samples, warped, direct, .. } = self.queue.backlog();
        let what = format!("{samples} samples and {} views wait here, no more {what} fit", warped + direct);
        Fault::Overloaded { what, retry_after: RETRY }
    }

    /// Ends the render thread after its present work. The rest is dropped.
    pub(super) fn stop(&self) {
        self.queue.order(Work::Stop);
    }
}

impl Drop for Node {
    /// A worker whose future was dropped leaves no thread behind either.
    fn drop(&mut self) {
        self.stop();
    }
}

/// Whether this worker renders as the worker does that asks: else the samples of two specifications would be mixed.
///
/// # Errors
/// [`Fault::NotFound`] where it does not.
pub(super) fn check_specification(info: &SampleSetInfo, asked: SpecificationHash) -> Result<(), Fault> {
    let ours = info.specification();
    match ours.hash() == asked {
        true => Ok(()),
        false => Err(Fault::NotFound(format!(
            "specification {asked} is not served here, {} is: {ours}",
            ours.hash()
        ))),
    }
}

/// The error of work that the render thread will not do any more.
fn stopped() -> RenderError {
    RenderError::DeviceLost("the worker is shutting down".to_owned())
}

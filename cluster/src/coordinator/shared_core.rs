//! The core behind a lock, and the way its actions take to the tasks that carry them out.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::{Fault, v1};
use argus_scene::rig::{Sight, Survey};
use argus_scene::{Prediction, View};
use parking_lot::Mutex;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::mpsc::{Receiver, Sender, UnboundedReceiver, UnboundedSender, channel, unbounded_channel};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tonic::{Request, Status};
use tracing::{debug, info, warn};

use super::config::Config;
use super::frame_metrics::FrameMetrics;
use super::planning_time::PlanningTime;
use super::surveys::Surveys;
use super::tickets::{IssuedRedirect, RedirectTickets};
use crate::SceneSource;
use crate::core::{Action, Client, Core, Event, Hello, LastView, Order, ViewId, Uptime, WorkerId};
use crate::leadership::Held;
use crate::net::Channels;
use crate::sealed::{Kind, SealKey};
use crate::wire::{self, ServiceInfo};

/// Assignments that a worker has yet to read. Each replaces those before it and they come a few a second, so that one with
/// so many to read does not read.
const MOST_ASSIGNMENTS: usize = 64;

/// What every service of a coordinator shares.
pub(super) struct SharedCore {
    pub(super) source: Arc<dyn SceneSource>,
    pub(super) service: ServiceInfo,
    pub(super) channels: Channels,
    /// What views show, and what stands between them and cameras.
    sight: Option<Arc<dyn Sight>>,
    /// How long a client may take to read a chunk.
    pub(super) read_within: Duration,
    /// What is recorded of the frames that pass.
    pub(super) frame_metrics: FrameMetrics,
    /// What clients were sent to workers with.
    tickets: RedirectTickets,
    planning: PlanningTime,
    surveys: Surveys,
    /// Cancelled when streams without an end of their own must end.
    pub(super) closing: CancellationToken,
    /// The lease, while it is held.
    pub(super) held: Mutex<Option<Held>>,
    /// A core of a leadership that begins.
    fresh: Box<dyn Fn() -> Core + Send + Sync>,
    state: Mutex<State>,
}

struct State {
    core: Core,
    leading: Option<Leading>,
    /// Who leads in its place, as far as it is known.
    leader: Option<String>,
    next_id: u64,
    streams: HashMap<WorkerId, WorkerStream>,
    views: HashMap<ViewId, UnboundedSender<CoreReply>>,
}

/// A leadership.
#[derive(Debug, Clone, Copy)]
struct Leading {
    term: u64,
    /// The core's uptime counts from here.
    since: Instant,
    /// Its lease may lapse after this.
    until: Option<Instant>,
}

impl Leading {
    fn has_lapsed(&self) -> bool {
        self.until.is_some_and(|until| Instant::now() >= until)
    }
}

/// A worker's stream.
struct WorkerStream {
    hello: Hello,
    /// Where clients may be sent to it.
    redirect_target: Option<RedirectTarget>,
    assignments: Sender<Result<v1::Assignment, Status>>,
    expelled: CancellationToken,
}

/// A worker that clients can reach.
struct RedirectTarget {
    key: SealKey,
    /// Of the newest ticket.
    serial: u64,
    /// One for each client that is on its way, besides this.
    in_flight: Arc<()>,
    /// For as long as the key is good.
    alive: Arc<()>,
}

/// Most clients that are on their way to one worker: some of its places are left to frames that are relayed, should
/// clients take their time.
const MOST_REDIRECTED: usize = 64;

/// A worker that joined: its id, what to send it, and the token that ends its stream.
pub(super) struct JoinedWorker {
    pub(super) worker: WorkerId,
    pub(super) assignments: Receiver<Result<v1::Assignment, Status>>,
    pub(super) expelled: CancellationToken,
}

/// What the core decided about a view: what to do, or the fault that it ends with.
pub(super) type CoreReply = Result<Instruction, Fault>;

/// What to do about a view.
pub(super) enum Instruction {
    /// Carry this out, in place of what was ordered before.
    Dispatch(Box<Order>),
    /// Let the frame of this attempt pass; it was judged.
    Deliver {
        /// Of [`Order::attempt`].
        attempt: u32,
        /// What is expected of it.
        expected: Prediction,
    },
}

impl SharedCore {
    /// A coordinator that does not lead yet.
    pub(super) fn new(
        config: &Config,
        fresh: impl Fn() -> Core + Send + Sync + 'static,
        source: Arc<dyn SceneSource>,
        sight: Option<Arc<dyn Sight>>,
        service: ServiceInfo,
    ) -> Self {
        let (streams, views) = (HashMap::new(), HashMap::new());
        let state = State { core: fresh(), leading: None, leader: None, next_id: 1, streams, views };
        Self {
            source,
            service,
            sight,
            channels: Channels::new(config.connect_timeout, config.security.clone(), config.network.clone())
                .for_relays(config.core.max_views_per_worker),
            read_within: config.read_within,
            frame_metrics: FrameMetrics::default(),
            tickets: RedirectTickets::default(),
            planning: PlanningTime::default(),
            surveys: Surveys::default(),
            closing: CancellationToken::new(),
            held: Mutex::new(None),
            fresh: Box::new(fresh),
            state: Mutex::new(state),
        }
    }

    /// Takes an event to the core and its actions to whom they concern. Never blocks: a view's channel holds no more
    /// than the core says of one view, a instruction for each attempt and judgement, and that of a worker is bounded.
    pub(super) fn step(&self, event: Event) {
        let mut state = self.state.lock();
        self.step_locked(&mut state, event);
    }

    fn step_locked(&self, state: &mut State, event: Event) {
        let Some(leading) = state.leading else { return };
        // A process that stood still for a while may find itself here with another one leading in its place.
        if leading.has_lapsed() {
            self.step_down_locked(state, "its lease lapsed");
            return;
        }
        let now = Uptime(leading.since.elapsed());
        for action in state.core.step(event, now) {
            match action {
                Action::Assign { worker, assignment } => {
                    let Some(stream) = state.streams.get(&worker) else { continue };
                    let prefetch = assignment.prefetch.len();
                    debug!(worker = stream.hello.name, role = ?assignment.role, prefetch, "assigned");
                    let key = stream.redirect_target.as_ref().map(|target| &target.key);
                    let served = wire::Served {
                        set: state.core.set(),
                        versions: &state.core.live_versions(),
                        visibility_is_open: !state.core.visibility_is_settled(),
                    };
                    let message = wire::assignment(assignment, leading.term, &self.service, &served, key);
                    match stream.assignments.try_send(Ok(message)) {
                        Ok(()) => {}
                        Err(TrySendError::Full(_)) => {
                            warn!(worker = stream.hello.name, "worker reads no assignments: its stream ends");
                            stream.expelled.cancel();
                        }
                        // A stream that just ended: its end is the next event.
                        Err(TrySendError::Closed(_)) => {}
                    }
                }
                Action::Expel { worker, reason } => {
                    let Some(stream) = state.streams.remove(&worker) else { continue };
                    warn!(worker = stream.hello.name, reason, "worker expelled");
                    // One that reads nothing sees its stream end all the same.
                    let _ = stream.assignments.try_send(Err(Status::aborted(reason)));
                    stream.expelled.cancel();
                    self.channels.forget(&stream.hello.address);
                }
                Action::Dispatch { view_id, order } => {
                    if let Some(view) = state.views.get(&view_id) {
                        let _ = view.send(Ok(Instruction::Dispatch(order)));
                    }
                }
                Action::Deliver { view_id, attempt, expected } => {
                    if let Some(view) = state.views.get(&view_id) {
                        let _ = view.send(Ok(Instruction::Deliver { attempt, expected }));
                    }
                }
                Action::Refuse { view_id, fault } => {
                    if let Some(view) = state.views.remove(&view_id) {
                        let _ = view.send(Err(fault));
                    }
                }
            }
        }
    }

    /// Leads from now on, until the lease lapses or [`SharedCore::step_down`]. `expected` workers will probably join.
    pub(super) fn lead(&self, term: u64, until: Option<Instant>, expected: usize) {
        let mut state = self.state.lock();
        state.core = (self.fresh)().expecting(expected);
        state.leading = Some(Leading { term, since: Instant::now(), until });
        state.leader = None;
        info!(term, expected, "coordinator leads");
    }

    /// The lease will not lapse before this.
    pub(super) fn lead_until(&self, until: Option<Instant>) {
        if let Some(leading) = &mut self.state.lock().leading {
            leading.until = until;
        }
    }

    /// Whether it leads; it may have found by itself that it does no longer.
    pub(super) fn leads(&self) -> bool {
        self.state.lock().leading.is_some()
    }

    /// The term that it leads under; 0 while it stands by.
    pub(super) fn term(&self) -> u64 {
        self.state.lock().leading.map_or(0, |leading| leading.term)
    }

    /// Leads no more: workers look for another coordinator, and views are asked for again there.
    pub(super) fn step_down(&self, reason: &str) {
        let mut state = self.state.lock();
        self.step_down_locked(&mut state, reason);
    }

    fn step_down_locked(&self, state: &mut State, reason: &str) {
        if state.leading.take().is_none() {
            return;
        }
        warn!(reason, "coordinator leads no more");
        for (_, stream) in state.streams.drain() {
            let _ = stream.assignments.try_send(Err(Status::unavailable("this coordinator leads no more")));
            stream.expelled.cancel();
            self.channels.forget(&stream.hello.address);
        }
        for (_, view) in state.views.drain() {
            let _ = view.send(Err(stands_by(None)));
        }
        state.core = (self.fresh)();
    }

    /// Who leads in its place, for whoever asks here.
    pub(super) fn stand_by(&self, leader: Option<String>) {
        self.state.lock().leader = leader;
    }

    /// Why it does not answer, if it does not lead.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] with what is known of who does.
    pub(super) fn check_leading(&self) -> Result<(), Fault> {
        let state = self.state.lock();
        match state.leading {
            Some(_) => Ok(()),
            None => Err(stands_by(state.leader.as_deref())),
        }
    }

    /// Names of the workers that have joined.
    pub(super) fn workers(&self) -> Vec<String> {
        self.state.lock().streams.values().map(|stream| stream.hello.name.clone()).collect()
    }

    /// A worker joined.
    ///
    /// # Errors
    /// As [`SharedCore::check_leading`].
    pub(super) fn join(&self, hello: Hello) -> Result<JoinedWorker, Fault> {
        let (assignments, receiver) = channel(MOST_ASSIGNMENTS);
        let expelled = self.closing.child_token();
        let mut state = self.state.lock();
        if state.leading.is_none() {
            return Err(stands_by(state.leader.as_deref()));
        }
        let worker = WorkerId(state.next_id);
        state.next_id += 1;
        info!(worker = hello.name, address = hello.address, device = hello.device, "worker joined");
        // Without a key nobody is sent there, and frames are relayed.
        let key = hello.public_address.is_some().then(SealKey::drawn).flatten();
        let new_target =
            |key| RedirectTarget { key, serial: 0, in_flight: Arc::default(), alive: Arc::default() };
        let redirect_target = key.map(new_target);
        let stream = WorkerStream { hello: hello.clone(), redirect_target, assignments, expelled: expelled.clone() };
        state.streams.insert(worker, stream);
        self.step_locked(&mut state, Event::Joined { worker, hello });
        Ok(JoinedWorker { worker, assignments: receiver, expelled })
    }

    /// A worker's stream ended.
    pub(super) fn leave(&self, worker: WorkerId) {
        let mut state = self.state.lock();
        if let Some(stream) = state.streams.remove(&worker) {
            info!(worker = stream.hello.name, "worker left");
            self.channels.forget(&stream.hello.address);
        }
        self.step_locked(&mut state, Event::Left { worker });
    }

    /// Asks for a view; the replies come through what is returned, until [`SharedCore::end_view`].
    pub(super) fn begin_view(
        self: &Arc<Self>,
        client: Client,
        view: View,
        deadline: Option<Duration>,
        last: Option<Box<LastView>>,
    ) -> (ViewId, UnboundedReceiver<CoreReply>) {
        let (sender, replies) = unbounded_channel();
        let planning = self.planning.begin(&view);
        let survey = self.survey(&view, last.as_deref());
        let mut state = self.state.lock();
        let view_id = ViewId(state.next_id);
        state.next_id += 1;
        match state.leading {
            None => drop(sender.send(Err(stands_by(state.leader.as_deref())))),
            Some(_) => {
                state.views.insert(view_id, sender);
                self.step_locked(
                    &mut state,
                    Event::Requested { view_id, client, view: Box::new(view), deadline, survey, last },
                );
            }
        }
        drop(state);
        planning.end();
        (view_id, replies)
    }

    /// Ends the replies about a view. `event` tells the core why.
    pub(super) fn end_view(&self, view_id: ViewId, event: Event) {
        let mut state = self.state.lock();
        state.views.remove(&view_id);
        self.step_locked(&mut state, event);
        // Another attempt may have begun before this one's end was said.
        if state.core.is_open(view_id) {
            self.step_locked(&mut state, Event::Cancelled { view_id });
        }
    }

    /// What is to be known of a view before it is asked for. Rays are sent while nobody waits for the core; those that tell
    /// what to invest in, on another thread.
    fn survey(self: &Arc<Self>, view: &View, last: Option<&LastView>) -> Option<Box<Survey>> {
        let sight = self.sight.as_ref()?;
        let (wanted, for_bundle) = self.read(|core| (core.survey_wanted(view, last), core.bundle_survey_wanted(view)));
        if let Some(wanted) = for_bundle {
            let (shared, sight, view) = (self.clone(), sight.clone(), view.clone());
            tokio::task::spawn_blocking(move || {
                let survey = Box::new(wanted.take(&view, sight.as_ref()));
                let pixels = u64::from(view.width) * u64::from(view.height);
                shared.step(Event::Surveyed { pixels, survey });
            });
        }
        wanted.map(|wanted| self.surveys.take(wanted, view, sight.as_ref()))
    }

    /// Sends a client to the worker with that request, as the session's redirect of that number; `None` where clients do not
    /// reach it, enough are on their way, or this one has enough tickets.
    pub(super) fn redirect(
        &self,
        worker: WorkerId,
        client: &Client,
        request: Request<v1::RenderRequest>,
        age: Duration,
        number: u64,
    ) -> Option<IssuedRedirect> {
        let mut state = self.state.lock();
        let most = state.core.config().max_views_per_client;
        let stream = state.streams.get_mut(&worker)?;
        let (target, address) = (stream.redirect_target.as_mut()?, stream.hello.public_address.clone()?);
        if Arc::strong_count(&target.in_flight) > MOST_REDIRECTED {
            return None;
        }
        let slot = self.tickets.take(client, &target.alive, most)?;
        target.serial += 1;
        let (serial, key, in_flight) = (target.serial, target.key.clone(), target.in_flight.clone());
        drop(state);
        let traceparent = request.metadata().get("traceparent").and_then(|value| value.to_str().ok());
        let traceparent = traceparent.unwrap_or_default().to_owned();
        let ticket = v1::RedirectTicket { serial, request: Some(request.into_inner()), traceparent };
        let ticket = Some(key.seal(Kind::RedirectTicket, &ticket));
        let message = v1::Redirect { address, ticket, age_ms: age.as_secs_f64() * 1e3, serial: number };
        Some(IssuedRedirect { message, key, serial, slot, _in_flight: in_flight })
    }

    /// Counts a session, if its client may open one.
    pub(super) fn open_session(&self, client: &Client) -> Result<(), Fault> {
        let mut state = self.state.lock();
        state.core.check_session(client)?;
        self.step_locked(&mut state, Event::SessionOpened { client: client.clone() });
        Ok(())
    }

    /// The answer to `Status`.
    pub(super) fn status(&self) -> v1::StatusResponse {
        let state = self.state.lock();
        let term = state.leading.map_or(0, |leading| leading.term);
        let (views_planned, planning_us) = self.planning.so_far();
        let status = wire::status(state.core.status(), term, &self.service, state.core.set());
        v1::StatusResponse { views_planned, planning_us, ..status }
    }

    /// Looks at the core.
    pub(super) fn read<T>(&self, read: impl FnOnce(&Core) -> T) -> T {
        read(&self.state.lock().core)
    }
}

/// The answer of a coordinator that does not lead.
fn stands_by(leader: Option<&str>) -> Fault {
    let who = leader.map_or_else(|| "another one will lead".to_owned(), |leader| format!("{leader} leads"));
    Fault::Unavailable(format!("this coordinator stands by, {who}"))
}

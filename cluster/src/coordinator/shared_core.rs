//! The core behind a lock, and the delivery of its actions to the tasks that execute them.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::{Fault, v1};
use argus_scene::{Prediction, Transforms, View};
use parking_lot::Mutex;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::mpsc::{Sender, UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tonic::{Request, Status};
use tracing::{debug, info, warn};

mod members;

pub(super) use members::JoinedWorker;

use super::client_metrics::ClientMetrics;
use super::config::Config;
use super::frame_metrics::FrameMetrics;
use super::movers::Movers;
use super::planning_time::PlanningTime;
use super::tickets::{IssuedRedirect, RedirectTickets};
use crate::SceneSource;
use crate::core::{Action, Client, Core, Event, Hello, LastView, Order, Uptime, ViewId, WorkerId};
use crate::net::Channels;
use crate::sealed::{Kind, SealKey};
use crate::wire::{self, ServiceInfo};

/// Most unread assignments of a worker, beside the transforms that it gets at first. Each replaces those before it and they come a few a second, so a worker with
/// a full queue does not read.
const MOST_ASSIGNMENTS: usize = 64;

/// The core of a scene, and what else all services share of it.
pub(super) struct SharedCore {
    pub(super) source: Arc<dyn SceneSource>,
    pub(super) service: ServiceInfo,
    pub(super) channels: Channels,
    /// Send timeout of response streams.
    pub(super) read_within: Duration,
    /// Metrics of frames.
    pub(super) frame_metrics: FrameMetrics,
    pub(super) client_metrics: Arc<ClientMetrics>,
    /// Counts of the clients' redirect tickets.
    tickets: RedirectTickets,
    planning: PlanningTime,
    /// Cancelled on shutdown, when endless streams must end.
    pub(super) closing: CancellationToken,
    /// Makes the core of a new leadership.
    fresh: Box<dyn Fn() -> Core + Send + Sync>,
    state: Mutex<State>,
}

struct State {
    core: Core,
    leading: Option<Leading>,
    /// The leader's address, if another coordinator leads and is known.
    leader: Option<String>,
    next_id: u64,
    streams: HashMap<WorkerId, WorkerStream>,
    movers: Movers,
    views: HashMap<ViewId, UnboundedSender<CoreReply>>,
    /// Views that were requested, and how many of them were when the load was last asked for.
    requested: [u64; 2],
    /// Workers that left for another scene.
    moved: u64,
}

/// What the cores of all scenes of a coordinator share.
#[derive(Clone)]
pub(super) struct ProcessParts {
    pub(super) client_metrics: Arc<ClientMetrics>,
    pub(super) frame_metrics: FrameMetrics,
    pub(super) closing: CancellationToken,
}

/// A leadership of this coordinator.
#[derive(Debug, Clone, Copy)]
struct Leading {
    term: u64,
    /// Start of the core's uptime.
    since: Instant,
    /// The lease may lapse after this.
    until: Option<Instant>,
}

impl Leading {
    fn has_lapsed(&self) -> bool {
        self.until.is_some_and(|until| Instant::now() >= until)
    }
}

/// The stream of a joined worker.
struct WorkerStream {
    hello: Hello,
    /// How clients are redirected to this worker, if they can reach it.
    redirect_target: Option<RedirectTarget>,
    assignments: Sender<Result<v1::Assignment, Status>>,
    expelled: CancellationToken,
    /// Whether it had this scene open when it joined.
    had_it_open: bool,
    /// Whether it finishes its views, to go to another scene.
    moves_out: bool,
}

/// Redirects to one worker.
struct RedirectTarget {
    key: SealKey,
    /// Serial number of the newest ticket.
    serial: u64,
    /// Cloned once for each redirect in flight.
    in_flight: Arc<()>,
    /// Lives as long as the key is valid.
    alive: Arc<()>,
}

/// Most redirects in flight to one worker. Its other places are for relayed frames, in case redirected clients are
/// slow.
const MOST_REDIRECTED: usize = 64;

/// The core's reply about a view: an instruction, or the fault that ends the view.
pub(super) type CoreReply = Result<Instruction, Fault>;

/// An instruction about a view.
pub(super) enum Instruction {
    /// Send this order to its worker. It replaces earlier orders.
    Dispatch(Box<Order>),
    /// Deliver the judged frame of this attempt.
    Deliver {
        /// The number of the attempt, [`Order::attempt`].
        attempt: u32,
        /// The prediction for the frame.
        expected: Prediction,
    },
}

impl SharedCore {
    /// The core of a coordinator that does not lead yet.
    pub(super) fn new(
        config: &Config,
        fresh: impl Fn() -> Core + Send + Sync + 'static,
        source: Arc<dyn SceneSource>,
        service: ServiceInfo,
        parts: ProcessParts,
    ) -> Self {
        let ProcessParts { client_metrics, frame_metrics, closing } = parts;
        let state = State {
            core: fresh(),
            leading: None,
            leader: None,
            next_id: 1,
            streams: HashMap::new(),
            movers: Movers::default(),
            views: HashMap::new(),
            requested: [0; 2],
            moved: 0,
        };
        Self {
            source,
            service,
            channels: Channels::new(config.connect_timeout, config.security.clone(), config.network.clone())
                .for_relays(config.core.max_views_per_worker),
            read_within: config.read_within,
            frame_metrics,
            client_metrics,
            tickets: RedirectTickets::default(),
            planning: PlanningTime::default(),
            closing,
            fresh: Box::new(fresh),
            state: Mutex::new(state),
        }
    }

    /// Steps the core, and delivers its actions. Never blocks: a view's channel holds one reply for each attempt and
    /// each judgement, and a worker's channel is bounded.
    pub(super) fn step(&self, event: Event) {
        let mut state = self.state.lock();
        self.step_locked(&mut state, event);
    }

    fn step_locked(&self, state: &mut State, event: Event) {
        let Some(leading) = state.leading else { return };
        // After a pause of this process, another coordinator may lead.
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
                            warn!(
                                worker = stream.hello.name,
                                "worker does not read its assignments; ending its stream"
                            );
                            stream.expelled.cancel();
                        }
                        // The stream just ended. The event of its end follows.
                        Err(TrySendError::Closed(_)) => {}
                    }
                }
                Action::Expel { worker, reason } => {
                    let Some(stream) = state.streams.remove(&worker) else { continue };
                    warn!(worker = stream.hello.name, reason, "worker expelled");
                    // The stream ends even if the worker reads nothing.
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

    /// Begins a leadership, which lasts until the lease lapses or [`SharedCore::step_down`]. `expected` is the
    /// probable number of workers.
    pub(super) fn lead(&self, term: u64, until: Option<Instant>, expected: usize) {
        let mut state = self.state.lock();
        state.core = (self.fresh)().expecting(expected);
        state.movers = Movers::default();
        state.leading = Some(Leading { term, since: Instant::now(), until });
        state.leader = None;
        info!(term, expected, "coordinator leads");
    }

    /// Extends the leadership to the end of a renewed lease.
    pub(super) fn lead_until(&self, until: Option<Instant>) {
        if let Some(leading) = &mut self.state.lock().leading {
            leading.until = until;
        }
    }

    /// Whether this coordinator leads. It steps down by itself when its lease lapses.
    pub(super) fn leads(&self) -> bool {
        self.state.lock().leading.is_some()
    }

    /// The term of the leadership; 0 on standby.
    pub(super) fn term(&self) -> u64 {
        self.state.lock().leading.map_or(0, |leading| leading.term)
    }

    /// Ends the leadership: workers find another coordinator, and clients repeat their views there.
    pub(super) fn step_down(&self, reason: &str) {
        let mut state = self.state.lock();
        self.step_down_locked(&mut state, reason);
    }

    fn step_down_locked(&self, state: &mut State, reason: &str) {
        if state.leading.take().is_none() {
            return;
        }
        warn!(reason, "coordinator stepped down");
        for (_, stream) in state.streams.drain() {
            let _ = stream.assignments.try_send(Err(Status::unavailable("this coordinator stepped down")));
            stream.expelled.cancel();
            self.channels.forget(&stream.hello.address);
        }
        for (_, view) in state.views.drain() {
            let _ = view.send(Err(stands_by(None)));
        }
        state.core = (self.fresh)();
    }

    /// Sets the leader's address, which refusals name.
    pub(super) fn stand_by(&self, leader: Option<String>) {
        self.state.lock().leader = leader;
    }

    /// Checks that this coordinator leads.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] with the leader's address, if it is known.
    pub(super) fn check_leading(&self) -> Result<(), Fault> {
        let state = self.state.lock();
        match state.leading {
            Some(_) => Ok(()),
            None => Err(stands_by(state.leader.as_deref())),
        }
    }

    /// Changes the nodes' transforms by a function, which sees the present ones, and serves the result. Workers learn it before
    /// any order for it. Returns the function's result with the number of samples that became stale, 0 if nothing changed.
    ///
    /// # Errors
    /// The fault of the function; [`Fault::Unavailable`] on standby, [`Fault::Overloaded`] if a worker does not keep up.
    pub(super) fn move_nodes<T>(
        &self,
        change: impl FnOnce(&mut Movers) -> Result<(T, Option<Arc<Transforms>>), Fault>,
    ) -> Result<(T, u64), Fault> {
        let mut state = self.state.lock();
        let Some(leading) = state.leading else { return Err(stands_by(state.leader.as_deref())) };
        if state.streams.values().any(|stream| stream.assignments.capacity() < MOST_ASSIGNMENTS / 2) {
            let what = "a worker has not read the last transforms yet".to_owned();
            return Err(Fault::Overloaded { what, retry_after: Duration::from_millis(50) });
        }
        let (result, moved) = change(&mut state.movers)?;
        let Some(moved) = moved else { return Ok((result, 0)) };
        for stream in state.streams.values() {
            // There is room, as was checked.
            let _ = stream.assignments.try_send(Ok(wire::moved(&moved, leading.term)));
        }
        let kept = state.movers.revisions();
        let stale = state.core.move_nodes(moved.revision, &kept);
        Ok((result, stale))
    }

    /// Submits a view to the core. Replies come through the returned channel until [`SharedCore::end_view`].
    pub(super) fn begin_view(
        self: &Arc<Self>,
        client: Client,
        view: View,
        deadline: Option<Duration>,
        last: Option<Box<LastView>>,
    ) -> (ViewId, UnboundedReceiver<CoreReply>) {
        let (sender, replies) = unbounded_channel();
        let planning = self.planning.begin(&view);
        let mut state = self.state.lock();
        let view_id = ViewId(state.next_id);
        state.next_id += 1;
        state.requested[0] += 1;
        match state.leading {
            None => drop(sender.send(Err(stands_by(state.leader.as_deref())))),
            Some(_) => {
                state.views.insert(view_id, sender);
                self.step_locked(
                    &mut state,
                    Event::Requested { view_id, client, view: Box::new(view), deadline, last },
                );
            }
        }
        drop(state);
        planning.end();
        (view_id, replies)
    }

    /// Ends the replies about a view. `event` tells the core the reason.
    pub(super) fn end_view(&self, view_id: ViewId, event: Event) {
        let mut state = self.state.lock();
        state.views.remove(&view_id);
        self.step_locked(&mut state, event);
        // The core may have begun another attempt before it got this event.
        if state.core.is_open(view_id) {
            self.step_locked(&mut state, Event::Cancelled { view_id });
        }
    }

    /// Redirects a client to a worker for a request. `number` counts the session's redirects. `None` if clients
    /// cannot reach the worker, too many redirects to it are in flight, or the client has too many tickets.
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

    /// Opens a session of a client.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] beyond a limit, [`Fault::Unavailable`] while draining.
    pub(super) fn open_session(&self, client: &Client) -> Result<(), Fault> {
        let mut state = self.state.lock();
        state.core.check_session(client)?;
        self.step_locked(&mut state, Event::SessionOpened { client: client.clone() });
        Ok(())
    }

    /// The answer to the RPC `Status`.
    pub(super) fn status(&self) -> v1::StatusResponse {
        let state = self.state.lock();
        let term = state.leading.map_or(0, |leading| leading.term);
        let (views_planned, planning_us) = self.planning.so_far();
        let scene = Some(wire::scene_ref(&self.service.scene));
        v1::StatusResponse { scene, term, views_planned, planning_us, ..state.core.status() }
    }

    /// Reads the core under its lock.
    pub(super) fn read<T>(&self, read: impl FnOnce(&Core) -> T) -> T {
        read(&self.state.lock().core)
    }
}

/// The fault of a coordinator on standby.
fn stands_by(leader: Option<&str>) -> Fault {
    let who =
        leader.map_or_else(|| "another coordinator will lead".to_owned(), |leader| format!("{leader} leads"));
    Fault::Unavailable(format!("this coordinator is on standby, {who}"))
}

//! The core behind a lock, and the way its actions take to the tasks that carry them out.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::{Fault, v1};
use argus_scene::{Prediction, View};
use parking_lot::Mutex;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tonic::Status;
use tracing::{debug, info, warn};

use super::Config;
use crate::SceneSource;
use crate::core::quality::Observed;
use crate::core::{Action, Core, Event, Failure, Hello, Order, Ticket, Uptime, WorkerId};
use crate::net::Channels;
use crate::wire::{self, Standing};

/// What every service of a coordinator shares.
pub(super) struct Hub {
    pub(super) source: Arc<dyn SceneSource>,
    pub(super) standing: Standing,
    pub(super) channels: Channels,
    /// Cancelled when streams without an end of their own must end.
    pub(super) closing: CancellationToken,
    started: Instant,
    state: Mutex<State>,
}

struct State {
    core: Core,
    next_id: u64,
    seats: HashMap<WorkerId, Seat>,
    views: HashMap<Ticket, UnboundedSender<Verdict>>,
}

/// A worker's stream.
struct Seat {
    hello: Hello,
    assignments: UnboundedSender<Result<v1::Assignment, Status>>,
    expelled: CancellationToken,
}

/// What the core decided about a view: what to do, or the fault that it ends with.
pub(super) type Verdict = Result<Ruling, Fault>;

/// What to do about a view.
pub(super) enum Ruling {
    /// Carry this out, in place of what was ordered before.
    Carry(Box<Order>),
    /// Let the frame of this attempt pass; it was judged.
    Deliver {
        /// Of [`Order::attempt`].
        attempt: u32,
        /// What is expected of it.
        expected: Prediction,
    },
}

impl Hub {
    pub(super) fn new(config: &Config, core: Core, source: Arc<dyn SceneSource>, standing: Standing) -> Self {
        Self {
            source,
            standing,
            channels: Channels::new(config.connect_timeout),
            closing: CancellationToken::new(),
            started: Instant::now(),
            state: Mutex::new(State { core, next_id: 1, seats: HashMap::new(), views: HashMap::new() }),
        }
    }

    /// Takes an event to the core and its actions to whom they concern. Never blocks: channels are unbounded,
    /// and bounded in fact by the core's own limits.
    pub(super) fn step(&self, event: Event) {
        let mut state = self.state.lock();
        self.step_locked(&mut state, event);
    }

    fn step_locked(&self, state: &mut State, event: Event) {
        let now = Uptime(self.started.elapsed());
        for action in state.core.step(event, now) {
            match action {
                Action::Assign { worker, assignment } => {
                    let Some(seat) = state.seats.get(&worker) else { continue };
                    let ahead = assignment.ahead.len();
                    debug!(worker = seat.hello.name, role = ?assignment.role, ahead, "assigned");
                    let message = wire::assignment(assignment, &self.standing, state.core.set());
                    // A stream that just ended: its end is the next event.
                    let _ = seat.assignments.send(Ok(message));
                }
                Action::Expel { worker, reason } => {
                    let Some(seat) = state.seats.remove(&worker) else { continue };
                    warn!(worker = seat.hello.name, reason, "worker expelled");
                    let _ = seat.assignments.send(Err(Status::aborted(reason)));
                    seat.expelled.cancel();
                    self.channels.forget(&seat.hello.address);
                }
                Action::Dispatch { ticket, order } => {
                    if let Some(view) = state.views.get(&ticket) {
                        let _ = view.send(Ok(Ruling::Carry(order)));
                    }
                }
                Action::Deliver { ticket, attempt, expected } => {
                    if let Some(view) = state.views.get(&ticket) {
                        let _ = view.send(Ok(Ruling::Deliver { attempt, expected }));
                    }
                }
                Action::Refuse { ticket, fault } => {
                    if let Some(view) = state.views.remove(&ticket) {
                        let _ = view.send(Err(fault));
                    }
                }
            }
        }
    }

    /// A worker joined: its id, what to send it, and the token that ends its stream.
    pub(super) fn seat(
        &self,
        hello: Hello,
    ) -> (WorkerId, UnboundedReceiver<Result<v1::Assignment, Status>>, CancellationToken) {
        let (assignments, receiver) = unbounded_channel();
        let expelled = self.closing.child_token();
        let mut state = self.state.lock();
        let worker = WorkerId(state.next_id);
        state.next_id += 1;
        info!(worker = hello.name, address = hello.address, device = hello.device, "worker joined");
        state.seats.insert(worker, Seat { hello: hello.clone(), assignments, expelled: expelled.clone() });
        self.step_locked(&mut state, Event::Joined { worker, hello });
        (worker, receiver, expelled)
    }

    /// A worker's stream ended.
    pub(super) fn vacate(&self, worker: WorkerId) {
        let mut state = self.state.lock();
        if let Some(seat) = state.seats.remove(&worker) {
            info!(worker = seat.hello.name, "worker left");
            self.channels.forget(&seat.hello.address);
        }
        self.step_locked(&mut state, Event::Left { worker });
    }

    /// Asks for a view; the verdicts come through what is returned.
    pub(super) fn ask(self: &Arc<Self>, view: View, deadline: Option<Duration>) -> Asked {
        let (sender, verdicts) = unbounded_channel();
        let mut state = self.state.lock();
        let ticket = Ticket(state.next_id);
        state.next_id += 1;
        state.views.insert(ticket, sender);
        self.step_locked(&mut state, Event::Asked { ticket, view: Box::new(view), deadline });
        drop(state);
        Asked { hub: self.clone(), ticket, verdicts, open: true }
    }

    /// The answer to `Status`.
    pub(super) fn status(&self) -> v1::StatusResponse {
        let state = self.state.lock();
        wire::status(state.core.status(), &self.standing, state.core.set())
    }

    /// Looks at the core.
    pub(super) fn look<T>(&self, look: impl FnOnce(&Core) -> T) -> T {
        look(&self.state.lock().core)
    }
}

/// A view that was asked for. Dropping it before it ended cancels it.
pub(super) struct Asked {
    hub: Arc<Hub>,
    ticket: Ticket,
    verdicts: UnboundedReceiver<Verdict>,
    open: bool,
}

impl Asked {
    /// The next verdict.
    pub(super) async fn verdict(&mut self) -> Verdict {
        match self.verdicts.recv().await {
            Some(Ok(ruling)) => Ok(ruling),
            Some(Err(fault)) => {
                self.open = false;
                Err(fault)
            }
            None => Err(Fault::Unavailable("the coordinator is shutting down".to_owned())),
        }
    }

    /// The frame of that attempt begins to arrive, and is to be judged: a verdict follows.
    pub(super) fn judge(&self, attempt: u32, observed: Option<Observed>, ms: f64) {
        self.hub.step(Event::Judged { ticket: self.ticket, attempt, observed, ms });
    }

    /// The frame of that attempt was relayed whole; `uncovered` of its pixels no sample saw. Rendering took `ms`,
    /// if that was not said before.
    pub(super) fn answered(mut self, attempt: u32, uncovered: u64, ms: Option<f64>) {
        self.end(Event::Answered { ticket: self.ticket, attempt, uncovered, ms });
    }

    /// The view failed for good.
    pub(super) fn failed(mut self, attempt: u32) {
        self.end(Event::Failed { ticket: self.ticket, attempt, failure: Failure::Final });
    }

    /// That attempt failed before its frame began; a verdict follows.
    pub(super) fn try_elsewhere(&self, attempt: u32) {
        self.hub.step(Event::Failed { ticket: self.ticket, attempt, failure: Failure::TryElsewhere });
    }

    fn end(&mut self, event: Event) {
        self.open = false;
        let mut state = self.hub.state.lock();
        state.views.remove(&self.ticket);
        self.hub.step_locked(&mut state, event);
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        if self.open {
            self.end(Event::Cancelled { ticket: self.ticket });
        }
    }
}

//! The state machine of one view in the coordinator: state × event → state × commands.
//!
//! ```text
//!  Queued ─ order ───────────────▶ Ordered ── header ─▶ Streaming ── last chunk ─▶ Done
//!    │                              ▲   └─ header ─▶ Judged ─ good ─▲
//!    │                              └── the client reaches no worker
//!    └── order, with a ticket ─▶ Redirected ── the client has the frame ─▶ Done
//! ```
//!
//! A failed attempt leads back to Queued: the core orders another attempt, or refuses the view. In every state but
//! Done, the core may replace the order or refuse the view, for example at its deadline, and the client may cancel.
//! Nothing here waits, reads a clock or opens a socket; `drive` does.

use argus_proto::v1::frame_chunk::Body;
use argus_proto::{Fault, v1};
use argus_scene::Prediction;
use tonic::{Code, Status};

use super::relayed::{Relayed, fell_short, rendering_ms, uncovered};
use crate::core::{Failure, Order};

/// A frame is relayed after so many failed redirects, since each of them may have cost a rendering.
pub(super) const MOST_MISSES: u32 = 2;

/// The state of a view.
#[derive(Debug, Clone)]
pub(super) enum State {
    /// No worker has the view. `failed` is the error of the last relayed attempt.
    Queued { failed: Option<Status> },
    /// A worker has the view; no chunk has arrived.
    Ordered(Box<Order>),
    /// The header arrived and waits for the core's judgement of the frame.
    Judged { order: Box<Order>, header: Box<v1::FrameHeader>, age_ms: f64 },
    /// Chunks are relayed as they arrive.
    Streaming(Box<Order>),
    /// The client fetches the frame from the worker. `ticket` is the redirect's serial number.
    Redirected { order: Box<Order>, ticket: u64 },
    /// The view is answered, failed or cancelled.
    Done,
}

/// An event of a view.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "most are chunks, and a box for each would cost more")]
pub(super) enum Event {
    /// The core gave the view to a worker, which voids earlier attempts. With a redirect, if
    /// [`ViewPath::may_redirect`] allows it and one was issued.
    Ordered { order: Box<Order>, ticket: Option<v1::Redirect> },
    /// The core accepted the judged frame.
    Delivered { attempt: u32, expected: Prediction },
    /// The core refused the view, for example at its deadline.
    Refused(Fault),
    /// A chunk arrived from the worker, `age_ms` after the request.
    Chunk { chunk: v1::FrameChunk, age_ms: f64 },
    /// The worker's stream did not open, failed, or ended early.
    Broken(Status),
    /// The client has the redirected frame; with its header if a receipt proves it. `newest` is an order that the
    /// core gave meanwhile.
    Fetched { header: Option<Box<v1::FrameHeader>>, newest: Option<Box<Order>> },
    /// The client could not fetch the frame with this ticket (0: any ticket). `unreachable`: it cannot reach workers
    /// at all.
    Missed { ticket: u64, unreachable: bool },
    /// The client cancelled the view.
    Cancelled,
}

/// A command to the driver of a view.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "most are chunks, and a box for each would cost more")]
pub(super) enum Command {
    /// Request the frame from the worker of [`ViewPath::order`], in place of an earlier request.
    Open,
    /// Redirect the client to a worker.
    Redirect(v1::Redirect),
    /// Pause the session's redirects: its client cannot reach workers.
    PauseRedirects,
    /// Let the core judge the frame. [`Event::Delivered`] or another order follows.
    Judge { attempt: u32, observed: Option<v1::Observed>, ms: f64 },
    /// Tell the core how an attempt failed. Unless that is final, another order or a refusal follows.
    Failed { attempt: u32, failure: Failure },
    /// Tell the core and the metrics that the client has its frame.
    Answered(Answered),
    /// Tell the core that the view is cancelled.
    Cancel,
    /// Send a chunk to the client.
    Send(v1::FrameChunk),
    /// Read the worker's stream to its end, within a timeout.
    CloseStream,
    /// Send the client an error.
    Fail(Status),
}

/// A frame that its client has.
#[derive(Debug, Clone)]
pub(super) struct Answered {
    pub(super) attempt: u32,
    /// The header; absent for a fetched frame without a receipt.
    pub(super) header: Option<Box<v1::FrameHeader>>,
    /// Number of pixels that no sample saw.
    pub(super) uncovered: Option<u64>,
    /// Whether the frame by the plan was not good enough, and a direct one replaced it.
    pub(super) fell_short: bool,
    /// Milliseconds of rendering; absent if they were reported with the judgement.
    pub(super) ms: Option<f64>,
    /// Whether this process relayed the frame.
    pub(super) relayed: bool,
}

/// The state machine of one view.
#[derive(Debug)]
pub(super) struct ViewPath {
    state: State,
    relayed: Relayed,
    /// Whether the client may be redirected; false once the frame is relayed.
    redirectable: bool,
    /// Number of failed redirects of this frame.
    missed: u32,
}

impl ViewPath {
    /// Starts with a view that was just submitted to the core.
    pub(super) fn new(redirectable: bool) -> Self {
        let state = State::Queued { failed: None };
        Self { state, relayed: Relayed::default(), redirectable, missed: 0 }
    }

    pub(super) fn state(&self) -> &State {
        &self.state
    }

    /// The current order.
    pub(super) fn order(&self) -> Option<&Order> {
        match &self.state {
            State::Queued { .. } | State::Done => None,
            State::Ordered(order) | State::Streaming(order) => Some(order),
            State::Judged { order, .. } | State::Redirected { order, .. } => Some(order),
        }
    }

    /// Whether the client may be redirected for this order. Judged frames pass the coordinator.
    pub(super) fn may_redirect(&self, order: &Order) -> bool {
        self.redirectable && self.missed < MOST_MISSES && !order.judged
    }

    /// Processes an event. Events that do not fit the state are ignored.
    pub(super) fn step(&mut self, event: Event) -> Vec<Command> {
        let state = std::mem::replace(&mut self.state, State::Done);
        let (state, commands) = self.next(state, event);
        self.state = state;
        commands
    }

    fn next(&mut self, state: State, event: Event) -> (State, Vec<Command>) {
        match (state, event) {
            (State::Done, _) => (State::Done, Vec::new()),

            // In any state.
            (_, Event::Cancelled) => (State::Done, vec![Command::Cancel]),
            // If no worker is left, the last worker's error says more than the refusal.
            (State::Queued { failed: Some(status) }, Event::Refused(Fault::Unavailable(_))) => {
                (State::Done, vec![Command::Fail(status)])
            }
            (_, Event::Refused(fault)) => (State::Done, vec![Command::Fail(fault.into())]),
            (_, Event::Ordered { order, ticket: Some(redirect) }) => {
                (State::Redirected { order, ticket: redirect.serial }, vec![Command::Redirect(redirect)])
            }
            (state, Event::Ordered { order, ticket: None }) => {
                if let State::Judged { header, .. } = state {
                    self.relayed.refuse(rendering_ms(&header));
                }
                self.relay(order)
            }

            // The frame is relayed.
            (State::Ordered(order), Event::Chunk { chunk, age_ms }) if self.is_to_be_judged(&order) => {
                self.judge(order, chunk, age_ms)
            }
            (State::Ordered(order) | State::Streaming(order), Event::Chunk { chunk, age_ms }) => {
                self.pass(order, chunk, age_ms)
            }
            (State::Judged { mut order, header, age_ms }, Event::Delivered { attempt, expected })
                if attempt == order.attempt =>
            {
                order.expected = Some(expected);
                self.pass(order, v1::FrameChunk { body: Some(Body::Header(*header)) }, age_ms)
            }
            (State::Ordered(order) | State::Streaming(order), Event::Broken(status)) => {
                broken(&order, status)
            }

            // The client fetches the frame.
            (State::Redirected { order, .. }, Event::Fetched { header, newest }) => {
                let order = newest.unwrap_or(order);
                (State::Done, vec![Command::Answered(answered(&order, header, false))])
            }
            (State::Redirected { order, ticket }, Event::Missed { ticket: missed, unreachable })
                if missed == 0 || missed == ticket =>
            {
                self.miss(order, unreachable)
            }

            (state, _) => (state, Vec::new()),
        }
    }

    /// Relays the frame, and all further attempts at the view.
    fn relay(&mut self, order: Box<Order>) -> (State, Vec<Command>) {
        self.redirectable = false;
        (State::Ordered(order), vec![Command::Open])
    }

    /// Whether the core must judge the frame first: not if the client has a part of it.
    fn is_to_be_judged(&self, order: &Order) -> bool {
        order.judged && self.relayed.header().is_none()
    }

    fn judge(&mut self, order: Box<Order>, chunk: v1::FrameChunk, age_ms: f64) -> (State, Vec<Command>) {
        let Some(Body::Header(header)) = chunk.body else { return self.pass(order, chunk, age_ms) };
        let (observed, ms) = (header.observed, rendering_ms(&header));
        let command = Command::Judge { attempt: order.attempt, observed, ms };
        (State::Judged { order, header: Box::new(header), age_ms }, vec![command])
    }

    fn pass(&mut self, order: Box<Order>, chunk: v1::FrameChunk, age_ms: f64) -> (State, Vec<Command>) {
        match self.relayed.pass(chunk, age_ms, order.expected) {
            Err(status) => broken(&order, status),
            Ok(None) => (State::Streaming(order), Vec::new()),
            Ok(Some(chunk)) if self.relayed.is_whole() => {
                let header = self.relayed.header().cloned().map(Box::new);
                let answered = Command::Answered(answered(&order, header, true));
                // Reported before the last chunk is sent, since the client may leave right after it.
                (State::Done, vec![answered, Command::Send(chunk), Command::CloseStream])
            }
            Ok(Some(chunk)) => (State::Streaming(order), vec![Command::Send(chunk)]),
        }
    }

    /// Handles a failed redirect. If the client can reach no worker, the ordered frame is relayed.
    fn miss(&mut self, order: Box<Order>, unreachable: bool) -> (State, Vec<Command>) {
        self.missed += 1;
        let pause = unreachable || self.missed >= MOST_MISSES;
        let mut commands: Vec<Command> = pause.then_some(Command::PauseRedirects).into_iter().collect();
        let (state, then) = match unreachable {
            true => self.relay(order),
            false => retry(&order, Failure::TryElsewhere, None),
        };
        commands.extend(then);
        (state, commands)
    }
}

/// Handles a failed attempt at a relayed frame. Another attempt follows unless the request itself is at fault.
fn broken(order: &Order, status: Status) -> (State, Vec<Command>) {
    match status.code() {
        Code::InvalidArgument | Code::DeadlineExceeded | Code::Unimplemented => {
            let failed = Command::Failed { attempt: order.attempt, failure: Failure::Final };
            (State::Done, vec![failed, Command::Fail(status)])
        }
        // The worker is at fault.
        Code::Unavailable | Code::Internal | Code::DataLoss | Code::Unknown => {
            retry(order, Failure::OfWorker, Some(status))
        }
        // The worker has no room, or refused.
        _ => retry(order, Failure::TryElsewhere, Some(status)),
    }
}

fn retry(order: &Order, failure: Failure, failed: Option<Status>) -> (State, Vec<Command>) {
    (State::Queued { failed }, vec![Command::Failed { attempt: order.attempt, failure }])
}

fn answered(order: &Order, header: Option<Box<v1::FrameHeader>>, relayed: bool) -> Answered {
    let uncovered = header.as_deref().map(uncovered);
    let fell_short = header.as_deref().is_some_and(fell_short);
    let ms = header.as_deref().filter(|_| !order.judged).map(rendering_ms);
    Answered { attempt: order.attempt, header, uncovered, ms, fell_short, relayed }
}

#[cfg(test)]
mod tests;

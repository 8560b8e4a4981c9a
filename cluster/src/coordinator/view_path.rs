//! One view's path through the coordinator, from its request to its last chunk: state × event → state × commands.
//!
//! ```text
//!  Queued ─ order ───────────────▶ Ordered ── header ─▶ Streaming ── last chunk ─▶ Done
//!    │                              ▲   └─ header ─▶ Judged ─ good ─▲
//!    │                              └── the client reaches no worker
//!    └── order, with a ticket ─▶ Redirected ── the client has the frame ─▶ Done
//! ```
//!
//! An attempt that fails, ordered, streaming or redirected, leads back to Queued: the core orders another one, or refuses.
//! The core may give the view to another worker in every state but the last: an order replaces what was ordered before. It
//! may refuse the view in each of them, for its deadline among other things, and the client may cancel it in each.
//! Nothing here waits, reads a clock or opens a socket: `drive` does, and says what happened.

use argus_proto::v1::frame_chunk::Body;
use argus_proto::{Fault, v1};
use argus_scene::Prediction;
use tonic::{Code, Status};

use super::relayed::{Relayed, rendering_ms, uncovered};
use crate::core::{Failure, Order};

/// A frame that was missed so often is relayed: each miss may be a frame that was rendered.
pub(super) const MOST_MISSES: u32 = 2;

/// Where a view is.
#[derive(Debug, Clone)]
pub(super) enum State {
    /// The core was asked, and no worker has the view. `failed` is how the last attempt at a relayed frame ended.
    Queued { failed: Option<Status> },
    /// A worker has the view, and nothing of its frame is here.
    Ordered(Box<Order>),
    /// The frame's header waits until the core says whether the frame is good enough.
    Judged { order: Box<Order>, header: Box<v1::FrameHeader>, age_ms: f64 },
    /// The frame's chunks are passed on as they come.
    Streaming(Box<Order>),
    /// The client fetches the frame from the worker with the ticket of that number.
    Redirected { order: Box<Order>, ticket: u64 },
    /// The client has its frame, or knows why not, or went away.
    Done,
}

/// What happened to a view.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "most are chunks, and a box for each would cost more")]
pub(super) enum Event {
    /// The core gives the view to a worker, and an earlier attempt is void. With a ticket where [`ViewPath::may_redirect`]
    /// allows one and there is one.
    Ordered { order: Box<Order>, ticket: Option<v1::Redirect> },
    /// The core lets the frame pass that was judged.
    Delivered { attempt: u32, expected: Prediction },
    /// The core gave the view up: its deadline is over, or no worker is left, or the like.
    Refused(Fault),
    /// A chunk came from the worker, `age_ms` after the view's request.
    Chunk { chunk: v1::FrameChunk, age_ms: f64 },
    /// The worker's stream did not open, broke, or ended.
    Broken(Status),
    /// The client has the frame that it was sent for; with its header if a receipt proves it. `newest` is the order that the
    /// core gave meanwhile, if it gave one.
    Fetched { header: Option<Box<v1::FrameHeader>>, newest: Option<Box<Order>> },
    /// The client did not get the frame with that ticket (0: with any). `unreachable`: nor will it get others.
    Missed { ticket: u64, unreachable: bool },
    /// Nobody waits for the view any more.
    Cancelled,
}

/// What is to be done about a view, in order.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "most are chunks, and a box for each would cost more")]
pub(super) enum Command {
    /// Ask the worker of [`ViewPath::order`] for the frame, in place of an earlier one.
    Open,
    /// Send the client to a worker.
    Redirect(v1::Redirect),
    /// Relay the session's next frames: its client does not reach workers.
    PauseRedirects,
    /// Let the core look at the frame; [`Event::Delivered`] follows, or another order.
    Judge { attempt: u32, observed: Option<v1::Observed>, ms: f64 },
    /// Tell the core how an attempt failed; unless that is final, another order follows, or a refusal.
    Failed { attempt: u32, failure: Failure },
    /// Tell the core, and those who count frames, that the client has its frame.
    Answered(Answered),
    /// Tell the core that nobody waits.
    Cancel,
    /// Pass a chunk on to the client.
    Send(v1::FrameChunk),
    /// Read the worker's stream to its end, soon.
    CloseStream,
    /// Tell the client that it gets no frame.
    Fail(Status),
}

/// A frame that a client has.
#[derive(Debug, Clone)]
pub(super) struct Answered {
    pub(super) attempt: u32,
    /// Absent where nothing is known of a frame that was fetched.
    pub(super) header: Option<Box<v1::FrameHeader>>,
    /// Pixels that no sample saw.
    pub(super) uncovered: Option<u64>,
    /// Milliseconds of rendering; absent where they were said when the frame was judged.
    pub(super) ms: Option<f64>,
    /// Whether the frame passed this process.
    pub(super) relayed: bool,
}

/// A view's path.
#[derive(Debug)]
pub(super) struct ViewPath {
    state: State,
    relayed: Relayed,
    /// Whether its client may fetch frames from workers; no more once this frame was to be relayed.
    redirectable: bool,
    /// How often the client missed this frame.
    missed: u32,
}

impl ViewPath {
    /// Of a view that the core was just asked for.
    pub(super) fn new(redirectable: bool) -> Self {
        let state = State::Queued { failed: None };
        Self { state, relayed: Relayed::default(), redirectable, missed: 0 }
    }

    pub(super) fn state(&self) -> &State {
        &self.state
    }

    /// The order that is being carried out.
    pub(super) fn order(&self) -> Option<&Order> {
        match &self.state {
            State::Queued { .. } | State::Done => None,
            State::Ordered(order) | State::Streaming(order) => Some(order),
            State::Judged { order, .. } | State::Redirected { order, .. } => Some(order),
        }
    }

    /// Whether the client may fetch that order's frame itself. One that is judged passes here.
    pub(super) fn may_redirect(&self, order: &Order) -> bool {
        self.redirectable && self.missed < MOST_MISSES && !order.judged
    }

    /// Takes one event in. What is about nothing that is awaited changes nothing.
    pub(super) fn step(&mut self, event: Event) -> Vec<Command> {
        let state = std::mem::replace(&mut self.state, State::Done);
        let (state, commands) = self.next(state, event);
        self.state = state;
        commands
    }

    fn next(&mut self, state: State, event: Event) -> (State, Vec<Command>) {
        match (state, event) {
            (State::Done, _) => (State::Done, Vec::new()),

            // What may happen wherever the view is.
            (_, Event::Cancelled) => (State::Done, vec![Command::Cancel]),
            // Where no other worker is left, what the last one said tells more than that it was the last.
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

            // The frame comes here.
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

            // The client fetches it.
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

    /// The frame is relayed, and so is whatever another worker makes of the view.
    fn relay(&mut self, order: Box<Order>) -> (State, Vec<Command>) {
        self.redirectable = false;
        (State::Ordered(order), vec![Command::Open])
    }

    /// Whether the core looks at the frame first: not once the client has a part of it.
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
                // Said before the client has the last chunk: it may go as soon as it does.
                (State::Done, vec![answered, Command::Send(chunk), Command::CloseStream])
            }
            Ok(Some(chunk)) => (State::Streaming(order), vec![Command::Send(chunk)]),
        }
    }

    /// The client did not get the frame from the worker. If it reaches no worker, the frame that is ordered is relayed.
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

/// An attempt at a relayed frame failed. Another may succeed unless the request itself is at fault.
fn broken(order: &Order, status: Status) -> (State, Vec<Command>) {
    match status.code() {
        Code::InvalidArgument | Code::DeadlineExceeded | Code::Unimplemented => {
            let failed = Command::Failed { attempt: order.attempt, failure: Failure::Final };
            (State::Done, vec![failed, Command::Fail(status)])
        }
        // The worker does not work.
        Code::Unavailable | Code::Internal | Code::DataLoss | Code::Unknown => {
            retry(order, Failure::OfWorker, Some(status))
        }
        // It has no room, or may not do what it was asked.
        _ => retry(order, Failure::TryElsewhere, Some(status)),
    }
}

fn retry(order: &Order, failure: Failure, failed: Option<Status>) -> (State, Vec<Command>) {
    (State::Queued { failed }, vec![Command::Failed { attempt: order.attempt, failure }])
}

fn answered(order: &Order, header: Option<Box<v1::FrameHeader>>, relayed: bool) -> Answered {
    let uncovered = header.as_deref().map(uncovered);
    let ms = header.as_deref().filter(|_| !order.judged).map(rendering_ms);
    Answered { attempt: order.attempt, header, uncovered, ms, relayed }
}

#[cfg(test)]
mod tests;

//! A session: one moving camera. The newest position wins, frames are acknowledged, nobody gets stale ones.
//!
//! Cameras go into a slot of capacity one: a camera that is still there when the next one comes was never
//! rendered and is counted as superseded. One view is in work at a time, and at most [`WINDOW`] frames are on
//! their way to the client unacknowledged, so that a slow client gets fewer frames instead of older ones. A client that
//! can reach workers is sent there for its frames (`redirect`), one at a time.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_proto::status::{invalid, invalid_field, retry_after};
use argus_proto::trace::{TARGET, continued_from};
use argus_proto::v1::session_request::Body as Asked;
use argus_proto::v1::session_response::Body as Answer;
use argus_proto::{Fault, v1};
use argus_scene::{InvalidField, Search, View};
use futures::{Stream, StreamExt};
use parking_lot::Mutex;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};
use tokio::sync::Notify;
use tokio::time::Instant;
use tonic::{Status, Streaming};
use tracing::debug_span;

use super::hub::Hub;
use super::redirect::{Away, Detours, MOST_MISSES, Word};
use super::relay::{Wanted, ask, ordered, relay_from};
use super::views::{checked, checked_encoding};
use crate::core::{Client, Event};

/// Frames on their way: one that arrives while the next one leaves keeps the line busy without a queue.
const WINDOW: usize = 2;

/// What the client's side of a session said so far.
#[derive(Default)]
struct Inbox {
    /// The newest camera that is not in work.
    newest: Option<(u64, v1::SessionView, Instant)>,
    last_seq: Option<u64>,
    superseded: u64,
    /// Frames in work or sent, and not acknowledged. From the moment that work on one begins: its
    /// acknowledgement may arrive before the end of its stream was seen here.
    on_their_way: BTreeSet<u64>,
    /// What was said last of a frame that was sent, or that was to be fetched elsewhere.
    word: Option<(u64, Word)>,
    closed: bool,
}

/// The inbox and the bell that rings when it changes.
#[derive(Default)]
struct Shared {
    inbox: Mutex<Inbox>,
    changed: Notify,
}

/// Counts the session while it lasts.
pub(super) struct Open {
    hub: Arc<Hub>,
    client: Client,
}

impl Open {
    /// # Errors
    /// If the client may not open one now.
    pub(super) fn new(hub: Arc<Hub>, client: Client) -> Result<Self, Fault> {
        hub.open_session(&client)?;
        Ok(Self { hub, client })
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        self.hub.step(Event::SessionClosed { client: self.client.clone() });
    }
}

/// Answers the cameras of one client until it closes its side, or the coordinator closes.
pub(super) fn run(
    open: Open,
    requests: Streaming<v1::SessionRequest>,
) -> impl Stream<Item = Result<v1::SessionResponse, Status>> {
    async_stream::try_stream! {
        let hub = open.hub.clone();
        hub.check_leading()?;
        let shared = Arc::new(Shared::default());
        let reader = listen(hub.clone(), requests, shared.clone());
        tokio::pin!(reader);
        let mut reading = true;
        let mut detours = Detours::default();
        let mut history = None;
        loop {
            // Listening goes on within this task, so that it ends with it.
            // It comes first: what has arrived meanwhile overtakes what waits.
            let taken = tokio::select! {
                biased;
                () = &mut reader, if reading => { reading = false; continue }
                taken = take(&shared) => taken,
                () = hub.closing.cancelled() => None,
            };
            let Some(taken) = taken else { return };
            let camera_seq = taken.0;
            let client = open.client.clone();
            let name = match taken.1.history {
                true => history.get_or_insert_with(drawn_name).clone(),
                false => String::new(),
            };
            // In memory of its own: most sessions wait for a camera most of the time.
            let mut answers =
                Box::pin(frames(hub.clone(), client, taken, name, shared.clone(), &mut detours));
            let mut failed = false;
            loop {
                let answer = tokio::select! {
                    answer = answers.next() => answer,
                    () = &mut reader, if reading => { reading = false; continue }
                };
                let Some(body) = answer else { break };
                if matches!(body, Answer::Failure(_)) {
                    failed = true;
                    // Another coordinator leads now: the session is to be opened there, and nothing has failed.
                    hub.check_leading()?;
                }
                let superseded = shared.inbox.lock().superseded;
                yield v1::SessionResponse { camera_seq, superseded, body: Some(body) };
            }
            if failed {
                shared.inbox.lock().on_their_way.remove(&camera_seq);
            }
        }
    }
}

impl Inbox {
    /// Takes in what the client says; whether a camera was superseded by it.
    fn take_in(&mut self, request: v1::SessionRequest) -> bool {
        let camera_seq = request.camera_seq;
        match request.body {
            Some(Asked::View(view)) => {
                // Sequence numbers ascend; one that does not was overtaken on its way.
                let overtaken = self.last_seq.is_some_and(|last| camera_seq <= last);
                let superseded = overtaken || {
                    self.last_seq = Some(camera_seq);
                    self.newest.replace((camera_seq, view, Instant::now())).is_some()
                };
                self.superseded += u64::from(superseded);
                return superseded;
            }
            // Frames arrive in order, so an acknowledgement covers all before it.
            Some(Asked::Ack(ack)) => {
                self.on_their_way.retain(|seq| *seq > camera_seq);
                self.word = Some((camera_seq, Word::Arrived(ack.receipt)));
            }
            Some(Asked::Missed(missed)) => self.word = Some((camera_seq, Word::Missed(missed))),
            None => {}
        }
        false
    }

    /// The newest camera, if the client has room for its frame. One that closed its side cannot say that it has.
    fn hand_out(&mut self) -> Option<(u64, v1::SessionView, Instant)> {
        if !self.closed && self.on_their_way.len() >= WINDOW {
            return None;
        }
        let newest = self.newest.take()?;
        self.on_their_way.insert(newest.0);
        Some(newest)
    }
}

/// What a session makes of a client's words, for fuzzing.
pub(crate) fn hear(requests: impl Iterator<Item = v1::SessionRequest>) {
    let mut inbox = Inbox::default();
    let (mut views, mut handed_out) = (0, 0);
    for request in requests {
        views += u64::from(matches!(request.body, Some(Asked::View(_))));
        inbox.take_in(request);
        handed_out += u64::from(inbox.hand_out().is_some());
        assert!(inbox.on_their_way.len() <= WINDOW, "more frames are on their way than fit");
        let waits = u64::from(inbox.newest.is_some());
        assert_eq!(views, handed_out + inbox.superseded + waits, "a camera is lost");
        inbox.word.take();
    }
}

/// Puts what the client says into the inbox, until it says no more.
async fn listen(hub: Arc<Hub>, mut requests: Streaming<v1::SessionRequest>, shared: Arc<Shared>) {
    while let Ok(Some(request)) = requests.message().await {
        let superseded = shared.inbox.lock().take_in(request);
        if superseded {
            hub.step(Event::CameraSuperseded);
        }
        shared.changed.notify_one();
    }
    shared.inbox.lock().closed = true;
    shared.changed.notify_one();
}

/// The newest camera once the client has room for its frame; `None` when there will be no more. A client that
/// closed its side cannot acknowledge, and its newest camera is still answered.
async fn take(shared: &Shared) -> Option<(u64, v1::SessionView, Instant)> {
    loop {
        {
            let mut inbox = shared.inbox.lock();
            if let Some(newest) = inbox.hand_out() {
                return Some(newest);
            }
            if inbox.closed {
                return None;
            }
        }
        shared.changed.notified().await;
    }
}

/// What the client says of the frame of that camera.
async fn word(shared: &Shared, camera_seq: u64) -> Word {
    loop {
        {
            let mut inbox = shared.inbox.lock();
            match inbox.word.take() {
                Some((of, word)) if of == camera_seq => return word,
                // Of a frame before it.
                _ if inbox.closed => return Word::no_more(),
                _ => {}
            }
        }
        shared.changed.notified().await;
    }
}

/// A name for what a session's frames leave at workers, that no other session has.
fn drawn_name() -> String {
    format!("{:032x}", SmallRng::from_os_rng().random::<u128>())
}

/// A view whose search may begin from an earlier frame: by the one search that can.
fn begun_from_history(mut view: View) -> Result<View, InvalidField> {
    let reason = match view.plan.search {
        _ if view.pin.is_some() => {
            "a pinned frame is repeated, and none that began from an earlier one can be".to_owned()
        }
        _ if view.plan.direct => "a view from the triangles is not searched".to_owned(),
        Some(search) if search != Search::Seeded => {
            format!("only the seeded search begins from an earlier frame, not the search `{}`", search.name())
        }
        _ => {
            view.plan.search = Some(Search::Seeded);
            return Ok(view);
        }
    };
    Err(InvalidField::new("history", reason))
}

/// The frame of one camera, or where to fetch it, or its failure. `history` names what its session's frames leave at
/// workers; empty: nothing.
fn frames(
    hub: Arc<Hub>,
    client: Client,
    (camera_seq, asked, arrived): (u64, v1::SessionView, Instant),
    history: String,
    shared: Arc<Shared>,
    detours: &mut Detours,
) -> impl Stream<Item = Answer> {
    async_stream::stream! {
        let checks = checked(&hub, asked.view.as_ref())
            .and_then(|view| if asked.history { begun_from_history(view) } else { Ok(view) })
            .and_then(|view| Ok((view, checked_encoding(asked.encoding)?)));
        let (view, encoding) = match checks {
            Ok(checks) => checks,
            Err(at) => {
                yield failure(&invalid(at));
                return;
            }
        };
        let redirectable = asked.redirectable;
        let span = debug_span!(target: TARGET, "relay", camera = camera_seq);
        continued_from(&span, &asked.traceparent);
        let wanted = Wanted {
            client,
            view,
            wire: asked.view.unwrap_or_default(),
            view_id: camera_seq.to_string(),
            deadline: None,
            encoding,
            history,
            arrived,
            span,
        };
        let mut asked = ask(&hub, &wanted);
        let mut ordered = ordered(&mut asked).await;
        let (mut given, mut missed) = (Vec::new(), 0);
        let order = loop {
            let order = match ordered {
                Ok(order) => order,
                Err(fault) => {
                    yield failure(&fault.into());
                    return;
                }
            };
            // One that says no more could not say that it has its frame.
            let detour = match redirectable && missed < MOST_MISSES && !shared.inbox.lock().closed {
                true => detours.of(&hub, &wanted, &order),
                false => None,
            };
            let Some(detour) = detour else { break order };
            yield Answer::Elsewhere(detour.elsewhere.clone());
            given.push(detour);
            let given = &mut given;
            let away = Away { hub: &hub, detours: &mut *detours, given, missed: &mut missed, since: arrived };
            match away.taken(asked, order, || word(&shared, camera_seq)).await {
                Some(open) => (asked, ordered) = open,
                None => return,
            }
        };
        for await chunk in relay_from(hub, wanted, asked, order) {
            match chunk {
                Ok(chunk) => yield Answer::Chunk(chunk),
                Err(status) => yield failure(&status),
            }
        }
    }
}

fn failure(status: &Status) -> Answer {
    Answer::Failure(v1::SessionFailure {
        code: status.code() as i32,
        message: status.message().to_owned(),
        field: invalid_field(status).map(|(field, _)| field).unwrap_or_default(),
        retry_after_ms: retry_after(status)
            .map_or(0, |after| u32::try_from(after.as_millis()).unwrap_or(u32::MAX).max(1)),
    })
}

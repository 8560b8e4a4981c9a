//! What the client's side of a session said and nothing has taken up yet.

use std::collections::BTreeSet;

use argus_proto::v1;
use argus_proto::v1::session_request::Body;
use parking_lot::Mutex;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Frames on their way: one that arrives while the next one leaves keeps the line busy without a queue.
const WINDOW: usize = 2;

/// A camera of a session: its number, what is asked for, and when it arrived.
pub(super) type SessionCamera = (u64, v1::SessionView, Instant);

/// What a client says of a frame that it was sent for.
#[derive(Debug)]
pub(super) enum ClientNotice {
    /// It has it.
    Arrived(Option<v1::Sealed>),
    /// It could not get it, or will not say any more.
    Missed(v1::SessionMissed),
}

impl ClientNotice {
    /// A worker is not reached, whichever ticket is out.
    pub(super) fn unreachable(reason: &str) -> Self {
        Self::Missed(v1::SessionMissed { reason: reason.to_owned(), serial: 0, unreachable: true })
    }
}

#[derive(Default)]
struct ClientMessages {
    /// The newest camera that is not in work.
    newest: Option<SessionCamera>,
    last_seq: Option<u64>,
    superseded: u64,
    /// Frames in work or sent, and not acknowledged. From the moment that work on one begins: its
    /// acknowledgement may arrive before the end of its stream was seen here.
    unacknowledged: BTreeSet<u64>,
    /// What was said last of a frame that was sent, or that was to be fetched elsewhere.
    notice: Option<(u64, ClientNotice)>,
    closed: bool,
}

impl ClientMessages {
    /// Takes in what the client says; whether a camera was superseded by it.
    fn receive(&mut self, request: v1::SessionRequest) -> bool {
        let camera_seq = request.camera_seq;
        match request.body {
            Some(Body::View(view)) => {
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
            Some(Body::Ack(ack)) => {
                self.unacknowledged.retain(|seq| *seq > camera_seq);
                self.notice = Some((camera_seq, ClientNotice::Arrived(ack.receipt)));
            }
            Some(Body::Missed(missed)) => self.notice = Some((camera_seq, ClientNotice::Missed(missed))),
            None => {}
        }
        false
    }

    /// The newest camera, if the client has room for its frame. One that closed its side cannot say that it has.
    fn take_camera(&mut self) -> Option<SessionCamera> {
        if !self.closed && self.unacknowledged.len() >= WINDOW {
            return None;
        }
        let newest = self.newest.take()?;
        self.unacknowledged.insert(newest.0);
        Some(newest)
    }
}

/// What the client's side of a session said so far, and the bell that rings when it says more.
#[derive(Default)]
pub(super) struct Inbox {
    messages: Mutex<ClientMessages>,
    changed: Notify,
}

impl Inbox {
    /// Takes in what the client says; whether a camera was superseded by it.
    pub(super) fn receive(&self, request: v1::SessionRequest) -> bool {
        let superseded = self.messages.lock().receive(request);
        self.changed.notify_one();
        superseded
    }

    /// The client says no more.
    pub(super) fn close(&self) {
        self.messages.lock().closed = true;
        self.changed.notify_one();
    }

    pub(super) fn is_closed(&self) -> bool {
        self.messages.lock().closed
    }

    /// Cameras that were overtaken so far.
    pub(super) fn superseded(&self) -> u64 {
        self.messages.lock().superseded
    }

    /// No frame of that camera is on its way.
    pub(super) fn failed(&self, camera_seq: u64) {
        self.messages.lock().unacknowledged.remove(&camera_seq);
    }

    /// The newest camera once the client has room for its frame; `None` when there will be no more. A client that
    /// closed its side cannot acknowledge, and its newest camera is still answered.
    pub(super) async fn camera(&self) -> Option<SessionCamera> {
        loop {
            {
                let mut messages = self.messages.lock();
                if let Some(newest) = messages.take_camera() {
                    return Some(newest);
                }
                if messages.closed {
                    return None;
                }
            }
            self.changed.notified().await;
        }
    }

    /// What the client says of the frame of that camera.
    pub(super) async fn notice(&self, camera_seq: u64) -> ClientNotice {
        loop {
            {
                let mut messages = self.messages.lock();
                match messages.notice.take() {
                    Some((of, notice)) if of == camera_seq => return notice,
                    // Of a frame before it.
                    _ if messages.closed => return ClientNotice::unreachable("the client says no more"),
                    _ => {}
                }
            }
            self.changed.notified().await;
        }
    }
}

/// What a session makes of a client's messages, for fuzzing.
pub(crate) fn check_inbox(requests: impl Iterator<Item = v1::SessionRequest>) {
    let mut messages = ClientMessages::default();
    let (mut views, mut taken) = (0, 0);
    for request in requests {
        views += u64::from(matches!(request.body, Some(Body::View(_))));
        messages.receive(request);
        taken += u64::from(messages.take_camera().is_some());
        assert!(messages.unacknowledged.len() <= WINDOW, "more frames are on their way than fit");
        let waits = u64::from(messages.newest.is_some());
        assert_eq!(views, taken + messages.superseded + waits, "a camera is lost");
        messages.notice.take();
    }
}

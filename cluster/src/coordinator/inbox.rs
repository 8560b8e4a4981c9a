//! Unprocessed messages of a session's client.

use std::collections::BTreeSet;

use argus_proto::v1;
use argus_proto::v1::session_request::Body;
use parking_lot::Mutex;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Most unacknowledged frames: one that is being sent and one that arrives, which keeps the connection busy without a
/// queue.
const WINDOW: usize = 2;

/// A camera of a session: its sequence number, the requested view, and its time of arrival.
pub(super) type SessionCamera = (u64, v1::SessionView, Instant);

/// A client's notice about a redirected frame.
#[derive(Debug)]
pub(super) enum ClientNotice {
    /// The client has the frame; with the worker's receipt, if it came.
    Arrived(Option<v1::Sealed>),
    /// The client could not fetch the frame, or sends no more messages.
    Missed(v1::SessionMissed),
}

impl ClientNotice {
    /// A notice that no worker can be reached, whatever the ticket.
    pub(super) fn unreachable(reason: &str) -> Self {
        Self::Missed(v1::SessionMissed { reason: reason.to_owned(), serial: 0, unreachable: true })
    }
}

#[derive(Default)]
struct ClientMessages {
    /// The newest camera that was not taken yet.
    newest: Option<SessionCamera>,
    last_seq: Option<u64>,
    superseded: u64,
    /// Cameras whose frames are in work or sent, and not acknowledged. They count from the start of work, since an
    /// acknowledgement may arrive before this process sees the end of the frame's stream.
    unacknowledged: BTreeSet<u64>,
    /// The last notice about a frame, and the frame's camera.
    notice: Option<(u64, ClientNotice)>,
    closed: bool,
}

impl ClientMessages {
    /// Processes a message. Returns whether it superseded a camera.
    fn receive(&mut self, request: v1::SessionRequest) -> bool {
        let camera_seq = request.camera_seq;
        match request.body {
            Some(Body::View(view)) => {
                // Sequence numbers ascend. A lower one was overtaken in transit.
                let overtaken = self.last_seq.is_some_and(|last| camera_seq <= last);
                let superseded = overtaken || {
                    self.last_seq = Some(camera_seq);
                    self.newest.replace((camera_seq, view, Instant::now())).is_some()
                };
                self.superseded += u64::from(superseded);
                return superseded;
            }
            // Frames arrive in order, so an acknowledgement covers all earlier ones.
            Some(Body::Ack(ack)) => {
                self.unacknowledged.retain(|seq| *seq > camera_seq);
                self.notice = Some((camera_seq, ClientNotice::Arrived(ack.receipt)));
            }
            Some(Body::Missed(missed)) => self.notice = Some((camera_seq, ClientNotice::Missed(missed))),
            None => {}
        }
        false
    }

    /// Takes the newest camera, if the window has room for its frame. A client that closed its side cannot
    /// acknowledge, so its window does not count.
    fn take_camera(&mut self) -> Option<SessionCamera> {
        if !self.closed && self.unacknowledged.len() >= WINDOW {
            return None;
        }
        let newest = self.newest.take()?;
        self.unacknowledged.insert(newest.0);
        Some(newest)
    }
}

/// The messages of a session's client, with a notification of new ones.
#[derive(Default)]
pub(super) struct Inbox {
    messages: Mutex<ClientMessages>,
    changed: Notify,
}

impl Inbox {
    /// Processes a message. Returns whether it superseded a camera.
    pub(super) fn receive(&self, request: v1::SessionRequest) -> bool {
        let superseded = self.messages.lock().receive(request);
        self.changed.notify_one();
        superseded
    }

    /// The client closed its side.
    pub(super) fn close(&self) {
        self.messages.lock().closed = true;
        self.changed.notify_one();
    }

    pub(super) fn is_closed(&self) -> bool {
        self.messages.lock().closed
    }

    /// Number of cameras that were superseded so far.
    pub(super) fn superseded(&self) -> u64 {
        self.messages.lock().superseded
    }

    /// Forgets the frame of a camera that failed.
    pub(super) fn failed(&self, camera_seq: u64) {
        self.messages.lock().unacknowledged.remove(&camera_seq);
    }

    /// Waits for a camera and for room in the window. `None` once the client closed its side and every camera was
    /// taken. The last camera of a closed client is still answered.
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

    /// Waits for the client's notice about the frame of a camera.
    pub(super) async fn notice(&self, camera_seq: u64) -> ClientNotice {
        loop {
            {
                let mut messages = self.messages.lock();
                match messages.notice.take() {
                    Some((of, notice)) if of == camera_seq => return notice,
                    // A notice about an earlier frame is dropped.
                    _ if messages.closed => {
                        return ClientNotice::unreachable("the client closed its side of the session");
                    }
                    _ => {}
                }
            }
            self.changed.notified().await;
        }
    }
}

/// Feeds a session's inbox with a client's messages, for fuzzing.
#[cfg(feature = "fuzzing")]
pub(crate) fn check_inbox(requests: impl Iterator<Item = v1::SessionRequest>) {
    let mut messages = ClientMessages::default();
    let (mut views, mut taken) = (0, 0);
    for request in requests {
        views += u64::from(matches!(request.body, Some(Body::View(_))));
        messages.receive(request);
        taken += u64::from(messages.take_camera().is_some());
        assert!(
            messages.unacknowledged.len() <= WINDOW,
            "more frames are unacknowledged than the window allows"
        );
        let waits = u64::from(messages.newest.is_some());
        assert_eq!(views, taken + messages.superseded + waits, "a camera is lost");
        messages.notice.take();
    }
}

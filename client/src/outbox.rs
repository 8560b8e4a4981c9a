//! What a session has to send: the newest camera, and acknowledgements.
//!
//! A queue would deliver bursts of stale cameras after a stall. So a camera waits in a slot where a newer one
//! replaces it, while acknowledgements, of which none may be lost, queue up beside it.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use argus_proto::v1::{self, session_request::Body};
use futures::Stream;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Shared between a session and the stream of its requests.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    state: Mutex<State>,
    changed: Notify,
}

#[derive(Debug, Default)]
struct State {
    camera: Option<(u64, v1::SessionView)>,
    /// What became of frames, by their cameras: arrived or missed.
    words: VecDeque<(u64, Body)>,
    /// Counts the streams handed out; all but the newest end.
    incarnation: u64,
    closed: bool,
    /// No camera leaves before.
    quiet_until: Option<Instant>,
}

impl Outbox {
    /// Replaces the camera that waits, if one does; its number then.
    pub(crate) fn put(&self, camera_seq: u64, view: v1::SessionView) -> Option<u64> {
        let mut state = self.lock();
        let before = state.camera.replace((camera_seq, view)).map(|(camera_seq, _)| camera_seq);
        drop(state);
        self.changed.notify_one();
        before
    }

    /// Puts back the newest camera after it was sent in vain; nothing changes if it still waits.
    pub(crate) fn put_back(&self, camera_seq: u64, view: v1::SessionView) {
        self.lock().camera.get_or_insert((camera_seq, view));
    }

    /// Keeps cameras back for that long.
    pub(crate) fn quiet_for(&self, time: Duration) {
        self.lock().quiet_until = Some(Instant::now() + time);
        self.changed.notify_one();
    }

    /// Queues an acknowledgement, with the receipt of the worker that the frame came from.
    pub(crate) fn acknowledge(&self, camera_seq: u64, receipt: Option<v1::Sealed>) {
        self.say(camera_seq, Body::Ack(v1::SessionAck { receipt }));
    }

    /// Queues that a frame did not come from where it was to be had.
    pub(crate) fn missed(&self, camera_seq: u64, missed: v1::SessionMissed) {
        self.say(camera_seq, Body::Missed(missed));
    }

    fn say(&self, camera_seq: u64, word: Body) {
        self.lock().words.push_back((camera_seq, word));
        self.changed.notify_one();
    }

    /// Ends the stream once acknowledgements are sent.
    pub(crate) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_one();
    }

    /// The requests from now on; a stream handed out before ends. Acknowledgements of frames that came over
    /// the connection before are forgotten, since their session is gone.
    pub(crate) fn stream(self: &Arc<Self>) -> impl Stream<Item = v1::SessionRequest> + Send + use<> {
        let mut state = self.lock();
        state.incarnation += 1;
        state.words.clear();
        let incarnation = state.incarnation;
        drop(state);
        // Wakes the old stream, and leaves a permit for the new one.
        self.changed.notify_waiters();
        self.changed.notify_one();
        futures::stream::unfold(Arc::clone(self), move |outbox| async move {
            loop {
                let changed = outbox.changed.notified();
                match outbox.next(incarnation) {
                    ControlFlow::Break(request) => return request.map(|sent| (sent, Arc::clone(&outbox))),
                    ControlFlow::Continue(None) => changed.await,
                    ControlFlow::Continue(Some(until)) => {
                        // Whichever comes first.
                        let _ = tokio::time::timeout_at(until, changed).await;
                    }
                }
            }
        })
    }

    /// The next request or the end of the stream; `Continue` if there is nothing to send yet, with the time until which a
    /// camera waits if one does.
    fn next(&self, incarnation: u64) -> ControlFlow<Option<v1::SessionRequest>, Option<Instant>> {
        let mut state = self.lock();
        if state.incarnation != incarnation {
            return ControlFlow::Break(None);
        }
        let request = |camera_seq, body| Some(v1::SessionRequest { camera_seq, body: Some(body) });
        if let Some((camera_seq, word)) = state.words.pop_front() {
            return ControlFlow::Break(request(camera_seq, word));
        }
        if state.closed {
            return ControlFlow::Break(None);
        }
        if state.camera.is_some()
            && let Some(until) = state.quiet_until.filter(|until| Instant::now() < *until)
        {
            return ControlFlow::Continue(Some(until));
        }
        match state.camera.take() {
            Some((camera_seq, view)) => ControlFlow::Break(request(camera_seq, Body::View(view))),
            None => ControlFlow::Continue(None),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Every change is a single assignment: a panic elsewhere leaves nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use futures::StreamExt;

    use super::*;

    fn seqs(requests: &[v1::SessionRequest]) -> Vec<(u64, bool)> {
        requests.iter().map(|r| (r.camera_seq, matches!(r.body, Some(Body::Ack(_))))).collect()
    }

    #[tokio::test]
    async fn the_newest_camera_replaces_those_that_wait_and_no_acknowledgement_is_lost() {
        let outbox = Arc::new(Outbox::default());
        for camera_seq in 1..=4 {
            let before = outbox.put(camera_seq, v1::SessionView::default());
            assert_eq!(before, (camera_seq > 1).then(|| camera_seq - 1));
            outbox.acknowledge(camera_seq, None);
        }
        let sent: Vec<_> = outbox.stream().take(1).collect().await;
        // Acknowledgements from before the stream belong to a session that is gone.
        assert_eq!(seqs(&sent), [(4, false)]);
        let stream = outbox.stream();
        for camera_seq in 5..=6 {
            outbox.put(camera_seq, v1::SessionView::default());
            outbox.acknowledge(camera_seq, None);
        }
        let sent: Vec<_> = stream.take(3).collect().await;
        assert_eq!(seqs(&sent), [(5, true), (6, true), (6, false)]);
    }

    #[tokio::test(start_paused = true)]
    async fn cameras_wait_out_a_hint_while_acknowledgements_do_not() {
        let outbox = Arc::new(Outbox::default());
        let mut stream = Box::pin(outbox.stream());
        let begin = Instant::now();
        outbox.quiet_for(Duration::from_secs(2));
        outbox.put(1, v1::SessionView::default());
        outbox.acknowledge(0, None);
        assert_eq!(seqs(&[stream.next().await.unwrap()]), [(0, true)]);
        assert!(begin.elapsed() < Duration::from_secs(1));
        assert_eq!(outbox.put(2, v1::SessionView::default()), Some(1));
        assert_eq!(seqs(&[stream.next().await.unwrap()]), [(2, false)]);
        assert!(begin.elapsed() >= Duration::from_secs(2));
    }

    #[tokio::test]
    async fn an_older_stream_ends_when_a_newer_one_begins() {
        let outbox = Arc::new(Outbox::default());
        let old = tokio::spawn(outbox.stream().collect::<Vec<_>>());
        tokio::task::yield_now().await;
        let new = outbox.stream();
        assert!(old.await.unwrap().is_empty());
        outbox.put(1, v1::SessionView::default());
        outbox.put_back(0, v1::SessionView::default());
        let mut new = Box::pin(new);
        assert_eq!(new.next().await.unwrap().camera_seq, 1);
        outbox.close();
        assert!(new.next().await.is_none());
    }
}

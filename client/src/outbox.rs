//! The outbox of a session: the newest camera, and acknowledgements.
//!
//! A queue would send stale cameras after a stall. So there is one slot for a camera, which a newer one replaces, and
//! a queue for acknowledgements, which must all be sent.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use argus_proto::v1::{self, session_request::Body};
use futures::Stream;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Outbox shared by a session and its request stream.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    state: Mutex<State>,
    changed: Notify,
}

#[derive(Debug, Default)]
struct State {
    camera: Option<(u64, v1::SessionView)>,
    /// Acknowledgements and misses of frames, by camera.
    notices: VecDeque<(u64, Body)>,
    /// Number of streams created; only the newest continues.
    incarnation: u64,
    closed: bool,
    /// No camera is sent before this time.
    quiet_until: Option<Instant>,
}

impl Outbox {
    /// Replaces the waiting camera. Returns the number of the replaced one, if any.
    pub(crate) fn put(&self, camera_seq: u64, view: v1::SessionView) -> Option<u64> {
        let mut state = self.lock();
        let before = state.camera.replace((camera_seq, view)).map(|(camera_seq, _)| camera_seq);
        drop(state);
        self.changed.notify_one();
        before
    }

    /// Returns the newest camera to its slot after a failed transmission, unless a newer one waits.
    pub(crate) fn put_back(&self, camera_seq: u64, view: v1::SessionView) {
        self.lock().camera.get_or_insert((camera_seq, view));
    }

    /// Holds cameras back for a time.
    pub(crate) fn quiet_for(&self, time: Duration) {
        self.lock().quiet_until = Some(Instant::now() + time);
        self.changed.notify_one();
    }

    /// Queues an acknowledgement, with the worker's receipt if the frame was redirected.
    pub(crate) fn acknowledge(&self, camera_seq: u64, receipt: Option<v1::Sealed>) {
        self.notify(camera_seq, Body::Ack(v1::SessionAck { receipt }));
    }

    /// Queues the notice that a redirected frame could not be fetched.
    pub(crate) fn missed(&self, camera_seq: u64, missed: v1::SessionMissed) {
        self.notify(camera_seq, Body::Missed(missed));
    }

    fn notify(&self, camera_seq: u64, notice: Body) {
        self.lock().notices.push_back((camera_seq, notice));
        self.changed.notify_one();
    }

    /// Ends the stream once all acknowledgements are sent.
    pub(crate) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_one();
    }

    /// Creates a stream of requests; the previous stream ends. Queued acknowledgements are dropped, since
    /// their session is gone.
    pub(crate) fn stream(self: &Arc<Self>) -> impl Stream<Item = v1::SessionRequest> + Send + use<> {
        let mut state = self.lock();
        state.incarnation += 1;
        state.notices.clear();
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

    /// The next request, or the end of the stream. `Continue` if there is nothing to send yet, with the time until
    /// which a waiting camera is held back.
    fn next(&self, incarnation: u64) -> ControlFlow<Option<v1::SessionRequest>, Option<Instant>> {
        let mut state = self.lock();
        if state.incarnation != incarnation {
            return ControlFlow::Break(None);
        }
        let request = |camera_seq, body| Some(v1::SessionRequest { camera_seq, body: Some(body) });
        if let Some((camera_seq, notice)) = state.notices.pop_front() {
            return ControlFlow::Break(request(camera_seq, notice));
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
        // Every change is a single assignment, so a panic leaves no half-done state.
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
    async fn the_newest_camera_replaces_waiting_ones_and_no_acknowledgement_is_lost() {
        let outbox = Arc::new(Outbox::default());
        for camera_seq in 1..=4 {
            let before = outbox.put(camera_seq, v1::SessionView::default());
            assert_eq!(before, (camera_seq > 1).then(|| camera_seq - 1));
            outbox.acknowledge(camera_seq, None);
        }
        let sent: Vec<_> = outbox.stream().take(1).collect().await;
        // Earlier acknowledgements belong to a session that is gone.
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
    async fn cameras_wait_for_the_retry_hint_while_acknowledgements_do_not() {
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

//! One session of the soak test, and the comparison of its frames with pinned repeats.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_client::load::CameraPath;
use argus_client::{Client, ClientError, RenderOptions, SessionEvent, SessionOptions};
use argus_scene::{Frame, Output, PlanRequest, Stage, View};
use parking_lot::Mutex;
use tokio::time::{sleep, sleep_until, timeout};
use tokio_util::sync::CancellationToken;

use super::tail::Tail;

/// Longest wait for the answer to a session's last camera.
pub(super) const PATIENCE: Duration = Duration::from_secs(30);

/// What all sessions received.
#[derive(Debug, Default)]
pub(super) struct SessionStats {
    pub(super) sent: u64,
    pub(super) answered: u64,
    pub(super) rejected: u64,
    /// Sessions whose newest camera was not answered, and cameras that failed.
    pub(super) lost: u64,
    /// For each frame, its arrival in seconds since the start and its latency in milliseconds from when its
    /// camera was due.
    pub(super) latencies_ms: Vec<(f64, f64)>,
    /// Where the slowest frames spent their time.
    pub(super) tail: Tail,
    /// Frames fetched from workers rather than relayed.
    pub(super) redirected: u64,
    pub(super) worst_gap: Gap,
    pub(super) first_failure: Option<String>,
    pub(super) checked: u64,
    pub(super) wrong: u64,
    /// Repeats that were not answered, so that nothing was compared.
    pub(super) repeats_failed: u64,
    /// The next frame to compare.
    to_check: Option<(View, Box<Frame>)>,
}

impl SessionStats {
    fn lose(&mut self, why: String) {
        self.lost += 1;
        self.first_failure.get_or_insert(why);
    }

    /// Records that a session waited for a frame since then.
    fn gap(&mut self, since: Option<Instant>) {
        let gap = since.map(|since| Gap { lasts: since.elapsed(), since: Some(since) });
        self.worst_gap = self.worst_gap.max(gap.unwrap_or_default());
    }
}

/// A time in which a session got no frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Gap {
    pub(super) lasts: Duration,
    pub(super) since: Option<Instant>,
}

/// The load of one session.
#[derive(Debug, Clone, Copy)]
pub(super) struct SessionLoad {
    pub(super) index: u32,
    /// Cameras per second.
    pub(super) rate: f64,
    pub(super) size: [u32; 2],
    /// Seconds from the start until the first camera is due.
    pub(super) phase: f64,
}

/// Sends a camera whenever one is due until `ending` is cancelled, then waits for the newest one's frame.
pub(super) async fn run(
    client: Client,
    load: SessionLoad,
    stats: Arc<Mutex<SessionStats>>,
    begin: Instant,
    ending: CancellationToken,
) {
    let path = CameraPath::new(client.description(), load.index);
    let options = SessionOptions { patience: PATIENCE, ..SessionOptions::default() };
    let mut session = client.session(options.clone());
    let mut open: BTreeMap<u64, (Instant, View)> = BTreeMap::new();
    let mut next = 0_u32;
    // Since when the session waits for a frame. A frame ends the wait; a failed camera does not.
    let mut waits: Option<Instant> = None;
    let mut until: Option<Instant> = None;
    loop {
        let secs = load.phase + f64::from(next) / load.rate;
        let due = until.unwrap_or(begin + Duration::from_secs_f64(secs));
        let idle = session.is_idle();
        if until.is_some() && idle {
            return stats.lock().gap(waits);
        }
        tokio::select! {
            biased;
            () = ending.cancelled(), if until.is_none() => until = Some(Instant::now() + PATIENCE),
            () = sleep_until(due.into()) => {
                if until.is_some() {
                    let mut stats = stats.lock();
                    stats.gap(waits);
                    return stats.lose("a session's newest camera was not answered".to_owned());
                }
                let view = View::new(path.camera(secs), load.size, PlanRequest::default());
                open.insert(session.send(&view), (due, view));
                waits.get_or_insert(due);
                next += 1;
                stats.lock().sent += 1;
            }
            event = session.next(), if !idle => match event {
                Ok(SessionEvent::Frame { camera_seq, frame, .. }) => {
                    let now = Instant::now();
                    let newer = open.split_off(&(camera_seq + 1));
                    let answered = std::mem::replace(&mut open, newer).remove(&camera_seq);
                    let waited = waits.take();
                    if !session.is_idle() {
                        waits = Some(now);
                    }
                    let fetched = frame.stages.iter().any(|stage| stage.name == Stage::DETOUR);
                    let mut stats = stats.lock();
                    stats.gap(waited);
                    stats.answered += 1;
                    stats.redirected += u64::from(fetched);
                    if let Some((due, view)) = answered {
                        let ms = now.saturating_duration_since(due).as_secs_f64() * 1e3;
                        stats.latencies_ms.push(((now - begin).as_secs_f64(), ms));
                        stats.tail.push(ms, &frame.stages);
                        stats.to_check.get_or_insert((view, frame));
                    }
                }
                Ok(SessionEvent::Failed { camera_seq, error }) => {
                    open = open.split_off(&(camera_seq + 1));
                    let mut stats = stats.lock();
                    stats.gap(waits);
                    match error {
                        ClientError::Overloaded { .. } => stats.rejected += 1,
                        error => stats.lose(error.to_string()),
                    }
                }
                Err(error) => {
                    {
                        let mut stats = stats.lock();
                        stats.gap(waits);
                        stats.lose(error.to_string());
                    }
                    open.clear();
                    session = client.session(options.clone());
                }
            },
        }
    }
}

/// From time to time repeats a session's view, pinned to its frame's provenance: the bytes must be equal.
pub(super) async fn check(client: Client, stats: Arc<Mutex<SessionStats>>) {
    loop {
        sleep(Duration::from_millis(500)).await;
        let taken = stats.lock().to_check.take();
        let Some((view, frame)) = taken else { continue };
        let repeat = View { pin: Some(frame.provenance.clone()), ..view };
        let options = RenderOptions { deadline: 2 * PATIENCE, ..RenderOptions::default() };
        let Ok(Ok(answer)) = timeout(PATIENCE, client.render(&repeat, &options)).await else {
            stats.lock().repeats_failed += 1;
            continue;
        };
        let same = frame.images[Output::Color].is_some()
            && frame.images[Output::Color] == answer.frame.images[Output::Color];
        let mut stats = stats.lock();
        stats.checked += 1;
        stats.wrong += u64::from(!same);
    }
}

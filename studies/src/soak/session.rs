//! One session of the soak test, and the comparison of what sessions got with pinned repeats.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_client::load::CameraPath;
use argus_client::{Client, ClientError, SessionEvent, SessionOptions};
use argus_scene::{Frame, Outputs, PlanRequest, Stage, View};
use parking_lot::Mutex;
use tokio::time::{sleep, sleep_until, timeout};
use tokio_util::sync::CancellationToken;

use super::tail::Tail;
use super::{PATIENCE, color, pinned, repeat_options};

/// What all sessions heard.
#[derive(Debug, Default)]
pub(super) struct Heard {
    pub(super) sent: u64,
    pub(super) answered: u64,
    pub(super) rejected: u64,
    /// Sessions whose newest camera was not answered, and cameras that failed.
    pub(super) lost: u64,
    /// When each frame came, seconds from the beginning, and how long after its camera was due.
    pub(super) latencies_ms: Vec<(f64, f64)>,
    /// Where the slowest of them spent their time.
    pub(super) tail: Tail,
    /// Frames that sessions fetched from workers, instead of having them relayed.
    pub(super) redirected: u64,
    pub(super) worst_gap: Gap,
    pub(super) first_failure: Option<String>,
    pub(super) checked: u64,
    pub(super) wrong: u64,
    /// Repeats that were not answered, so that nothing was compared.
    pub(super) repeats_failed: u64,
    /// The frame that is to be compared next.
    to_check: Option<(View, Box<Frame>)>,
}

impl Heard {
    fn lose(&mut self, why: String) {
        self.lost += 1;
        self.first_failure.get_or_insert(why);
    }

    /// A session got no frame since then, though it had asked for one.
    fn gap(&mut self, since: Option<Instant>) {
        let gap = since.map(|since| Gap { lasts: since.elapsed(), since: Some(since) });
        self.worst_gap = self.worst_gap.max(gap.unwrap_or_default());
    }
}

/// How long a session got no frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Gap {
    pub(super) lasts: Duration,
    pub(super) since: Option<Instant>,
}

/// What a session asks for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asks {
    pub(super) index: u32,
    /// Cameras a second.
    pub(super) rate: f64,
    pub(super) size: [u32; 2],
    /// Seconds after the beginning that the first is due.
    pub(super) phase: f64,
}

/// Moves the camera when it is due, whatever comes back, until it is told to end; then waits for the newest one's frame.
pub(super) async fn run(
    client: Client,
    asks: Asks,
    heard: Arc<Mutex<Heard>>,
    begin: Instant,
    ending: CancellationToken,
) {
    let path = CameraPath::new(client.description(), asks.index);
    let options = SessionOptions { patience: PATIENCE, ..SessionOptions::default() };
    let mut session = client.session(options.clone());
    let mut open: BTreeMap<u64, (Instant, View)> = BTreeMap::new();
    let mut next = 0_u32;
    // Since when it waits for a frame: until one comes, whatever becomes of single cameras meanwhile.
    let mut waits: Option<Instant> = None;
    let mut until: Option<Instant> = None;
    loop {
        let secs = asks.phase + f64::from(next) / asks.rate;
        let due = until.unwrap_or(begin + Duration::from_secs_f64(secs));
        let idle = session.is_idle();
        if until.is_some() && idle {
            return heard.lock().gap(waits);
        }
        tokio::select! {
            biased;
            () = ending.cancelled(), if until.is_none() => until = Some(Instant::now() + PATIENCE),
            () = sleep_until(due.into()) => {
                if until.is_some() {
                    let mut heard = heard.lock();
                    heard.gap(waits);
                    return heard.lose("a session's newest camera was not answered".to_owned());
                }
                let view = View {
                    camera: path.camera(secs),
                    width: asks.size[0],
                    height: asks.size[1],
                    outputs: Outputs::COLOR,
                    plan: PlanRequest::default(),
                    pin: None,
                };
                open.insert(session.send(&view), (due, view));
                waits.get_or_insert(due);
                next += 1;
                heard.lock().sent += 1;
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
                    let mut heard = heard.lock();
                    heard.gap(waited);
                    heard.answered += 1;
                    heard.redirected += u64::from(fetched);
                    if let Some((due, view)) = answered {
                        let ms = now.saturating_duration_since(due).as_secs_f64() * 1e3;
                        heard.latencies_ms.push(((now - begin).as_secs_f64(), ms));
                        heard.tail.push(ms, &frame.stages);
                        heard.to_check.get_or_insert((view, frame));
                    }
                }
                Ok(SessionEvent::Failed { camera_seq, error }) => {
                    open = open.split_off(&(camera_seq + 1));
                    let mut heard = heard.lock();
                    heard.gap(waits);
                    match error {
                        ClientError::Overloaded { .. } => heard.rejected += 1,
                        error => heard.lose(error.to_string()),
                    }
                }
                Err(error) => {
                    {
                        let mut heard = heard.lock();
                        heard.gap(waits);
                        heard.lose(error.to_string());
                    }
                    open.clear();
                    session = client.session(options.clone());
                }
            },
        }
    }
}

/// Now and then asks once more for a frame that a session got, pinned to its provenance: the bytes must be the same.
pub(super) async fn check(client: Client, heard: Arc<Mutex<Heard>>) {
    loop {
        sleep(Duration::from_millis(500)).await;
        let taken = heard.lock().to_check.take();
        let Some((view, frame)) = taken else { continue };
        let repeat = pinned(&view, frame.provenance.clone());
        let Ok(Ok(answer)) = timeout(PATIENCE, client.render(&repeat, &repeat_options())).await else {
            heard.lock().repeats_failed += 1;
            continue;
        };
        let same = matches!((color(&frame), color(&answer.frame)), (Ok(a), Ok(b)) if a == b);
        let mut heard = heard.lock();
        heard.checked += 1;
        heard.wrong += u64::from(!same);
    }
}

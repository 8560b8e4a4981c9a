//! Sessions: frames of a moving camera.
//!
//! A task of its own keeps the session going while the caller does other things: cameras are sent at once, and frames are
//! acknowledged as they come. The newest frame waits for the caller, and replaces an older one.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use argus_client::{ClientError, FrameMeta, SessionEvent};
use argus_scene::{Frame, Limits};
use pyo3::prelude::*;
use tokio::sync::{Notify, mpsc};
use tokio::time::timeout;

use crate::client::secs;
use crate::error::{exception, invalid, misused};
use crate::images::{self, Array, Images};
use crate::report::Report;
use crate::runtime::Home;
use crate::wanted::{LensRow, Pose, Wanted, camera};

/// Cameras on their way to the task, which takes them at once.
const MOST_WAITING: usize = 64;

/// A session of a moving camera. Threads may share it.
#[pyclass(frozen, module = "argus_render._native")]
pub(crate) struct Session {
    home: Home,
    wanted: Wanted,
    limits: Limits,
    cameras: Mutex<Cameras>,
    newest: Arc<Newest>,
}

/// The way to the task, and how many cameras went it.
struct Cameras {
    sender: Option<mpsc::Sender<argus_scene::View>>,
    sent: u64,
}

/// A frame, or the failure of a camera.
type Outcome = Result<(Box<Frame>, FrameMeta), ClientError>;

/// The newest outcome that the caller has not taken.
#[derive(Default)]
struct Newest {
    slot: Mutex<Slot>,
    changed: Notify,
}

#[derive(Default)]
struct Slot {
    outcome: Option<(u64, Outcome)>,
    /// Why no more will come.
    ended: Option<ClientError>,
}

impl Session {
    pub(crate) fn begin(session: argus_client::Session, wanted: Wanted, limits: Limits, home: Home) -> Self {
        let (sender, cameras) = mpsc::channel(MOST_WAITING);
        let newest = Arc::new(Newest::default());
        home.spawn(carry(session, cameras, newest.clone()));
        let cameras = Mutex::new(Cameras { sender: Some(sender), sent: 0 });
        Self { home, wanted, limits, cameras, newest }
    }
}

#[pymethods]
impl Session {
    /// Sends a camera and returns its number, from 1. It replaces cameras that are not rendered yet.
    fn send(&self, py: Python<'_>, pose: Pose, lens: LensRow) -> PyResult<u64> {
        self.home.check(py)?;
        let view = self.wanted.view(camera(py, &pose, &lens)?);
        view.validate(&self.limits).map_err(|error| invalid(py, error.field, error.reason))?;
        let sent = py.detach(|| {
            let mut cameras = locked(&self.cameras);
            let sender = cameras.sender.as_ref()?;
            sender.blocking_send(view).ok()?;
            cameras.sent += 1;
            Some(cameras.sent)
        });
        sent.ok_or_else(|| self.over(py))
    }

    /// Waits up to `timeout` seconds for the newest frame, and writes its images into the caller's arrays. Returns its
    /// camera's number and its report as JSON.
    fn frame(&self, py: Python<'_>, mut arrays: Vec<Array<'_>>, timeout: f64) -> PyResult<(u64, String)> {
        let longest = secs(py, timeout)?;
        let mut images = Images::of(py, &mut arrays, 1, self.wanted.pixels())?;
        let taken = self.home.wait(py, async {
            let (seq, outcome) =
                self::timeout(longest, self.newest.take()).await.map_err(|_| ClientError::Deadline {
                    after: longest,
                    last: "no frame of this session came in this time".to_owned(),
                })??;
            let (frame, meta) = outcome?;
            images::copy(&mut images, 0, &frame)?;
            Ok((seq, Report::of(&frame, &meta).text()?))
        })?;
        taken.map_err(|error| exception(py, &error))
    }

    /// Ends the session. What has not been taken is dropped.
    fn close(&self, py: Python<'_>) {
        py.detach(|| locked(&self.cameras).sender = None);
    }
}

impl Session {
    /// The exception of a session that takes no more cameras.
    fn over(&self, py: Python<'_>) -> PyErr {
        match &locked(&self.newest.slot).ended {
            Some(error) => exception(py, error),
            None => misused(py, "the session is closed"),
        }
    }
}

impl Newest {
    /// Waits for an outcome.
    ///
    /// # Errors
    /// Why the session ended.
    async fn take(&self) -> Result<(u64, Outcome), ClientError> {
        loop {
            {
                let mut slot = locked(&self.slot);
                if let Some(outcome) = slot.outcome.take() {
                    return Ok(outcome);
                }
                if let Some(error) = &slot.ended {
                    return Err(error.clone());
                }
            }
            self.changed.notified().await;
        }
    }

    fn put(&self, change: impl FnOnce(&mut Slot)) {
        change(&mut locked(&self.slot));
        self.changed.notify_one();
    }
}

/// Carries cameras and outcomes until the caller closes the session or it fails.
async fn carry(
    mut session: argus_client::Session,
    mut cameras: mpsc::Receiver<argus_scene::View>,
    newest: Arc<Newest>,
) {
    loop {
        let event = tokio::select! {
            view = cameras.recv() => match view {
                Some(view) => {
                    session.send(&view);
                    continue;
                }
                None => {
                    let reason = "the session is closed".to_owned();
                    let ended = ClientError::Invalid { field: "session".to_owned(), reason };
                    return newest.put(|slot| slot.ended = Some(ended));
                }
            },
            event = session.next() => event,
        };
        match event {
            Ok(SessionEvent::Frame { camera_seq, frame, meta }) => {
                newest.put(|slot| slot.outcome = Some((camera_seq, Ok((frame, meta)))));
            }
            Ok(SessionEvent::Failed { camera_seq, error }) => {
                newest.put(|slot| slot.outcome = Some((camera_seq, Err(error))));
            }
            Err(error) => return newest.put(|slot| slot.ended = Some(error)),
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

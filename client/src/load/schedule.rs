//! What the clients of a load send, and when.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1::Encoding;
use argus_scene::{Camera, Frame, PlanRequest, View};
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use crate::ClientError;

/// How the clients of a load send views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Each view is a request of its own, and must be answered.
    #[default]
    Requests,
    /// Each client has a session: newer cameras supersede older ones.
    Sessions,
}

/// Options of a load.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadOptions {
    /// Number of clients, each on its own path.
    pub clients: u32,
    /// How long views are sent. Answers are awaited until their deadline.
    pub duration: Duration,
    /// Views per second of each client.
    pub rate: f64,
    /// View size in pixels: width, height.
    pub size: [u32; 2],
    /// The requested plan, such as direct views.
    pub plan: PlanRequest,
    /// Whether views are requests or session cameras.
    pub mode: Mode,
    /// Whether sessions' searches may start from the previous frame (reprojection).
    pub history: bool,
    /// Encoding of images on the wire.
    pub encoding: Encoding,
    /// A view without an answer after this time has failed.
    pub deadline: Duration,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            clients: 16,
            duration: Duration::from_secs(10),
            rate: 10.0,
            size: [200, 150],
            plan: PlanRequest::default(),
            mode: Mode::Requests,
            history: false,
            encoding: Encoding::Unspecified,
            deadline: Duration::from_secs(10),
        }
    }
}

impl LoadOptions {
    /// Views that each client sends: at least 1.
    pub fn views_per_client(&self) -> u64 {
        (self.duration.as_secs_f64() * self.rate).ceil().max(1.0) as u64
    }
}

/// Cameras of a load, by client (from 0) and seconds since its first view was due.
///
/// The function must be deterministic, since loads with the same cameras are compared.
pub type Cameras = Arc<dyn Fn(u32, f64) -> Camera + Send + Sync>;

/// How one view of a load ended.
#[derive(Debug, Clone)]
pub struct Ended {
    /// The client, counted from 0.
    pub client: u32,
    /// The view's number within its client, counted from 0.
    pub index: u64,
    /// The view that was requested.
    pub view: View,
    /// When it was due.
    pub due: Instant,
    /// When its frame was whole or its failure known.
    pub at: Instant,
    /// The frame, or its error.
    pub outcome: Result<Frame, ClientError>,
}

/// The times and cameras of one client's views.
#[derive(Clone)]
pub(super) struct Schedule {
    pub(super) client: u32,
    pub(super) cameras: Cameras,
    pub(super) size: [u32; 2],
    pub(super) plan: PlanRequest,
    /// Offset from the start, so that the clients' views are spread over an interval.
    pub(super) phase: Duration,
    pub(super) rate: f64,
    pub(super) views: u64,
}

impl fmt::Debug for Schedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { client, phase, rate, views, .. } = self;
        write!(f, "client {client}: {views} views, {rate} a second from {phase:?} on")
    }
}

impl Schedule {
    /// Each view and when it is due after the start, ascending.
    pub(super) fn due(&self) -> impl Iterator<Item = (Duration, View)> {
        (0..self.views).map(|i| {
            let secs = i as f64 / self.rate;
            (self.phase + Duration::from_secs_f64(secs), self.view(secs))
        })
    }

    pub(super) fn view(&self, secs: f64) -> View {
        View::new((self.cameras)(self.client, secs), self.size, self.plan)
    }
}

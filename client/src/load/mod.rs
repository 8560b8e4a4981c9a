//! Open-loop load generator.
//!
//! The time at which each view is due is fixed beforehand, and latency counts from then. A closed loop, which sends
//! the next view after the last answer, sends nothing while the service stalls, and so hides the stall from its
//! percentiles.

mod burst;
mod direct;
mod path;
mod report;
mod requests;
mod sessions;

pub use burst::{BurstReport, IN_FLIGHT, burst, path_views, patient};
pub use direct::direct_view;
pub use path::CameraPath;
pub use report::{LatencyMs, LoadReport};

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1::Encoding;
use argus_scene::{Camera, Frame, InvalidField, Outputs, PlanRequest, View};
use serde::{Deserialize, Serialize};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::{Client, ClientError};
use report::Tally;

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

/// Runs a load and counts the outcomes. Clients move along the paths of [`CameraPath`].
///
/// # Errors
/// [`ClientError::Invalid`] for options without load or views that the service cannot accept. Failures under load
/// are counted
/// instead.
pub async fn run(client: &Client, options: &LoadOptions) -> Result<LoadReport, ClientError> {
    let description = client.description().clone();
    let cameras = move |index, secs| CameraPath::new(&description, index).camera(secs);
    run_along(client, options, Arc::new(cameras), |_| ()).await
}

/// Runs a load with the given cameras, and calls `ended` with each view as it ends. Superseded session cameras are
/// counted only.
///
/// # Errors
/// [`ClientError::Invalid`] for options without load or views that the service cannot accept. Failures under load
/// are counted
/// and passed to `ended` instead.
pub async fn run_along(
    client: &Client,
    options: &LoadOptions,
    cameras: Cameras,
    mut ended: impl FnMut(Ended),
) -> Result<LoadReport, ClientError> {
    let schedules = check(client, options, &cameras)?;
    let begin = Instant::now();
    let (report, mut endings) = mpsc::unbounded_channel();
    // Dropping the set ends the clients if the caller drops this future.
    let mut clients = JoinSet::new();
    for schedule in schedules {
        let (client, options, report) = (client.clone(), options.clone(), report.clone());
        clients.spawn(async move {
            match options.mode {
                Mode::Requests => requests::run(client, options, schedule, begin, report).await,
                Mode::Sessions => sessions::run(client, options, schedule, begin, report).await,
            }
        });
    }
    drop(report);
    while let Some(ending) = endings.recv().await {
        ended(ending);
    }
    let mut total = Tally::new();
    for tally in clients.join_all().await {
        total.merge(&tally);
    }
    Ok(total.report(options.duration))
}

/// The times and cameras of one client's views.
#[derive(Clone)]
struct Schedule {
    client: u32,
    cameras: Cameras,
    size: [u32; 2],
    plan: PlanRequest,
    /// Offset from the start, so that the clients' views are spread over an interval.
    phase: Duration,
    rate: f64,
    views: u64,
}

impl fmt::Debug for Schedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { client, phase, rate, views, .. } = self;
        write!(f, "client {client}: {views} views, {rate} a second from {phase:?} on")
    }
}

impl Schedule {
    /// Each view and when it is due after the start, ascending.
    fn due(&self) -> impl Iterator<Item = (Duration, View)> {
        (0..self.views).map(|i| {
            let secs = i as f64 / self.rate;
            (self.phase + Duration::from_secs_f64(secs), self.view(secs))
        })
    }

    fn view(&self, secs: f64) -> View {
        View {
            camera: (self.cameras)(self.client, secs),
            width: self.size[0],
            height: self.size[1],
            outputs: Outputs::COLOR,
            plan: self.plan,
            pin: None,
        }
    }
}

fn check(
    client: &Client,
    options: &LoadOptions,
    cameras: &Cameras,
) -> Result<impl Iterator<Item = Schedule> + use<>, ClientError> {
    let invalid = |at: InvalidField| ClientError::Invalid { field: at.field.to_owned(), reason: at.reason };
    if options.clients == 0 {
        return Err(invalid(InvalidField::new("clients", "must be at least 1")));
    }
    if !(options.rate > 0.0 && options.rate <= 1e6) {
        let reason = format!("must be above 0 and at most a million views a second, not {}", options.rate);
        return Err(invalid(InvalidField::new("rate", reason)));
    }
    let (clients, rate, size, plan) = (options.clients, options.rate, options.size, options.plan);
    let (cameras, views) = (cameras.clone(), options.views_per_client());
    let schedule = move |client: u32| Schedule {
        client,
        cameras: cameras.clone(),
        size,
        plan,
        phase: Duration::from_secs_f64(f64::from(client) / (f64::from(clients) * rate)),
        rate,
        views,
    };
    schedule(0).view(0.0).validate(&client.description().limits).map_err(invalid)?;
    Ok((0..clients).map(schedule))
}

#[cfg(test)]
mod tests;

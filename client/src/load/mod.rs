//! Load that does not wait for the service.
//!
//! The generator is open-loop: when each view is due is fixed before the first is sent, and latency is counted
//! from when it was due. A closed loop, which sends the next view when the last one is answered, stops
//! asking exactly while the service stalls, and so leaves the stall out of its percentiles.

mod burst;
mod path;
mod report;
mod requests;
mod sessions;

pub use burst::{BurstReport, burst, path_views};
pub use path::CameraPath;
pub use report::{LatencyMs, LoadReport};

use std::time::Duration;

use argus_proto::v1::Encoding;
use argus_scene::{InvalidField, Outputs, PlanRequest, View};
use serde::{Deserialize, Serialize};
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::{Client, ClientError};
use report::Tally;

/// How each client asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Each view a request of its own, every one of which is to be answered.
    #[default]
    Requests,
    /// A session: newer cameras supersede older ones.
    Sessions,
}

/// What to load a service with.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadOptions {
    /// Clients, each on a path of its own.
    pub clients: u32,
    /// Views are sent for this long; answers are waited for until their deadline.
    pub duration: Duration,
    /// Views a second, of each client.
    pub rate: f64,
    /// Pixels: width, height.
    pub size: [u32; 2],
    /// Wishes about the plan, such as direct views.
    pub plan: PlanRequest,
    /// Whether views are requests or cameras of sessions.
    pub mode: Mode,
    /// Whether the searches of sessions may begin from the frame before.
    pub history: bool,
    /// How images travel.
    pub encoding: Encoding,
    /// A view without an answer for this long has failed.
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

/// Loads a service for as long as the options say, and counts.
///
/// # Errors
/// [`ClientError::Invalid`] for options that name no load or views that the service would not accept. What
/// goes wrong under the load is counted and not returned.
pub async fn run(client: &Client, options: &LoadOptions) -> Result<LoadReport, ClientError> {
    let schedules = check(client, options)?;
    let begin = Instant::now();
    // Ends the clients with this call, should its caller drop it.
    let mut clients = JoinSet::new();
    for schedule in schedules {
        let (client, options) = (client.clone(), options.clone());
        clients.spawn(async move {
            match options.mode {
                Mode::Requests => requests::run(client, options, schedule, begin).await,
                Mode::Sessions => sessions::run(client, options, schedule, begin).await,
            }
        });
    }
    let mut total = Tally::new();
    for tally in clients.join_all().await {
        total.merge(&tally);
    }
    Ok(total.report(options.duration))
}

/// When one client's views are due, and what they show.
#[derive(Debug, Clone)]
struct Schedule {
    path: CameraPath,
    size: [u32; 2],
    plan: PlanRequest,
    /// After the beginning, so that the clients' views are spread over an interval.
    phase: Duration,
    rate: f64,
    views: u64,
}

impl Schedule {
    /// Each view with when it is due after the beginning, ascending.
    fn due(&self) -> impl Iterator<Item = (Duration, View)> {
        (0..self.views).map(|i| {
            let secs = i as f64 / self.rate;
            (self.phase + Duration::from_secs_f64(secs), self.view(secs))
        })
    }

    fn view(&self, secs: f64) -> View {
        View {
            camera: self.path.camera(secs),
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
) -> Result<impl Iterator<Item = Schedule> + use<>, ClientError> {
    let invalid = |at: InvalidField| ClientError::Invalid { field: at.field.to_owned(), reason: at.reason };
    if options.clients == 0 {
        return Err(invalid(InvalidField::new("clients", "must be at least 1")));
    }
    if !(options.rate > 0.0 && options.rate <= 1e6) {
        let reason = format!("must be above 0 and at most a million views a second, not {}", options.rate);
        return Err(invalid(InvalidField::new("rate", reason)));
    }
    let description = client.description().clone();
    let (clients, rate, size, plan) = (options.clients, options.rate, options.size, options.plan);
    let views = (options.duration.as_secs_f64() * rate).ceil().max(1.0) as u64;
    let schedule = move |index: u32| Schedule {
        path: CameraPath::new(&description, index),
        size,
        plan,
        phase: Duration::from_secs_f64(f64::from(index) / (f64::from(clients) * rate)),
        rate,
        views,
    };
    schedule(0).view(0.0).validate(&client.description().limits).map_err(invalid)?;
    Ok((0..clients).map(schedule))
}

#[cfg(test)]
mod tests;

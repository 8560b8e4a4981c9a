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
mod schedule;
mod sessions;
mod walk;

pub use burst::{BurstReport, IN_FLIGHT, burst, path_views, patient};
pub use direct::direct_view;
pub use path::CameraPath;
pub use report::{LatencyMs, LoadReport};
pub use schedule::{Cameras, Ended, LoadOptions, Mode};
pub use walk::{WalkKind, walk};

use std::sync::Arc;
use std::time::Duration;

use argus_scene::InvalidField;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::{Client, ClientError};
use report::Tally;
use schedule::Schedule;

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

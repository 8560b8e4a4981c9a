//! One phase: a load on the service, and what came of it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use argus_client::load::{Ended, LoadOptions, run_along};
use argus_client::{Client, ClusterStatus, ConnectOptions};
use argus_local::LocalCluster;
use argus_scene::{Frame, Plan};

use super::mode::Mode;
use super::options::Options;
use super::row::{self, Measured};
use super::truth::Judged;
use super::watch::Samples;
use crate::median::mean;

/// A view without a frame after this time has failed.
pub(super) const DEADLINE: Duration = Duration::from_secs(30);
/// Deadline of a view that fills caches.
pub(super) const FIRST_DEADLINE: Duration = Duration::from_secs(120);
/// Largest number of connections that all clients share.
const CONNECTIONS: u32 = 4;

/// The load of a phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Load {
    /// Views per second of each client.
    pub(super) rate: f64,
    /// A view without a frame after this time has failed.
    pub(super) deadline: Duration,
}

impl Load {
    /// The load that the options ask for.
    pub(super) fn of(options: &Options) -> Self {
        Self { rate: options.rate, deadline: DEADLINE }
    }
}

/// Connects a client with as many connections as the load needs.
pub(super) async fn connect(cluster: &LocalCluster, options: &Options) -> Result<Client> {
    let connections = options.clients.clamp(1, CONNECTIONS) as usize;
    let connect = ConnectOptions { connections, ..ConnectOptions::default() };
    let until = Instant::now() + FIRST_DEADLINE;
    loop {
        // On a busy machine the service may answer late; try again.
        match Client::connect_with(cluster.url(), &connect).await {
            Err(_) if Instant::now() < until => tokio::time::sleep(Duration::from_millis(20)).await,
            connected => return Ok(connected?),
        }
    }
}

/// Mean microseconds to plan a view, for views planned between two statuses.
fn planning_us(before: &ClusterStatus, after: &ClusterStatus) -> Option<f64> {
    let views = after.views_planned.checked_sub(before.views_planned).filter(|views| *views > 0)?;
    Some((after.planning_us - before.planning_us) / views as f64)
}

/// What is kept of a phase's views.
#[derive(Default)]
pub(super) struct Views {
    /// When the first frame arrived.
    pub(super) first: Option<Instant>,
    pub(super) judged: Vec<Judged>,
}

/// Runs one load, from its first view to the last answer.
pub(super) async fn of_phase(
    client: &Client,
    options: &Options,
    mode: Mode,
    load: Load,
) -> Result<(Measured, Views)> {
    let asked = LoadOptions {
        clients: options.clients,
        duration: Duration::try_from_secs_f64(options.seconds)?,
        rate: load.rate,
        size: options.size,
        plan: mode.plan(),
        deadline: load.deadline,
        ..LoadOptions::default()
    };
    let judged = spread_over(asked.views_per_client(), options.clients, options.judged);
    let (description, walk) = (client.description().clone(), options.walk);
    let cameras = Arc::new(move |client, secs| walk.camera(&description, client, secs));
    let (mut measured, mut views, mut unresolved) = (Measured::default(), Views::default(), Vec::new());
    let before = client.status().await?;
    let report = run_along(client, &asked, cameras, |ended: Ended| match ended.outcome {
        Ok(frame) => {
            measured.latencies_ms.push((ended.at - ended.due).as_secs_f64() * 1e3);
            *measured.methods.entry(method_of(&frame)).or_default() += 1;
            measured.timed.take(&frame);
            unresolved.push(frame.unresolved_fraction);
            let at = ended.at.into_std();
            views.first = Some(views.first.map_or(at, |first| first.min(at)));
            if judged.contains(&(ended.client, ended.index)) {
                views.judged.push(Judged { camera: ended.view.camera, frame });
            }
        }
        Err(error) => {
            // A fast rejection counts as slow as the deadline.
            measured.latencies_ms.push(load.deadline.as_secs_f64() * 1e3);
            measured.first_error.get_or_insert_with(|| error.to_string());
        }
    });
    let report = report.await?;
    measured.latencies_ms.sort_by(f64::total_cmp);
    (measured.sent, measured.answered, measured.rejected) = (report.sent, report.answered, report.rejected);
    measured.views_per_sec = report.views_per_sec;
    measured.unresolved = (!unresolved.is_empty()).then(|| mean(unresolved));
    let after = client.status().await?;
    measured.planning_us = planning_us(&before, &after);
    measured.speed_up = (measured.timed.share().is_some()).then(|| after.priced().speed_up);
    measured.samples = Samples::of(client).await?;
    Ok((measured, views))
}

/// How a frame was made: one of [`row::METHODS`].
fn method_of(frame: &Frame) -> &'static str {
    let [direct, warp, traced] = row::METHODS;
    match frame.provenance.plan {
        Plan::Direct { .. } => direct,
        Plan::Warp(_) if frame.served.traced > 0 => traced,
        Plan::Warp(_) => warp,
    }
}

/// Picks `count` views to judge, as (client, index), evenly spread over time and clients.
fn spread_over(views: u64, clients: u32, count: u64) -> BTreeSet<(u32, u64)> {
    let count = count.min(views.saturating_mul(u64::from(clients)));
    let step = (u64::from(clients) / count.max(1)).max(1);
    let at = |k: u64| {
        let client = (k * step) % u64::from(clients.max(1));
        (client as u32, ((2 * k + 1) * views / (2 * count)).min(views.saturating_sub(1)))
    };
    (0..count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn judged_views_are_spread_over_time_and_clients() {
        let judged = spread_over(40, 4, 12);
        assert_eq!(judged.len(), 12);
        for client in 0..4 {
            assert_eq!(judged.iter().filter(|(c, _)| *c == client).count(), 3, "{judged:?}");
        }
        let mut times: Vec<u64> = judged.iter().map(|(_, index)| *index).collect();
        times.sort_unstable();
        assert!(times.windows(2).all(|pair| (3..=4).contains(&(pair[1] - pair[0]))), "{times:?}");
        assert!(times[0] < 3 && times[11] > 36, "{times:?}");
    }

    #[test]
    fn with_many_clients_the_judged_clients_are_spread_too() {
        let judged = spread_over(50, 100, 10);
        let clients: Vec<u32> = judged.iter().map(|(client, _)| *client).collect();
        assert_eq!(clients, [0, 10, 20, 30, 40, 50, 60, 70, 80, 90]);
    }

    #[test]
    fn no_more_views_are_judged_than_there_are() {
        assert_eq!(spread_over(1, 1, 12), BTreeSet::from([(0, 0)]));
        assert!(spread_over(1, 3, 12).len() <= 3);
        assert!(spread_over(40, 4, 0).is_empty() && spread_over(0, 4, 12).is_empty());
        assert!(spread_over(3, 7, 12).iter().all(|(client, index)| *client < 7 && *index < 3));
    }
}

//! Waits until a cluster on this machine is ready, or has settled.

use std::time::Duration;

use anyhow::{Context as _, Result};
use argus_client::{Client, ClientError, ClusterStatus, ConnectOptions};
use argus_scene::LightLevel;
use tokio::time::{Instant, sleep};

use crate::LocalCluster;

/// Time between two looks at the status.
const PAUSE: Duration = Duration::from_millis(250);
/// Idle statuses in a row that count as settled.
const CALM: u32 = 5;

/// Whether views show all light that they will ever show: no better light is being prepared.
pub fn light_is_final(client: &Client, status: &ClusterStatus) -> bool {
    let rises = client.description().first_light == LightLevel::Direct;
    !rises || status.light_name() == LightLevel::Full.name()
}

/// Connects and waits until the workers have joined, opened the scene and prepared its light, so that neither start-up
/// is measured nor images of different light are compared.
///
/// # Errors
/// If the workers do not join within two minutes.
pub async fn connect(cluster: &LocalCluster, workers: usize) -> Result<Client> {
    let options = ConnectOptions { connections: 4, ..ConnectOptions::default() };
    let client = Client::connect_with(cluster.url(), &options).await?;
    let joined = async {
        loop {
            let status = client.status().await?;
            if status.processes as usize >= workers && light_is_final(&client, &status) {
                break;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        Ok::<_, ClientError>(())
    };
    tokio::time::timeout(Duration::from_secs(120), joined)
        .await
        .context("the workers did not join in time")??;
    Ok(client)
}

/// Waits until all workers have joined, their queues are empty, no more samples are rendered and all light is shown, or until `at_most` has
/// passed. Returns whether the service settled.
///
/// # Errors
/// The service's status cannot be read.
pub async fn settle(client: &Client, workers: usize, at_most: Duration) -> Result<bool> {
    let until = Instant::now() + at_most;
    let (mut calm, mut rendered) = (0, None);
    while calm < CALM {
        if Instant::now() >= until {
            return Ok(false);
        }
        sleep(PAUSE).await;
        let status = client.status().await?;
        let idle = status.workers.iter().all(|w| w.queued_samples == 0 && w.queued_views == 0);
        let before = rendered.replace(samples_rendered(&status));
        let still =
            idle && status.workers.len() >= workers && before == rendered && light_is_final(client, &status);
        calm = if still { calm + 1 } else { 0 };
    }
    Ok(true)
}

fn samples_rendered(status: &ClusterStatus) -> u64 {
    status.workers.iter().map(|worker| worker.samples_rendered).sum()
}

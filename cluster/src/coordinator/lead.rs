//! Leader election: standby, leading, and stepping down.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;
use tracing::{info, warn};

use super::scene_table::SceneTable;
use crate::leadership::{HeldLease, Registry};

/// Attempts to acquire or renew a lease within its duration.
const OFTEN: u32 = 8;

/// A leadership ends by this part of a lease before the lease does, in case clocks differ in speed.
const MARGIN: u32 = 10;

/// Time between two attempts where leases do not lapse.
const RETRY: Duration = Duration::from_millis(250);

/// Acquires the lease whenever it is free, and leads while it is held. Never returns.
pub(super) async fn lead(scenes: &SceneTable, registry: &Arc<dyn Registry>, address: &str) {
    // The registry knows the lease's duration once it was reached.
    let pause = || registry.lease().map_or(RETRY, |lease| lease / OFTEN);
    let mut is_logged = false;
    loop {
        let asked = Instant::now();
        match registry.acquire(address).await {
            Ok(Some(held)) => {
                is_logged = false;
                let expected = registry.noted_workers().await.len();
                scenes.lead(held.term, until(registry.as_ref(), asked), expected);
                *scenes.lease.lock() = Some(held);
                keep(scenes, registry.as_ref(), held, address, pause()).await;
                scenes.step_down("another coordinator may lead");
                give_up(scenes, registry.as_ref()).await;
            }
            Ok(None) => {
                let leader = registry.leader().await;
                if !std::mem::replace(&mut is_logged, true) {
                    info!(leader = leader.as_deref().unwrap_or("unknown"), "coordinator is on standby");
                }
                scenes.stand_by(leader.as_deref());
            }
            Err(error) if !std::mem::replace(&mut is_logged, true) => {
                warn!(%error, "no lease can be acquired")
            }
            Err(_) => {}
        }
        tokio::time::sleep(pause()).await;
    }
}

/// Releases the lease, if it is held, so that another coordinator leads at once.
pub(super) async fn give_up(scenes: &SceneTable, registry: &dyn Registry) {
    let held = scenes.lease.lock().take();
    if let Some(held) = held {
        registry.release(held).await;
    }
}

/// Renews the lease until it is lost, or until the core stepped down.
async fn keep(
    scenes: &SceneTable,
    registry: &dyn Registry,
    mut held: HeldLease,
    address: &str,
    pause: Duration,
) {
    let mut noted = Vec::new();
    while scenes.leads() {
        tokio::time::sleep(pause).await;
        let asked = Instant::now();
        match registry.renew(held, address).await {
            Ok(Some(renewed)) => {
                held = renewed;
                *scenes.lease.lock() = Some(held);
                scenes.lead_until(until(registry, asked));
            }
            Ok(None) => break,
            // The leadership lasts as long as the lease: every step of the core checks it.
            Err(error) => warn!(%error, "the lease was not renewed"),
        }
        let mut workers = scenes.workers();
        workers.sort();
        if workers != noted {
            registry.note_workers(&workers).await;
            noted = workers;
        }
    }
}

/// The end of a lease that was requested at `asked`, less the margin.
fn until(registry: &dyn Registry, asked: Instant) -> Option<Instant> {
    registry.lease().map(|lease| asked + lease - lease / MARGIN)
}

//! How much the demo's crowd asks for.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use argus_client::load::{path_views, patient};
use argus_client::{Client, ClientError};
use argus_scene::PlanRequest;
use futures::future::try_join_all;
use serde::Serialize;

/// The crowd's views a second, as a multiple of those that the workers carry from triangles.
const TIMES: f64 = 3.0;
/// Most views a second: the clients share the machine with the service.
const MOST_PER_SEC: f64 = 2000.0;
/// Views in flight at each worker while it is measured: one is rendered, one waits.
const IN_FLIGHT: usize = 2;

/// The crowd's rate, and what it follows from.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Rate {
    /// Views a second of all viewers together.
    pub(crate) asked_per_sec: f64,
    /// Views a second that all workers together carry from triangles.
    pub(crate) carried_per_sec: f64,
}

impl Rate {
    /// The rate that makes a crowd on this machine: for a time, as many views from triangles are requested as are answered. Prices
    /// that workers measured alone would promise more, since they share the machine.
    ///
    /// # Errors
    /// A view is not answered.
    pub(crate) async fn measure(
        client: &Client,
        workers: usize,
        size: [u32; 2],
        time: Duration,
    ) -> anyhow::Result<Self> {
        let direct = PlanRequest { direct: true, ..PlanRequest::default() };
        let askers = IN_FLIGHT * workers;
        let views = path_views(client.description(), askers as u32, size, direct);
        let options = patient();
        // The first view of each compiles programs.
        try_join_all(views.iter().map(|view| client.render(view, &options))).await?;
        let (answered, began) = (AtomicU64::new(0), Instant::now());
        let asking = views.iter().map(async |view| {
            while began.elapsed() < time {
                client.render(view, &options).await?;
                answered.fetch_add(1, Ordering::Relaxed);
            }
            Ok::<(), ClientError>(())
        });
        try_join_all(asking).await?;
        Ok(Self::of(answered.into_inner() as f64 / began.elapsed().as_secs_f64()))
    }

    /// The rate where so many views a second are carried.
    fn of(carried_per_sec: f64) -> Self {
        Self { asked_per_sec: (TIMES * carried_per_sec).min(MOST_PER_SEC), carried_per_sec }
    }

    /// The rate over that of views from triangles.
    pub(crate) fn times(&self) -> f64 {
        self.asked_per_sec / self.carried_per_sec
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crowd_asks_for_three_times_what_triangles_carry_up_to_a_limit() {
        let rate = Rate::of(150.0);
        assert!((rate.asked_per_sec - 450.0).abs() < 1e-9 && (rate.times() - 3.0).abs() < 1e-9);
        let fast = Rate::of(4000.0);
        assert!(fast.asked_per_sec == MOST_PER_SEC && fast.times() < 1.0);
    }
}

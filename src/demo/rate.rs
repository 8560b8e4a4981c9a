//! How much the demo's crowd asks for.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use argus_client::load::{path_views, patient};
use argus_client::{Client, ClientError};
use argus_scene::PlanRequest;
use futures::future::try_join_all;
use serde::Serialize;

/// Most views a second: the clients share the machine with the service.
const MOST_PER_SEC: f64 = 2000.0;
/// Views in flight at each worker while it is measured: one is rendered, one waits.
const IN_FLIGHT: usize = 2;

/// How much one phase of the crowd asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Asked {
    /// A multiple of what the workers carry from triangles.
    Times(f64),
    /// Views a second of all viewers together.
    PerSec(f64),
}

/// A crowd's rate, and what it follows from.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Rate {
    /// Views a second of all viewers together.
    pub(crate) asked_per_sec: f64,
    /// Views a second that all workers together carry from triangles.
    pub(crate) carried_per_sec: f64,
}

impl Rate {
    /// Measures the views a second that the workers carry from triangles: for a time, as many are requested as are answered. Prices
    /// that workers measured alone would promise more, since they share the machine.
    ///
    /// # Errors
    /// A view is not answered.
    pub(crate) async fn measure(
        client: &Client,
        workers: usize,
        size: [u32; 2],
        time: Duration,
    ) -> anyhow::Result<f64> {
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
        Ok(answered.into_inner() as f64 / began.elapsed().as_secs_f64())
    }

    /// The rate of a phase where so many views a second are carried.
    pub(crate) fn of(asked: Asked, carried_per_sec: f64) -> Self {
        let asked_per_sec = match asked {
            Asked::Times(times) => times * carried_per_sec,
            Asked::PerSec(per_sec) => per_sec,
        };
        Self { asked_per_sec: asked_per_sec.min(MOST_PER_SEC), carried_per_sec }
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
    fn a_crowd_asks_for_a_multiple_of_what_triangles_carry_or_for_a_rate_up_to_a_limit() {
        let rate = Rate::of(Asked::Times(3.0), 150.0);
        assert!((rate.asked_per_sec - 450.0).abs() < 1e-9 && (rate.times() - 3.0).abs() < 1e-9);
        let rate = Rate::of(Asked::PerSec(30.0), 150.0);
        assert!((rate.asked_per_sec - 30.0).abs() < 1e-9 && (rate.times() - 0.2).abs() < 1e-9);
        let fast = Rate::of(Asked::Times(3.0), 4000.0);
        assert!(fast.asked_per_sec == MOST_PER_SEC && fast.times() < 1.0);
    }
}

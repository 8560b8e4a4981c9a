//! How much the demo's crowd asks for.

use std::time::{Duration, Instant};

use anyhow::bail;
use argus_client::Client;
use serde::Serialize;
use tokio::time::sleep;

/// The crowd's views a second, as a multiple of those that the workers carry from triangles.
const TIMES: f64 = 3.0;
/// Most views a second: the clients share the machine with the service.
const MOST_PER_SEC: f64 = 2000.0;
/// Longest wait for the workers to measure a view.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time between two looks at the status.
const PAUSE: Duration = Duration::from_millis(50);

/// The crowd's rate, and what it follows from.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Pace {
    /// Views a second of all viewers together.
    pub(crate) asked_per_sec: f64,
    /// Views a second that all workers together carry from triangles, by their measured prices.
    pub(crate) carried_per_sec: f64,
    /// Price of one view from triangles: the workers' mean, milliseconds.
    pub(crate) direct_ms: f64,
}

impl Pace {
    /// The rate that makes a crowd on this machine, for views of so many pixels. Waits until each worker has measured what views
    /// from triangles cost.
    ///
    /// # Errors
    /// The status cannot be read, or a worker does not measure in time.
    pub(crate) async fn measure(client: &Client, workers: usize, pixels: u32) -> anyhow::Result<Self> {
        let until = Instant::now() + PATIENCE;
        loop {
            let status = client.status().await?;
            let costs = status.workers.iter().filter_map(|worker| worker.direct_cost);
            let prices: Vec<f64> =
                costs.map(|cost| cost.fixed_ms + cost.ms_per_megapixel * f64::from(pixels) / 1e6).collect();
            if prices.len() >= workers {
                return Ok(Self::of(&prices));
            }
            if Instant::now() >= until {
                bail!(
                    "{} of {workers} workers measured within {} s what a view costs",
                    prices.len(),
                    PATIENCE.as_secs()
                );
            }
            sleep(PAUSE).await;
        }
    }

    /// The rate for workers with these prices of a view, in milliseconds.
    fn of(prices: &[f64]) -> Self {
        let carried_per_sec: f64 = prices.iter().map(|ms| 1e3 / ms.max(1e-3)).sum();
        Self {
            asked_per_sec: (TIMES * carried_per_sec).min(MOST_PER_SEC),
            carried_per_sec,
            direct_ms: prices.iter().sum::<f64>() / prices.len() as f64,
        }
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
        let pace = Pace::of(&[10.0, 20.0]);
        assert!((pace.carried_per_sec - 150.0).abs() < 1e-9 && (pace.asked_per_sec - 450.0).abs() < 1e-9);
        assert!((pace.direct_ms - 15.0).abs() < 1e-9 && (pace.times() - 3.0).abs() < 1e-9);
        let fast = Pace::of(&[0.5, 0.5]);
        assert!(fast.asked_per_sec == MOST_PER_SEC && fast.times() < 1.0);
    }
}

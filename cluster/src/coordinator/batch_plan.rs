//! Decides once which views of a batch come from samples that its views share.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::rig::CoverageEstimate;
use argus_scene::{Provenance, View};
use tokio::time::{Instant, sleep};
use tracing::warn;

use super::shared_core::SharedCore;

/// Fewer views share nothing that is worth the wait for prices.
const LEAST_VIEWS: usize = 16;

/// Longest wait for the price of views from samples, which workers measure soon after they are ready.
const PATIENCE: Duration = Duration::from_secs(10);

/// Interval at which prices are looked for.
const PAUSE: Duration = Duration::from_millis(50);

/// The pins of views from samples that a batch's views share; `None` for views from triangles, and for `None`.
pub(super) async fn pins(shared: &Arc<SharedCore>, views: Vec<Option<View>>) -> Vec<Option<Provenance>> {
    let count = views.len();
    let of_triangles = || vec![None; count];
    let Some(sight) = shared.sight.clone().filter(|_| count >= LEAST_VIEWS) else { return of_triangles() };
    let until = Instant::now() + PATIENCE;
    while !shared.read(|core| core.has_prices()) {
        if Instant::now() >= until {
            warn!("what views from samples cost is not known, a batch is rendered from triangles");
            return of_triangles();
        }
        sleep(PAUSE).await;
    }
    let shared = shared.clone();
    let decided = tokio::task::spawn_blocking(move || {
        let estimated = |view: View| -> (View, Option<CoverageEstimate>) {
            let wanted = shared.read(|core| core.batch_estimate_wanted(&view));
            let estimate = wanted.map(|wanted| wanted.make(&view, sight.as_ref()));
            (view, estimate)
        };
        let is_valid: Vec<bool> = views.iter().map(Option::is_some).collect();
        let estimated: Vec<(View, Option<CoverageEstimate>)> =
            views.into_iter().flatten().map(estimated).collect();
        let mut pins = shared.read(|core| core.batch_pins(&estimated)).into_iter();
        is_valid.into_iter().map(|is_valid| if is_valid { pins.next().flatten() } else { None }).collect()
    });
    decided.await.unwrap_or_else(|error| {
        warn!(%error, "a batch cannot be planned, its views are rendered from triangles");
        of_triangles()
    })
}

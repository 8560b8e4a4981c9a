//! Sources that the coordinator orders: rendered one at a time, in slices between views.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::{FrameSource, InvalidField, Output, Outputs, RenderError, ViewJob};
use tracing::debug;

use super::from_sources;
use super::node::Node;
use super::sources::SourceKey;
use crate::core::Purchase;
use crate::core::quality::Cost;

/// Pause before a purchase that may succeed later is tried again.
const PAUSE: Duration = Duration::from_millis(200);

/// Time of a band of rows, milliseconds. Two of them fit into a slice with what their passes cost beside pixels.
const BAND_MS: f64 = 8.0;

/// Least rows of a band: fewer of them share too few rays of light, and passes cost more than pixels.
const LEAST_ROWS: u32 = 8;

/// Renders the purchases of the newest list, in order. One that is no longer listed is abandoned. Never returns.
pub(super) async fn carry_out(node: &Arc<Node>) {
    let mut wanted = node.purchases.wanted.subscribe();
    loop {
        let is_due = |purchase: &&Purchase| !node.purchases.has_failed(purchase) && !is_held(node, purchase);
        let next = wanted.borrow_and_update().iter().find(is_due).copied();
        let Some(purchase) = next else {
            if wanted.changed().await.is_err() {
                return;
            }
            continue;
        };
        let bought = bought(node, purchase);
        tokio::pin!(bought);
        loop {
            tokio::select! {
                done = &mut bought => {
                    if let Err(fault) = done {
                        debug!(%fault, "a source that was ordered cannot be rendered");
                        match is_passing(&fault) {
                            true => tokio::time::sleep(PAUSE).await,
                            false => node.purchases.fail(purchase),
                        }
                    }
                    break;
                }
                changed = wanted.changed() => {
                    if changed.is_err() || !wanted.borrow_and_update().contains(&purchase) {
                        break;
                    }
                }
            }
        }
    }
}

fn is_held(node: &Node, Purchase { source, state }: &Purchase) -> bool {
    let Ok((info, _)) = node.served.set_showing(*state) else { return false };
    let visibility = node.served.visibility_of_views(&info);
    node.sources.holds(&SourceKey { source: *source, state: *state, visibility })
}

/// Whether another attempt may succeed.
fn is_passing(fault: &Fault) -> bool {
    use RenderError::{Cancelled, DeviceLost};
    matches!(
        fault,
        Fault::Unavailable(_) | Fault::Overloaded { .. } | Fault::Render(Cancelled | DeviceLost(_))
    )
}

/// Renders a source and keeps it.
async fn bought(node: &Arc<Node>, Purchase { source, state }: Purchase) -> Result<(), Fault> {
    debug!(eye = %source.camera.eye, samples = source.samples_per_pixel, "a source is ordered");
    node.transforms.known(state.revision).await?;
    let (info, limits) = node.served.set_showing(state)?;
    source.validate(&limits)?;
    let band_rows = match source.band_rows {
        0 => band_rows(&source, node.direct_cost()),
        rows => rows,
    };
    let FrameSource { camera, width, height, .. } = source;
    let job = ViewJob {
        outputs: Outputs::COLOR.with(Output::Range),
        state,
        time_secs: info.time_secs(),
        visibility: node.served.visibility_of_views(&info),
        reflections: info.reflections,
        band_rows,
        ..ViewJob::new(camera, [width, height], source.plan())
    };
    if from_sources::outputs_to_keep(node, &job, info.lighting.exposure).is_none() {
        return Err(InvalidField::new("purchases.source", "would not be kept").into());
    }
    let frame = node.render_thread.render_in_slices(job.clone(), &info).await?;
    let key = from_sources::keep(node, &job, &frame, true);
    let unrepeatable = || InvalidField::new("purchases.source", "has light that cannot be had again");
    let key = key.ok_or_else(unrepeatable)?;
    debug!(id = %key.id(), band_rows, ms = frame.rendering_ms(), "a source was bought");
    node.news.notify_one();
    Ok(())
}

/// Rows of pixels that take about [`BAND_MS`]: a power of two times [`LEAST_ROWS`], so that equal costs give equal bands.
fn band_rows(source: &FrameSource, cost: Option<Cost>) -> u32 {
    let sub_pixels = f64::from(source.width) * f64::from(source.samples_per_pixel);
    let row_ms = cost.map_or(f64::INFINITY, |cost| cost.ms_per_megapixel * sub_pixels * 1e-6);
    let most = (BAND_MS / row_ms).min(f64::from(source.height));
    let doubled = std::iter::successors(Some(LEAST_ROWS), |rows| Some(2 * rows));
    let rows = doubled.take_while(|rows| f64::from(*rows) <= most).last();
    rows.unwrap_or(LEAST_ROWS).min(source.height)
}

#[cfg(test)]
mod tests {
    use argus_scene::Camera;
    use glam::DVec3;

    use super::*;

    #[test]
    fn bands_take_about_as_long_whatever_the_scene_costs() {
        let camera = Camera::look_at(DVec3::ONE, DVec3::ZERO);
        let source =
            FrameSource { camera, width: 250, height: 188, samples_per_pixel: 4, band_rows: 0, light: None };
        let cost = |ms| Some(Cost { fixed_ms: 5.0, ms_per_megapixel: ms });
        assert_eq!(band_rows(&source, None), 8);
        assert_eq!(band_rows(&source, cost(500.0)), 16);
        assert_eq!(band_rows(&source, cost(6000.0)), 8);
        assert_eq!(band_rows(&source, cost(0.0)), 128);
        assert_eq!(band_rows(&FrameSource { height: 3, ..source }, None), 3);
    }
}

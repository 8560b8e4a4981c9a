//! Health checks and metrics of a worker.

use std::fmt;
use std::sync::Arc;

use argus_scene::CellReport;

use super::node::Node;
use crate::core::Role;
use crate::observe::{Exposition, Monitored};

/// The monitored worker.
pub(super) struct Watch(pub(super) Arc<Node>);

impl Monitored for Watch {
    fn ready(&self) -> Result<(), String> {
        match (self.0.status.is_leaving(), self.0.status.role(), self.0.status.is_led()) {
            (true, ..) => Err("the worker is shutting down".to_owned()),
            (_, None, _) => Err("no coordinator has given the worker a role yet".to_owned()),
            (_, Some(_), false) => Err("the worker has lost its coordinator".to_owned()),
            (_, Some(_), true) => self.0.health.check(),
        }
    }

    fn live(&self) -> Result<(), String> {
        let busy = self.0.render_thread.busy_for();
        match busy < self.0.config.wedged_after {
            true => Ok(()),
            false => Err(format!("the render thread has been at one piece of work for {} s", busy.as_secs())),
        }
    }

    fn expose(&self, to: &mut Exposition<'_>) -> fmt::Result {
        if let Some(security) = &self.0.config.security {
            security.expose(to)?;
        }
        let (report, backlog) = (self.0.report(), self.0.render_thread.backlog());
        let acts = |role| f64::from(self.0.status.role() == Some(role));
        to.gauges(
            "worker_role",
            "1 for the role in effect, else 0",
            [
                ([("role", "sampler")], acts(Role::Sampler)),
                ([("role", "compositor")], acts(Role::Compositor)),
                ([("role", "both")], acts(Role::Both)),
            ],
        )?;
        let kinds = ["sample", "view", "direct", "ray"].map(|kind| [("kind", kind)]);
        let done = [report.samples_rendered, report.views_composed, report.views_direct, report.rays_traced];
        let done = kinds.into_iter().zip(done.map(|count| count as f64));
        to.counters("worker_rendered", "Results rendered, by kind", done)?;
        let waiting = [backlog.samples, backlog.warped, backlog.direct, backlog.pixels];
        let waiting = kinds.into_iter().zip(waiting.map(|count| count as f64));
        to.gauges("worker_queued", "Results queued for the render thread or in progress, by kind", waiting)?;
        let cost = [report.sample_ms, report.view_ms, report.direct_ms, report.ray_ms];
        let cost = cost.map(|ms| ms.map_or(f64::NAN, |ms| ms * 1e-3));
        to.gauges(
            "worker_cost_seconds",
            "Time of one result, by kind; absent until measured",
            kinds.into_iter().zip(cost),
        )?;
        to.counters(
            "worker_busy_seconds",
            "Busy time of the render thread, by role",
            [
                ([("role", "sampler")], report.sampling_busy_ms * 1e-3),
                ([("role", "compositor")], report.compositing_busy_ms * 1e-3),
            ],
        )?;
        to.counter(
            "worker_samples_received",
            "Samples received from other workers",
            report.samples_received,
        )?;
        let takes =
            "Time of unpacking received samples (outside of the render thread) and of uploading them (hold)";
        to.counters(
            "worker_taking_up_seconds",
            takes,
            [
                ([("stage", "unpack")], report.unpacking_ms * 1e-3),
                ([("stage", "hold")], report.holding_ms * 1e-3),
            ],
        )?;
        let progress = report.sample_progress.unwrap_or(f64::NAN);
        to.gauge(
            "worker_sample_progress",
            "Rendered share of the samples in progress, 0 to 1; absent if none is in progress",
            progress,
        )?;
        to.gauge(
            "worker_samples_held",
            "Samples that it can send and reconstruct from",
            report.held.len() as f64,
        )?;
        to.gauge(
            "worker_frames_bytes",
            "Bytes of recent frames, from which views are warped",
            report.frames_bytes as f64,
        )?;
        to.gauge("worker_held_bytes", "Texel bytes of held samples", self.0.store.bytes() as f64)?;
        let composed_from = self.0.health.held() as f64;
        to.gauge("worker_samples_composed_from", "Samples that its compositor holds", composed_from)?;
        if let Some(cells) = self.0.health.cells() {
            light_cells(to, cells)?;
        }
        to.gauge("worker_requests", "Requests in progress", self.0.requests() as f64)?;
        let frames = "Bytes reserved for frames that are rendered, packed or sent";
        to.gauge("worker_frame_bytes", frames, self.0.frame_memory.reserved() as f64)
    }
}

fn light_cells(to: &mut Exposition<'_>, cells: CellReport) -> fmt::Result {
    to.gauge(
        "worker_light_cell_pages",
        "Pages of 8x8x8 light cells that its sampler holds",
        cells.pages as f64,
    )?;
    to.gauge("worker_light_cells", "Light cells that its sampler holds", cells.cells as f64)?;
    to.gauge("worker_light_cell_bytes", "Bytes of its light cells", cells.bytes as f64)?;
    let waiting = "Corners of light cells that views lacked and that wait to be filled";
    to.gauge("worker_light_cells_waiting", waiting, cells.waiting as f64)?;
    to.counter("worker_light_cells_filled", "Light cells filled or refined", cells.filled)?;
    to.counter(
        "worker_light_cell_pages_taken",
        "Pages of light cells that other workers sent",
        cells.pages_taken,
    )?;
    let moved = [
        ([("pages", "kept")], cells.pages_kept as f64),
        ([("pages", "touched")], cells.pages_touched as f64),
    ];
    to.counters(
        "worker_light_cell_pages_moved",
        "Pages of light cells when something moved, by what became of them",
        moved,
    )?;
    let faces = [
        ([("faces", "kept")], cells.faces_kept as f64),
        ([("faces", "rendered")], cells.faces_changed as f64),
    ];
    to.counters(
        "worker_sample_faces_moved",
        "Faces of samples when something moved, by what became of them",
        faces,
    )?;
    let older = "Pages of light cells of an earlier pose, shown until they are filled anew";
    to.gauge("worker_light_cell_pages_older", older, cells.pages_older as f64)?;
    let seconds = [([("stage", "fill")], cells.fill_ms * 1e-3), ([("stage", "take")], cells.take_ms * 1e-3)];
    to.counters("worker_light_cells_seconds", "Time spent on light cells, by stage", seconds)?;
    let by_rays = cells.pixels.saturating_sub(cells.pixels_lit);
    to.counters(
        "worker_light_cell_pixels",
        "Pixels that asked for light cells, by what lit them",
        [([("light", "cells")], cells.pixels_lit as f64), ([("light", "rays")], by_rays as f64)],
    )
}

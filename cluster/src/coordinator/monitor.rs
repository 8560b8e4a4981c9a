//! Metrics, readiness and liveness of a coordinator.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1::{LightCells, StatusResponse, WorkerStatus};

use super::shared_core::SharedCore;
use crate::observe::{Exposition, Monitored};

/// A coordinator without a tick for this long is wedged. It ticks ten times a second.
const WEDGED: Duration = Duration::from_secs(10);

/// Metrics, readiness and liveness of a coordinator.
pub(super) struct Monitor(pub(super) Arc<SharedCore>);

impl Monitored for Monitor {
    fn ready(&self) -> Result<(), String> {
        self.0.check_leading().map_err(|fault| fault.to_string())?;
        self.0.read(|core| match (core.is_draining(), core.is_ready_for_load()) {
            (true, _) => Err("the coordinator is shutting down".to_owned()),
            (_, true) => Ok(()),
            (_, false) => Err("no worker is ready to render; start one with `argus worker`".to_owned()),
        })
    }

    fn live(&self) -> Result<(), String> {
        let silent = self.0.frame_metrics.silent();
        match silent < WEDGED {
            true => Ok(()),
            false => Err(format!("the coordinator has not moved for {} s", silent.as_secs())),
        }
    }

    fn expose(&self, to: &mut Exposition<'_>) -> fmt::Result {
        if let Some(security) = self.0.channels.reloadable() {
            security.expose(to)?;
        }
        let leads = f64::from(self.0.check_leading().is_ok());
        to.gauge("leading", "1 for the coordinator that leads, 0 for one that stands by", leads)?;
        self.0.client_metrics.expose(to)?;
        let (status, in_flight) = self.0.read(|core| (core.status(), core.views_in_flight()));
        let (most_views, most_sessions) =
            self.0.read(|core| (core.config().max_views, core.config().max_sessions));
        to.gauges(
            "limits",
            "The largest number of views in flight and of open sessions; further ones are rejected",
            [([("what", "views")], most_views as f64), ([("what", "sessions")], most_sessions as f64)],
        )?;
        cluster(to, &status, in_flight)?;
        counters(to, &status)?;
        workers(to, &status)
    }
}

fn cluster(to: &mut Exposition<'_>, status: &StatusResponse, in_flight: usize) -> fmt::Result {
    let unready = status.workers.len().saturating_sub(status.processes as usize);
    to.gauges(
        "processes",
        "Workers by role; a worker with both roles counts twice, unready ones have none",
        [
            ([("role", "sampler")], f64::from(status.samplers)),
            ([("role", "compositor")], f64::from(status.compositors)),
            ([("role", "unready")], unready as f64),
        ],
    )?;
    let kinds = ["sample", "view", "direct", "ray"].map(|kind| [("kind", kind)]);
    let per_tick =
        [status.samples_per_tick, status.views_per_tick, status.direct_views_per_tick, status.rays_per_tick];
    to.gauges(
        "demand_per_tick",
        "S, V, D and R: samples, views, direct views and rays demanded per tick",
        kinds.into_iter().zip(per_tick),
    )?;
    let ms = [status.sample_ms, status.view_ms, status.direct_ms, status.ray_ms];
    let seconds = ms.map(|ms| ms * 1e-3);
    to.gauges(
        "cost_seconds",
        "g, c, g_direct and g_ray: measured cost of a sample, view, direct view and ray",
        kinds.into_iter().zip(seconds),
    )?;
    to.gauges(
        "tick_seconds",
        "Time of a tick's work by the balance formula, and busy time of the busiest worker in a tick",
        [
            ([("which", "predicted")], status.tick_predicted_ms * 1e-3),
            ([("which", "measured")], status.tick_measured_ms * 1e-3),
        ],
    )?;
    to.gauge("views_in_flight", "Views waiting or in work", in_flight as f64)?;
    to.gauge("sessions_open", "Open sessions", status.counts().sessions_open as f64)?;
    let pressure = status.pressed();
    to.gauges(
        "pressure_processes",
        "What views ask for, each by its cheapest way within its error bound, and what they lack of it, in processes",
        [([("what", "asked")], pressure.asked), ([("what", "lacking")], pressure.lacking)],
    )?;
    let refinements = status.refined();
    to.gauges(
        "refinements",
        "Samples at refinements of the rig, where views have holes",
        [
            ([("state", "wanted")], f64::from(refinements.wanted)),
            ([("state", "placed")], f64::from(refinements.placed)),
            ([("state", "usable")], f64::from(refinements.usable)),
        ],
    )
}

fn counters(to: &mut Exposition<'_>, status: &StatusResponse) -> fmt::Result {
    let counters = status.counts();
    to.counters(
        "views",
        "Views, by how they ended",
        [
            ([("outcome", "answered")], counters.views_answered as f64),
            ([("outcome", "failed")], counters.views_failed as f64),
            ([("outcome", "rejected")], counters.views_rejected as f64),
        ],
    )?;
    to.counter("views_retried", "Attempts at a view by another worker", counters.views_retried)?;
    to.counter(
        "frames_refused",
        "Frames rejected because their error exceeded the bound",
        counters.frames_refused,
    )?;
    let superseded = counters.cameras_superseded;
    to.counter(
        "cameras_superseded",
        "Session cameras superseded by a newer one before they were rendered",
        superseded,
    )?;
    to.counter("roles_changed", "Changes of role", counters.roles_changed)?;
    to.counter("workers_joined", "Workers that joined", counters.workers_joined)?;
    to.counter(
        "workers_lost",
        "Workers whose lease expired or whose stream ended unannounced",
        counters.workers_lost,
    )
}

fn workers(to: &mut Exposition<'_>, status: &StatusResponse) -> fmt::Result {
    let rows = |value: fn(&WorkerStatus) -> f64| {
        status.workers.iter().map(move |worker| ([("worker", worker.id.as_str())], value(worker)))
    };
    let queued = |worker: &WorkerStatus| f64::from(worker.queued_samples + worker.queued_views);
    to.gauges("worker_queue", "Samples and views that wait at a worker", rows(queued))?;
    to.gauges(
        "worker_samples_held",
        "Samples that a worker holds",
        rows(|worker| worker.samples_held as f64),
    )?;
    let bytes = rows(|worker| worker.frames_bytes as f64);
    to.gauges(
        "worker_frames_bytes",
        "Bytes of a worker's recent frames, from which views are warped",
        bytes,
    )?;
    let cells = |value: fn(&LightCells) -> f64| {
        let held = status.workers.iter().filter_map(|worker| Some((worker, worker.light_cells.as_ref()?)));
        held.map(move |(worker, cells)| ([("worker", worker.id.as_str())], value(cells)))
    };
    to.gauges(
        "worker_light_cell_bytes",
        "Bytes of a worker's light cells",
        cells(|cells| cells.bytes as f64),
    )?;
    let share = "Share of the pixels asking for light cells that cells lit at a worker, 0 to 1";
    to.gauges("worker_light_cells_lit_share", share, cells(LightCells::lit_share))
}

//! Metrics, readiness and liveness of a coordinator.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1::{self, LightCells, StatusResponse, WorkerStatus};

use super::scene_table::SceneTable;
use super::served_scene::ServedScene;
use crate::core::Core;
use crate::observe::{Exposition, Monitored, SceneRow};

/// A coordinator without a tick for this long is wedged. It ticks ten times a second.
const WEDGED: Duration = Duration::from_secs(10);

/// Metrics, readiness and liveness of a coordinator.
pub(super) struct Monitor(pub(super) Arc<SceneTable>);

/// What metrics are computed from: a scene's status, and its views in flight.
struct SceneStatus {
    status: StatusResponse,
    in_flight: usize,
    limits: [usize; 2],
}

impl Monitored for Monitor {
    fn ready(&self) -> Result<(), String> {
        self.0.first().shared.check_leading().map_err(|fault| fault.to_string())?;
        let state =
            |scene: &ServedScene| scene.shared.read(|core| (core.is_draining(), core.is_ready_for_load()));
        let states: Vec<(bool, bool)> = self.0.all().iter().map(state).collect();
        match (states.iter().any(|(drains, _)| *drains), states.iter().any(|(_, is_ready)| *is_ready)) {
            (true, _) => Err("the coordinator is shutting down".to_owned()),
            (_, true) => Ok(()),
            (_, false) => Err("no worker is ready to render; start one with `argus worker`".to_owned()),
        }
    }

    fn live(&self) -> Result<(), String> {
        let silent = self.0.first().shared.frame_metrics.silent();
        match silent < WEDGED {
            true => Ok(()),
            false => Err(format!("the coordinator has not moved for {} s", silent.as_secs())),
        }
    }

    fn expose(&self, to: &mut Exposition<'_>) -> fmt::Result {
        let first = &self.0.first().shared;
        if let Some(security) = first.channels.reloadable() {
            security.expose(to)?;
        }
        let leads = f64::from(first.check_leading().is_ok());
        to.gauge("leading", "1 for the coordinator that leads, 0 for one that stands by", leads)?;
        first.client_metrics.expose(to)?;
        let is_one = self.0.all().len() == 1;
        let of_scene = |scene: &ServedScene| {
            let read = |core: &Core| SceneStatus {
                status: core.status(),
                in_flight: core.views_in_flight(),
                limits: [core.config().max_views, core.config().max_sessions],
            };
            // The only scene needs no label.
            let name = (!is_one).then(|| scene.name.clone());
            (name, scene.shared.read(read))
        };
        let scenes: Vec<(Option<String>, SceneStatus)> = self.0.all().iter().map(of_scene).collect();
        let mut to = ByScene { to, scenes: &scenes };
        to.gauges(
            "limits",
            "The largest number of views in flight and of open sessions; further ones are rejected",
            |scene| {
                let [views, sessions] = scene.limits.map(|most| most as f64);
                [([("what", "views")], views), ([("what", "sessions")], sessions)]
            },
        )?;
        cluster(&mut to)?;
        counters(&mut to)?;
        workers(&mut to)
    }
}

/// Writes metrics that each scene has.
struct ByScene<'a, 'e> {
    to: &'a mut Exposition<'e>,
    scenes: &'a [(Option<String>, SceneStatus)],
}

impl<'a> ByScene<'a, '_> {
    /// Writes a gauge for each scene.
    fn gauge(&mut self, name: &str, help: &str, value: impl Fn(&'a SceneStatus) -> f64) -> fmt::Result {
        self.gauges(name, help, |scene| [([], value(scene))])
    }

    /// Writes a gauge for each set of labels of each scene.
    fn gauges<const N: usize, R>(
        &mut self,
        name: &str,
        help: &str,
        rows: impl Fn(&'a SceneStatus) -> R,
    ) -> fmt::Result
    where
        R: IntoIterator<Item = ([(&'a str, &'a str); N], f64)>,
    {
        let rows = rows_of(self.scenes, rows);
        self.to.gauges_of_scenes(name, help, rows)
    }

    /// Writes a counter for each scene.
    fn counter(&mut self, name: &str, help: &str, value: impl Fn(&'a SceneStatus) -> u64) -> fmt::Result {
        self.counters(name, help, |scene| [([], value(scene) as f64)])
    }

    /// Writes a counter for each set of labels of each scene.
    fn counters<const N: usize, R>(
        &mut self,
        name: &str,
        help: &str,
        rows: impl Fn(&'a SceneStatus) -> R,
    ) -> fmt::Result
    where
        R: IntoIterator<Item = ([(&'a str, &'a str); N], f64)>,
    {
        let rows = rows_of(self.scenes, rows);
        self.to.counters_of_scenes(name, help, rows)
    }
}

/// The rows of all scenes, each with the name of its scene.
fn rows_of<'a, const N: usize, R>(
    scenes: &'a [(Option<String>, SceneStatus)],
    rows: impl Fn(&'a SceneStatus) -> R,
) -> impl Iterator<Item = SceneRow<'a, N>>
where
    R: IntoIterator<Item = ([(&'a str, &'a str); N], f64)>,
{
    scenes.iter().flat_map(move |(name, scene)| {
        rows(scene).into_iter().map(move |(labels, value)| (name.as_deref(), labels, value))
    })
}

fn cluster(to: &mut ByScene<'_, '_>) -> fmt::Result {
    to.gauges(
        "processes",
        "Workers by role; a worker with both roles counts twice, unready ones have none",
        |SceneStatus { status, .. }| {
            let unready = status.workers.len().saturating_sub(status.processes as usize);
            [
                ([("role", "sampler")], f64::from(status.samplers)),
                ([("role", "compositor")], f64::from(status.compositors)),
                ([("role", "unready")], unready as f64),
            ]
        },
    )?;
    let kinds = ["sample", "view", "direct", "ray"].map(|kind| [("kind", kind)]);
    to.gauges(
        "demand_per_tick",
        "S, V, D and R: samples, views, direct views and rays demanded per tick",
        |SceneStatus { status, .. }| {
            kinds.into_iter().zip([
                status.samples_per_tick,
                status.views_per_tick,
                status.direct_views_per_tick,
                status.rays_per_tick,
            ])
        },
    )?;
    to.gauges(
        "cost_seconds",
        "g, c, g_direct and g_ray: measured cost of a sample, view, direct view and ray",
        |SceneStatus { status, .. }| {
            let ms = [status.sample_ms, status.view_ms, status.direct_ms, status.ray_ms];
            kinds.into_iter().zip(ms.map(|ms| ms * 1e-3))
        },
    )?;
    to.gauges(
        "tick_seconds",
        "Time of a tick's work by the balance formula, and busy time of the busiest worker in a tick",
        |SceneStatus { status, .. }| {
            [
                ([("which", "predicted")], status.tick_predicted_ms * 1e-3),
                ([("which", "measured")], status.tick_measured_ms * 1e-3),
            ]
        },
    )?;
    to.gauge("views_in_flight", "Views waiting or in work", |scene| scene.in_flight as f64)?;
    to.gauge("sessions_open", "Open sessions", |scene| scene.status.counts().sessions_open as f64)?;
    to.gauges(
        "price_of_time",
        "What a second of a worker is worth, in mean FLIP: to all views, and its parts",
        |SceneStatus { status, .. }| {
            let market = status.priced();
            [
                ([("part", "all")], market.price),
                ([("part", "queue")], market.price_of_queue),
                ([("part", "worth")], market.worth),
                ([("part", "best")], market.best_worth),
            ]
        },
    )?;
    to.gauges(
        "views_processes",
        "What open views take, in processes: if all were from triangles, and as they are",
        |SceneStatus { status, .. }| {
            let market = status.priced();
            [([("way", "triangles")], market.asked), ([("way", "chosen")], market.carried)]
        },
    )?;
    to.gauge("views_load", "Share of the workers that views would take from triangles", |scene| {
        scene.status.priced().load
    })?;
    to.gauge("views_wait_seconds", "Mean predicted wait of a view", |scene| {
        scene.status.priced().wait_ms * 1e-3
    })?;
    to.gauges(
        "sources",
        "Sources that views are warped from: held by workers, bought among these, being rendered",
        |SceneStatus { status, .. }| {
            let market = status.priced();
            [
                ([("state", "held")], f64::from(market.sources)),
                ([("state", "bought")], f64::from(market.sources_bought)),
                ([("state", "coming")], f64::from(market.purchases_coming)),
            ]
        },
    )?;
    to.gauge("source_accounts", "Places whose views would gain from a source", |scene| {
        f64::from(scene.status.priced().accounts)
    })?;
    to.gauge("source_samplers", "K: most sources that are rendered at a time", |scene| {
        f64::from(scene.status.priced().most_purchases)
    })?;
    to.gauges(
        "refinements",
        "Samples at refinements of the rig, where views have holes",
        |SceneStatus { status, .. }| {
            let refinements = status.refined();
            [
                ([("state", "wanted")], f64::from(refinements.wanted)),
                ([("state", "placed")], f64::from(refinements.placed)),
                ([("state", "usable")], f64::from(refinements.usable)),
            ]
        },
    )
}

fn counters(to: &mut ByScene<'_, '_>) -> fmt::Result {
    to.counters("views", "Views, by how they ended", |SceneStatus { status, .. }| {
        let counters = status.counts();
        [
            ([("outcome", "answered")], counters.views_answered as f64),
            ([("outcome", "failed")], counters.views_failed as f64),
            ([("outcome", "rejected")], counters.views_rejected as f64),
        ]
    })?;
    to.counter("sources_bought", "Sources that were bought", |scene| scene.status.priced().purchases)?;
    let mut counter = |name: &str, help: &str, count: fn(v1::Counters) -> u64| {
        to.counter(name, help, |scene| count(scene.status.counts()))
    };
    counter("views_retried", "Attempts at a view by another worker", |counts| counts.views_retried)?;
    counter("frames_refused", "Frames rejected because their error exceeded the bound", |counts| {
        counts.frames_refused
    })?;
    counter(
        "cameras_superseded",
        "Session cameras superseded by a newer one before they were rendered",
        |counts| counts.cameras_superseded,
    )?;
    counter("roles_changed", "Changes of role", |counts| counts.roles_changed)?;
    counter("workers_joined", "Workers that joined", |counts| counts.workers_joined)?;
    counter("workers_lost", "Workers whose lease expired or whose stream ended unannounced", |counts| {
        counts.workers_lost
    })
}

fn workers(to: &mut ByScene<'_, '_>) -> fmt::Result {
    let mut of_workers = |name: &str, help: &str, value: fn(&WorkerStatus) -> f64| {
        to.gauges(name, help, |SceneStatus { status, .. }| {
            status.workers.iter().map(move |worker| ([("worker", worker.id.as_str())], value(worker)))
        })
    };
    of_workers("worker_queue", "Samples and views that wait at a worker", |worker| {
        f64::from(worker.queued_samples + worker.queued_views)
    })?;
    of_workers("worker_samples_held", "Samples that a worker holds", |worker| worker.samples_held as f64)?;
    of_workers(
        "worker_frames_bytes",
        "Bytes of a worker's recent frames, from which views are warped",
        |worker| worker.frames_bytes as f64,
    )?;
    // Values that are not finite are left out.
    let cells = |worker: &WorkerStatus, value: fn(&LightCells) -> f64| {
        worker.light_cells.as_ref().map_or(f64::NAN, value)
    };
    to.gauges(
        "worker_light_cell_bytes",
        "Bytes of a worker's light cells",
        |SceneStatus { status, .. }| {
            let bytes = move |worker| cells(worker, |cells| cells.bytes as f64);
            status.workers.iter().map(move |worker| ([("worker", worker.id.as_str())], bytes(worker)))
        },
    )?;
    let share = "Share of the pixels asking for light cells that cells lit at a worker, 0 to 1";
    to.gauges("worker_light_cells_lit_share", share, |SceneStatus { status, .. }| {
        let share = move |worker| cells(worker, LightCells::lit_share);
        status.workers.iter().map(move |worker| ([("worker", worker.id.as_str())], share(worker)))
    })
}

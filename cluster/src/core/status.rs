//! What `Status` answers: a snapshot of everything that was decided and of what it was decided on.

use argus_scene::Visibility;
use serde::Serialize;

use super::event::{Hello, Report, Role};
use super::samples::{Refinements, Samples};
use super::views::Views;
use super::workers::balance::Load;
use super::workers::{Worker, Workers};

/// What happened since the coordinator started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counters {
    /// Views whose frame was relayed whole.
    pub views_answered: u64,
    /// Views that ended with a fault other than overload.
    pub views_failed: u64,
    /// Views turned away because of overload.
    pub views_rejected: u64,
    /// Session cameras that a newer one overtook before they were rendered.
    pub cameras_superseded: u64,
    /// Views sent to another worker after the first one failed.
    pub views_retried: u64,
    /// Frames that were thrown away because they were not good enough for their request.
    pub frames_refused: u64,
    /// Roles that a worker was told in place of another.
    pub roles_changed: u64,
    /// Workers that joined.
    pub workers_joined: u64,
    /// Workers that fell silent or whose stream ended unannounced.
    pub workers_lost: u64,
    /// Sessions that are open now.
    pub sessions_open: u64,
}

/// The cluster at a glance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    /// P: workers that are ready.
    pub processes: u32,
    /// K: those that sample, the one that plays both roles among them.
    pub samplers: u32,
    /// Those that composite, the one that plays both roles among them.
    pub compositors: u32,
    /// S.
    pub samples_per_tick: f64,
    /// g; 0 until measured.
    pub sample_ms: f64,
    /// V.
    pub views_per_tick: f64,
    /// c; 0 until measured.
    pub view_ms: f64,
    /// D.
    pub direct_views_per_tick: f64,
    /// g_direct; 0 until measured.
    pub direct_ms: f64,
    /// R.
    pub rays_per_tick: f64,
    /// g_ray; 0 until measured.
    pub ray_ms: f64,
    /// max(a/K, b/(P−K)), or less where samplers compose as well: what the work demanded per tick takes the slower stage. More than a tick means that
    /// demand exceeds what the cluster can do. With work and nobody to do it, what one worker would take.
    pub tick_predicted_ms: f64,
    /// How long the busiest worker really worked per tick; never more than a tick.
    pub tick_measured_ms: f64,
    /// How triangles are seen; `None` until that is measured.
    pub visibility: Option<Visibility>,
    /// Samples beside the rig's own cameras.
    pub refinements: Refinements,
    /// Every worker, ready or not, oldest first.
    pub workers: Vec<WorkerStatus>,
    /// By what predicted errors of frames from samples are multiplied, as probes have found.
    pub error_factor: f64,
    /// Since the start.
    pub counters: Counters,
}

/// One worker.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorkerStatus {
    /// What it said when it joined.
    pub hello: Hello,
    /// Its newest report.
    pub report: Report,
    /// The role it counts for; `None` while it starts or leaves.
    pub role: Option<Role>,
    /// It still finishes what its last role gave it.
    pub draining: bool,
}

impl Status {
    /// A snapshot of the three parts.
    pub(super) fn of(workers: &Workers, samples: &Samples, views: &Views) -> Self {
        let (demand, costs, measured) = (workers.demand(), workers.believed_costs(), workers.costs());
        let processes = workers.members().count() as u32;
        let count = |plays: fn(Role) -> bool| {
            workers.members().filter(|w| w.role().is_some_and(plays)).count() as u32
        };
        let load = Load::of(&demand, &costs);
        let predicted = workers.predicted_tick_secs(load, processes, workers.split());
        let alone = load.sampling_secs + load.compositing_secs;
        Self {
            processes,
            samplers: count(Role::samples),
            compositors: count(Role::composites),
            samples_per_tick: demand.samples,
            sample_ms: measured.sample_secs().unwrap_or(0.0) * 1e3,
            views_per_tick: demand.views,
            view_ms: costs.view_secs * 1e3,
            direct_views_per_tick: demand.direct + demand.direct_anywhere,
            direct_ms: measured.direct_secs().unwrap_or(0.0) * 1e3,
            rays_per_tick: demand.rays,
            ray_ms: costs.ray_secs * 1e3,
            tick_predicted_ms: if predicted.is_finite() { predicted } else { alone } * 1e3,
            tick_measured_ms: measured.tick_secs() * 1e3,
            visibility: workers.visibility_is_settled().then_some(samples.set().visibility),
            refinements: samples.placement().counts(),
            workers: workers.iter().map(WorkerStatus::of).collect(),
            error_factor: samples.error_factor(),
            counters: Counters::of(workers, views),
        }
    }
}

impl WorkerStatus {
    fn of(worker: &Worker) -> Self {
        Self {
            hello: worker.hello().clone(),
            report: worker.report().clone(),
            role: worker.role().filter(|_| worker.is_ready()),
            draining: worker.is_changing(),
        }
    }
}

impl Counters {
    fn of(workers: &Workers, views: &Views) -> Self {
        let (of_workers, of_views) = (workers.counts(), views.counts());
        Self {
            views_answered: of_views.answered,
            views_failed: of_views.failed,
            views_rejected: of_views.rejected,
            cameras_superseded: of_views.superseded,
            views_retried: of_views.retried,
            frames_refused: of_views.frames_refused,
            roles_changed: of_workers.roles_changed,
            workers_joined: of_workers.joined,
            workers_lost: of_workers.lost,
            sessions_open: views.sessions() as u64,
        }
    }
}

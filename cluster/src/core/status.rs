//! A snapshot of the core's decisions and of their inputs, for the RPC `Status`.

use argus_scene::Visibility;
use serde::Serialize;

use super::event::{Hello, Report, Role};
use super::samples::{Refinements, Samples};
use super::views::Views;
use super::workers::balance::Load;
use super::workers::{Worker, Workers};

/// Counts since the coordinator started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counters {
    /// Views whose client got the whole frame.
    pub views_answered: u64,
    /// Views that ended with a fault other than overload.
    pub views_failed: u64,
    /// Views refused because of overload.
    pub views_rejected: u64,
    /// Session cameras that were superseded before they were rendered.
    pub cameras_superseded: u64,
    /// Attempts by another worker, after one failed.
    pub views_retried: u64,
    /// Frames that were rejected because of their error.
    pub frames_refused: u64,
    /// Changes of a worker's role.
    pub roles_changed: u64,
    /// Workers that joined.
    pub workers_joined: u64,
    /// Workers whose lease expired or whose stream ended unannounced.
    pub workers_lost: u64,
    /// Open sessions.
    pub sessions_open: u64,
}

/// A snapshot of the cluster.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    /// P: ready workers.
    pub processes: u32,
    /// K: samplers, including a worker with both roles.
    pub samplers: u32,
    /// Compositors, including a worker with both roles.
    pub compositors: u32,
    /// S: samples demanded per tick.
    pub samples_per_tick: f64,
    /// g: milliseconds of a sample; 0 until measured.
    pub sample_ms: f64,
    /// V: views from samples demanded per tick.
    pub views_per_tick: f64,
    /// c: milliseconds of a view from samples; 0 until measured.
    pub view_ms: f64,
    /// D: views from triangles demanded per tick.
    pub direct_views_per_tick: f64,
    /// g_direct: milliseconds of a view from triangles; 0 until measured.
    pub direct_ms: f64,
    /// R: single rays demanded per tick.
    pub rays_per_tick: f64,
    /// g_ray: milliseconds of a single ray; 0 until measured.
    pub ray_ms: f64,
    /// Predicted milliseconds of the slower stage for a tick's demand: max(a/K, b/(P−K)), or less if samplers compose
    /// as well. More than a tick means overload. If a stage has work and no worker: the time that one worker would
    /// take.
    pub tick_predicted_ms: f64,
    /// Measured busy milliseconds of the busiest worker per tick; at most a tick.
    pub tick_measured_ms: f64,
    /// The visibility backend of samples; `None` until it is chosen.
    pub visibility: Option<Visibility>,
    /// Counts of samples at refinements of the rig.
    pub refinements: Refinements,
    /// Every worker, ready or not, oldest first.
    pub workers: Vec<WorkerStatus>,
    /// Factor on predicted errors of frames from samples, learnt from probes.
    pub error_factor: f64,
    /// Counts since the start.
    pub counters: Counters,
}

/// The status of one worker.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorkerStatus {
    /// Its introduction.
    pub hello: Hello,
    /// Its newest report.
    pub report: Report,
    /// Its role; `None` while it starts or leaves.
    pub role: Option<Role>,
    /// Whether it still finishes work of its previous role.
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

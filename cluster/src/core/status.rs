//! What `Status` answers: a snapshot of everything that was decided and of what it was decided on.

use argus_scene::Visibility;
use serde::Serialize;

use super::balance::Load;
use super::event::{Hello, Report, Role};
use super::machine::{Core, Counters};
use super::placement::Refinements;

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

impl Core {
    /// The cluster at a glance.
    pub fn status(&self) -> Status {
        let (demand, costs) = (self.demand(), self.believed_costs());
        let processes = self.members().count() as u32;
        let count = |plays: fn(Role) -> bool| self.members().filter(|w| w.role().is_some_and(plays)).count();
        let load = Load::of(&demand, &costs);
        let predicted = self.predicted_tick_secs(load, processes, self.split);
        let alone = load.sampling_secs + load.compositing_secs;
        Status {
            processes,
            samplers: count(Role::samples) as u32,
            compositors: count(Role::composites) as u32,
            samples_per_tick: demand.samples,
            sample_ms: self.costs.sample.value().unwrap_or(0.0) * 1e3,
            views_per_tick: demand.views,
            view_ms: costs.view_secs * 1e3,
            direct_views_per_tick: demand.direct + demand.direct_anywhere,
            direct_ms: self.costs.direct.value().unwrap_or(0.0) * 1e3,
            rays_per_tick: demand.rays,
            ray_ms: costs.ray_secs * 1e3,
            tick_predicted_ms: if predicted.is_finite() { predicted } else { alone } * 1e3,
            tick_measured_ms: self.costs.tick_secs * 1e3,
            visibility: self.way_is_settled.then_some(self.set.visibility),
            refinements: self.placement.counts(),
            workers: self
                .workers
                .values()
                .map(|w| WorkerStatus {
                    hello: w.hello.clone(),
                    report: w.report.clone(),
                    role: w.role().filter(|_| w.is_ready()),
                    draining: w.is_changing(),
                })
                .collect(),
            error_factor: self.error.factor(),
            counters: self.counters,
        }
    }
}

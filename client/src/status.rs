//! Status of a cluster.

use argus_proto::convert::visibility;
use argus_proto::v1;
use serde::{Deserialize, Serialize};

/// Workers, roles, and the balance between them. Unknown numbers are 0. Serialised, this is the output of `argus status
/// --json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClusterStatus {
    /// The scene's name.
    pub scene: String,
    /// Term of the leading coordinator.
    pub term: u64,
    /// Number of the version of the samples that is served.
    pub version: u64,
    /// Scene time that it shows.
    pub epoch: u64,
    /// P: number of workers.
    pub processes: u32,
    /// K: workers that render samples.
    pub samplers: u32,
    /// Workers that reconstruct views.
    pub compositors: u32,
    /// S: samples to refresh per tick.
    pub samples_per_tick: f64,
    /// g: milliseconds for a sample.
    pub sample_ms: f64,
    /// V: views demanded per tick.
    pub views_per_tick: f64,
    /// c: milliseconds for a reconstructed view.
    pub view_ms: f64,
    /// D: direct views demanded per tick.
    pub direct_views_per_tick: f64,
    /// g_direct: milliseconds for a direct view.
    pub direct_ms: f64,
    /// R: rays per tick for pixels that no sample saw.
    pub rays_per_tick: f64,
    /// g_ray: milliseconds for a single ray.
    pub ray_ms: f64,
    /// The visibility backend: `raster`, `trace` or `cpu`; empty until measured.
    pub visibility: String,
    /// Further samples, placed where views have holes.
    pub refinements: Refinements,
    /// Predicted milliseconds of a tick, by the balance formula.
    pub tick_predicted_ms: f64,
    /// Measured milliseconds of a tick.
    pub tick_measured_ms: f64,
    /// The workers, one per process.
    pub workers: Vec<WorkerStatus>,
    /// Views planned since the coordinator started.
    pub views_planned: u64,
    /// Microseconds of all planning together, including its visibility rays.
    pub planning_us: f64,
    /// Factor on the predicted errors of frames from samples, as probes measured it; 0: unknown.
    pub error_factor: f64,
    /// Counts since the coordinator started.
    pub counters: CounterStatus,
}

/// Status of one worker process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorkerStatus {
    /// The worker's name.
    pub id: String,
    /// Process id.
    pub pid: u32,
    /// `sampler`, `compositor`, `both`, `draining`, `idle`, or `unknown` to this release.
    pub role: String,
    /// Address of its services.
    pub address: String,
    /// GPU adapter, driver and version.
    pub device: String,
    /// CPU cores.
    pub cores: u32,
    /// Measured milliseconds for a sample.
    pub sample_ms: Option<f64>,
    /// Measured milliseconds for a direct view.
    pub direct_ms: Option<f64>,
    /// Measured milliseconds for a reconstructed view.
    pub view_ms: Option<f64>,
    /// Measured milliseconds for a single ray.
    pub ray_ms: Option<f64>,
    /// Samples queued or in work.
    pub queued_samples: u32,
    /// Views queued or in work.
    pub queued_views: u32,
    /// Samples rendered since it started.
    pub samples_rendered: u64,
    /// Views reconstructed since it started.
    pub views_composed: u64,
    /// Views rendered from triangles since it started.
    pub views_direct: u64,
    /// Rays traced for pixels that no sample saw, since it started.
    pub rays_traced: u64,
    /// Samples received from other workers, since it started.
    pub samples_received: u64,
    /// Milliseconds spent unpacking them, beside rendering.
    pub unpacking_ms: f64,
    /// Milliseconds of the render thread spent on holding samples before composing.
    pub holding_ms: f64,
    /// Samples that it can serve now.
    pub samples_held: u64,
    /// Share of the samples in work that is rendered, 0 to 1; `None` while none is in work.
    pub sample_progress: Option<f64>,
}

/// Counts since the coordinator started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CounterStatus {
    /// Views whose frame was relayed.
    pub views_answered: u64,
    /// Views that ended in an error.
    pub views_failed: u64,
    /// Views rejected because of overload.
    pub views_rejected: u64,
    /// Session cameras superseded by a newer one.
    pub cameras_superseded: u64,
    /// Views retried on another worker.
    pub views_retried: u64,
    /// Role changes.
    pub roles_changed: u64,
    /// Workers that joined.
    pub workers_joined: u64,
    /// Workers that were lost.
    pub workers_lost: u64,
    /// Sessions open now.
    pub sessions_open: u64,
    /// Frames discarded because they exceeded their error bound.
    pub frames_refused: u64,
}

impl From<v1::StatusResponse> for ClusterStatus {
    fn from(wire: v1::StatusResponse) -> Self {
        Self {
            scene: wire.scene.map(|scene| scene.name).unwrap_or_default(),
            term: wire.term,
            version: wire.version,
            epoch: wire.epoch,
            processes: wire.processes,
            samplers: wire.samplers,
            compositors: wire.compositors,
            samples_per_tick: number(wire.samples_per_tick),
            sample_ms: number(wire.sample_ms),
            views_per_tick: number(wire.views_per_tick),
            view_ms: number(wire.view_ms),
            direct_views_per_tick: number(wire.direct_views_per_tick),
            direct_ms: number(wire.direct_ms),
            visibility: visibility(wire.visibility, "visibility")
                .map_or_else(|_| String::new(), |way| way.name().to_owned()),
            refinements: wire.refinements.map(Into::into).unwrap_or_default(),
            rays_per_tick: number(wire.rays_per_tick),
            ray_ms: number(wire.ray_ms),
            tick_predicted_ms: number(wire.tick_predicted_ms),
            tick_measured_ms: number(wire.tick_measured_ms),
            workers: wire.workers.into_iter().map(Into::into).collect(),
            views_planned: wire.views_planned,
            planning_us: number(wire.planning_us),
            error_factor: number(wire.error_factor),
            counters: wire.counters.unwrap_or_default().into(),
        }
    }
}

/// Unknown numbers become 0, since JSON has no NaN and scripts expect a number.
fn number(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

impl From<v1::WorkerStatus> for WorkerStatus {
    fn from(wire: v1::WorkerStatus) -> Self {
        let role = match v1::Role::try_from(wire.role) {
            Ok(v1::Role::Sampler) => "sampler",
            Ok(v1::Role::Compositor) => "compositor",
            Ok(v1::Role::Both) => "both",
            Ok(v1::Role::Draining) => "draining",
            Ok(v1::Role::Idle) => "idle",
            Ok(v1::Role::Unspecified) | Err(_) => "unknown",
        };
        Self {
            id: wire.id,
            pid: wire.pid,
            role: role.to_owned(),
            address: wire.address,
            device: wire.device,
            cores: wire.cores,
            sample_ms: wire.sample_ms,
            direct_ms: wire.direct_ms,
            view_ms: wire.view_ms,
            ray_ms: wire.ray_ms,
            queued_samples: wire.queued_samples,
            queued_views: wire.queued_views,
            samples_rendered: wire.samples_rendered,
            views_composed: wire.views_composed,
            views_direct: wire.views_direct,
            rays_traced: wire.rays_traced,
            samples_received: wire.samples_received,
            unpacking_ms: number(wire.unpacking_ms),
            holding_ms: number(wire.holding_ms),
            samples_held: wire.samples_held,
            sample_progress: wire.sample_progress,
        }
    }
}

impl From<v1::Counters> for CounterStatus {
    fn from(wire: v1::Counters) -> Self {
        Self {
            views_answered: wire.views_answered,
            views_failed: wire.views_failed,
            views_rejected: wire.views_rejected,
            cameras_superseded: wire.cameras_superseded,
            views_retried: wire.views_retried,
            roles_changed: wire.roles_changed,
            workers_joined: wire.workers_joined,
            workers_lost: wire.workers_lost,
            sessions_open: wire.sessions_open,
            frames_refused: wire.frames_refused,
        }
    }
}
/// Progress of refinement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Refinements {
    /// Wanted positions that have no sample yet.
    pub wanted: u32,
    /// Samples that were assigned to workers.
    pub placed: u32,
    /// Samples held by compositors, so that plans may name them.
    pub usable: u32,
}

impl From<v1::Refinements> for Refinements {
    fn from(wire: v1::Refinements) -> Self {
        let v1::Refinements { wanted, placed, usable } = wire;
        Self { wanted, placed, usable }
    }
}

//! A snapshot of the core's decisions and of their inputs: the answer to the RPC `Status`.

use argus_proto::PROTOCOL_VERSION;
use argus_proto::convert::WireEnum as _;
use argus_proto::v1::{self, Counters, StatusResponse, WorkerStatus};

use super::event::Role;
use super::quality::Cost;
use super::samples::Samples;
use super::views::Views;
use super::workers::balance::Load;
use super::workers::{Worker, Workers};

/// A snapshot of the three parts. Costs that were not measured are 0.
pub(super) fn of(workers: &Workers, samples: &Samples, views: &Views, market: v1::Market) -> StatusResponse {
    let (demand, costs, measured) = (workers.demand(), workers.believed_costs(), workers.costs());
    let processes = workers.members().count() as u32;
    let count =
        |plays: fn(Role) -> bool| workers.members().filter(|w| w.role().is_some_and(plays)).count() as u32;
    let load = Load::of(&demand, &costs);
    // If a stage has work and no worker, the prediction is the time that one worker would take.
    let predicted = workers.predicted_tick_secs(load, processes, workers.split());
    let alone = load.sampling_secs + load.compositing_secs;
    let set = samples.set();
    let visibility = workers.visibility_is_settled().then(|| set.visibility.number());
    StatusResponse {
        protocol_version: PROTOCOL_VERSION,
        version: set.version.number,
        epoch: set.version.state.epoch,
        light: set.version.state.light.number(),
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
        visibility: visibility.unwrap_or_default(),
        refinements: Some(samples.placement().counts()),
        workers: workers.iter().map(worker_status).collect(),
        counters: Some(counters(workers, views)),
        market: Some(market),
        ..StatusResponse::default()
    }
}

fn worker_status(worker: &Worker) -> WorkerStatus {
    let role = match worker.role().filter(|_| worker.is_ready()) {
        None => v1::Role::Idle,
        Some(_) if worker.is_changing() => v1::Role::Draining,
        Some(playing) => playing.into(),
    };
    let (hello, report) = (worker.hello(), worker.report());
    WorkerStatus {
        id: hello.name.clone(),
        pid: hello.pid,
        role: role as i32,
        address: hello.address.clone(),
        device: hello.device.clone(),
        cores: hello.cores,
        sample_ms: report.sample_ms,
        direct_ms: report.direct_ms,
        view_ms: report.view_ms,
        ray_ms: report.ray_ms,
        queued_samples: report.queued_samples,
        queued_views: report.queued_views,
        samples_rendered: report.samples_rendered,
        views_composed: report.views_composed,
        views_direct: report.views_direct,
        rays_traced: report.rays_traced,
        samples_received: report.samples_received,
        unpacking_ms: report.unpacking_ms,
        holding_ms: report.holding_ms,
        samples_held: report.held.len() as u64,
        frames_held: report.frames_held,
        frames_bytes: report.frames_bytes,
        light_cells: report.light_cells,
        sample_progress: report.sample_progress,
        direct_cost: report.direct_cost.map(Into::into),
        few_rays_cost: report.few_rays_cost.map(Into::into),
        warp_cost: report.warp_cost.map(Into::into),
    }
}

impl From<Cost> for v1::Cost {
    fn from(Cost { fixed_ms, ms_per_megapixel }: Cost) -> Self {
        Self { fixed_ms, ms_per_megapixel }
    }
}

fn counters(workers: &Workers, views: &Views) -> Counters {
    let (of_workers, of_views) = (workers.counts(), views.counts());
    Counters {
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

impl From<Role> for v1::Role {
    fn from(role: Role) -> Self {
        match role {
            Role::Sampler => Self::Sampler,
            Role::Compositor => Self::Compositor,
            Role::Both => Self::Both,
        }
    }
}

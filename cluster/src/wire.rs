//! Conversions between the core's types and wire messages.

mod sources;

use std::time::Duration;

use argus_proto::convert::{WireEnum as _, light_level, scene_hash_bytes};
use argus_proto::{PROTOCOL_VERSION, v1};
use argus_scene::{
    FaceMask, InvalidField, Limits, Plan, SampleId, SampleSetInfo, SceneHash, Transforms, Version, Visibility,
};

use crate::SceneRef;
use crate::core::quality::{Cost, Observed};
use crate::core::{Assignment, Fallback, Hello, Report, Role, Source};
use crate::sealed::SealKey;
use crate::security::LoadedSecurity;

pub(crate) use self::sources::{MOST_ADDED, Probe, probe, purchases};

/// Longest name of a worker, bytes: it is in every frame and log line.
const MAX_NAME: usize = 128;

/// Reads the role of an assignment.
pub(crate) fn role_from(number: i32) -> Result<Role, InvalidField> {
    match v1::Role::try_from(number) {
        Ok(v1::Role::Sampler) => Ok(Role::Sampler),
        Ok(v1::Role::Compositor) => Ok(Role::Compositor),
        Ok(v1::Role::Both) => Ok(Role::Both),
        _ => Err(InvalidField::new("role", format!("{number} is not a role to be assigned"))),
    }
}

pub(crate) fn hello_from(wire: v1::Hello, security: Option<&LoadedSecurity>) -> Result<Hello, InvalidField> {
    if wire.worker_id.is_empty() || wire.worker_id.len() > MAX_NAME {
        let reason = format!("must be 1 to {MAX_NAME} bytes long, not {}", wire.worker_id.len());
        return Err(InvalidField::new("hello.worker_id", reason));
    }
    crate::net::endpoint(&wire.address, Duration::from_secs(1), security)
        .map_err(|reason| InvalidField::new("hello.address", reason))?;
    let public_address = Some(wire.public_address).filter(|address| !address.is_empty());
    if let Some(address) = &public_address {
        crate::net::endpoint(address, Duration::from_secs(1), security)
            .map_err(|reason| InvalidField::new("hello.public_address", reason))?;
    }
    Ok(Hello {
        name: wire.worker_id,
        pid: wire.pid,
        address: wire.address,
        public_address,
        device: wire.device,
        cores: wire.cores,
    })
}

/// The first message of a worker. `held` is the scene that it has open.
pub(crate) fn hello(hello: &Hello, held: Option<SceneHash>) -> v1::WorkerReport {
    let hello = v1::Hello {
        protocol_version: PROTOCOL_VERSION,
        worker_id: hello.name.clone(),
        pid: hello.pid,
        address: hello.address.clone(),
        public_address: hello.public_address.clone().unwrap_or_default(),
        device: hello.device.clone(),
        cores: hello.cores,
        scene_hash: held.map(scene_hash_bytes).unwrap_or_default(),
    };
    v1::WorkerReport { body: Some(v1::worker_report::Body::Hello(hello)) }
}

pub(crate) fn report_from(wire: v1::Measurements) -> Report {
    // A wrong clock must not corrupt sums. The smoothing of costs has its own checks.
    let busy = |ms: f64| if ms > 0.0 && ms.is_finite() { ms } else { 0.0 };
    Report {
        applied: wire.applied,
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
        sampling_busy_ms: busy(wire.sampling_busy_ms),
        compositing_busy_ms: busy(wire.compositing_busy_ms),
        samples_received: wire.samples_received,
        unpacking_ms: busy(wire.unpacking_ms),
        holding_ms: busy(wire.holding_ms),
        held: wire.held.into_iter().map(Into::into).collect(),
        partial: wire.partial.into_iter().filter_map(partial_from).collect(),
        leaving: wire.leaving,
        piece_ms: busy(wire.piece_ms),
        part_ms: wire.part_ms,
        sample_progress: wire.sample_progress.filter(|share| (0.0..=1.0).contains(share)),
        sample_bytes: wire.sample_bytes,
        // A level that is not known here is better than those that are.
        light: light_level(wire.light, "light").unwrap_or_default(),
        direct_cost: wire.direct_cost.and_then(cost_from),
        few_rays_cost: wire.few_rays_cost.and_then(cost_from),
        warp_cost: wire.warp_cost.and_then(cost_from),
        frame_cost: wire.frame_cost.and_then(cost_from),
        effect_costs: wire.effect_costs.into_iter().filter_map(|cost| cost.try_into().ok()).collect(),
        frames_held: wire.frames_held,
        frames_bytes: wire.frames_bytes,
        light_cells: wire.light_cells.map(|cells| v1::LightCells {
            fill_ms: busy(cells.fill_ms),
            take_ms: busy(cells.take_ms),
            ..cells
        }),
        sources: wire.sources.map(sources::news_from),
        probes: sources::results_from(wire.probe_results),
        backend_costs: wire
            .backend_costs
            .into_iter()
            .filter_map(|cost| {
                Some((Visibility::from_number(cost.visibility, "backend_costs").ok()?, cost.ms))
            })
            .collect(),
    }
}

pub(crate) fn report(report: Report, acting: Role) -> v1::WorkerReport {
    let measurements = v1::Measurements {
        applied: report.applied,
        role: v1::Role::from(acting) as i32,
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
        sampling_busy_ms: report.sampling_busy_ms,
        compositing_busy_ms: report.compositing_busy_ms,
        samples_received: report.samples_received,
        unpacking_ms: report.unpacking_ms,
        holding_ms: report.holding_ms,
        held: report.held.into_iter().map(Into::into).collect(),
        partial: report.partial.into_iter().map(partial).collect(),
        leaving: report.leaving,
        piece_ms: report.piece_ms,
        part_ms: report.part_ms,
        sample_progress: report.sample_progress,
        sample_bytes: report.sample_bytes,
        light: report.light.number(),
        direct_cost: report.direct_cost.map(Into::into),
        few_rays_cost: report.few_rays_cost.map(Into::into),
        warp_cost: report.warp_cost.map(Into::into),
        frame_cost: report.frame_cost.map(Into::into),
        effect_costs: report.effect_costs.into_iter().map(Into::into).collect(),
        frames_held: report.frames_held,
        frames_bytes: report.frames_bytes,
        light_cells: report.light_cells,
        sources: report.sources.map(Into::into),
        probe_results: report.probes.into_iter().map(Into::into).collect(),
        backend_costs: report.backend_costs.into_iter().map(backend_cost).collect(),
    };
    v1::WorkerReport { body: Some(v1::worker_report::Body::Measurements(measurements)) }
}

fn partial((id, faces): (SampleId, FaceMask)) -> v1::PartialSample {
    v1::PartialSample { id: Some(id.into()), faces: faces.bits() }
}

/// A sample of no faces, or of faces that there are not, has none that are of use.
fn partial_from(wire: v1::PartialSample) -> Option<(SampleId, FaceMask)> {
    let faces = FaceMask::new(wire.faces, "partial.faces").unwrap_or(FaceMask::NONE);
    Some((wire.id?.into(), faces))
}

/// Reads a cost. `None` if it is not finite, negative or zero.
fn cost_from(v1::Cost { fixed_ms, ms_per_megapixel }: v1::Cost) -> Option<Cost> {
    let measured = |ms: f64| ms >= 0.0 && ms.is_finite();
    let cost = Cost { fixed_ms, ms_per_megapixel };
    (measured(fixed_ms) && measured(ms_per_megapixel) && fixed_ms + ms_per_megapixel > 0.0).then_some(cost)
}

fn backend_cost((visibility, ms): (Visibility, f64)) -> v1::BackendCost {
    v1::BackendCost { visibility: visibility.number(), ms }
}

/// Constant parts of all assignments of a coordinator.
#[derive(Debug, Clone)]
pub(crate) struct ServiceInfo {
    pub(crate) scene: SceneRef,
    pub(crate) limits: Limits,
    pub(crate) report_interval: Duration,
}

/// The parts of the core's state in each assignment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Served<'a> {
    pub(crate) set: &'a SampleSetInfo,
    /// The versions of the assignment's samples.
    pub(crate) versions: &'a [Version],
    pub(crate) visibility_is_open: bool,
}

pub(crate) fn scene_ref(scene: &SceneRef) -> v1::SceneRef {
    v1::SceneRef { name: scene.name.clone(), hash: scene_hash_bytes(scene.hash) }
}

pub(crate) fn assignment(
    assignment: Assignment,
    term: u64,
    service: &ServiceInfo,
    served: &Served<'_>,
    key: Option<&SealKey>,
) -> v1::Assignment {
    v1::Assignment {
        term,
        sequence: assignment.sequence,
        role: v1::Role::from(assignment.role) as i32,
        scene: Some(scene_ref(&service.scene)),
        set: Some(served.set.into()),
        versions: served.versions.iter().map(|version| (*version).into()).collect(),
        sources: sources(assignment.prefetch),
        purchases: assignment.purchases.iter().map(Into::into).collect(),
        kept_from: assignment.kept_from,
        measure_backends: assignment.measure_backends,
        visibility_is_open: served.visibility_is_open,
        suspected: assignment.suspected,
        cell_holders: assignment.cell_holders,
        transforms: None,
        seal_key: key.map(SealKey::to_bytes).unwrap_or_default().into(),
        limits: Some(service.limits.into()),
        report_interval_ms: u32::try_from(service.report_interval.as_millis()).unwrap_or(u32::MAX),
    }
}

/// The message that tells a worker a state of the nodes' transforms.
pub(crate) fn moved(transforms: &Transforms, term: u64) -> v1::Assignment {
    v1::Assignment { term, transforms: Some(transforms.into()), ..v1::Assignment::default() }
}

pub(crate) fn observed(observed: Observed) -> v1::Observed {
    let Observed { detail, coarse_detail, edges, unresolved, agreeing, residual } = observed;
    v1::Observed { detail, coarse_detail, edges, unresolved, agreeing, residual }
}

/// Reads statistics unchecked: non-finite values are rejected by [`crate::core::quality::Regression::believe`].
pub(crate) fn observed_from(wire: v1::Observed) -> Observed {
    let v1::Observed { detail, coarse_detail, edges, unresolved, agreeing, residual } = wire;
    Observed { detail, coarse_detail, edges, unresolved, agreeing, residual }
}

/// What replaces a frame from samples.
///
/// # Errors
/// A plan that is not from triangles, or an error that is none.
pub(crate) fn fallback(wire: v1::Fallback) -> Result<Fallback, InvalidField> {
    let plan = wire.plan.ok_or_else(|| InvalidField::new("order.fallback.plan", "is missing"))?;
    let plan = Plan::try_from(plan)?;
    if plan.needs_samples() || !plan.frames().is_empty() {
        return Err(InvalidField::new("order.fallback.plan", "must be from triangles"));
    }
    match wire.max_uncovered {
        max_uncovered if (0.0..=1.0).contains(&max_uncovered) => Ok(Fallback { plan, max_uncovered }),
        other => {
            Err(InvalidField::new("order.fallback.max_uncovered", format!("must be 0 to 1, not {other}")))
        }
    }
}

pub(crate) fn sources(sources: Vec<Source>) -> Vec<v1::SampleSource> {
    sources
        .into_iter()
        .map(|Source { id, faces, addresses, dispensable }| v1::SampleSource {
            id: Some(id.into()),
            addresses,
            dispensable,
            faces: faces.bits(),
        })
        .collect()
}

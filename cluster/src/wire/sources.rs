//! Purchases, held sources and probes on the wire.

use argus_proto::convert::WireEnum as _;
use argus_proto::v1;
use argus_scene::{FrameSource, InvalidField, Limits, Plan, SceneState, Visibility};

use crate::core::{HeldSource, ProbeResult, Purchase, SourceNews, ViewId};

/// Most sources in one report.
pub(crate) const MOST_ADDED: usize = 1024;

/// Most purchases of an assignment.
const MOST_PURCHASES: usize = 64;

/// Most plans of a probe, beside the answered frame.
const MOST_PLANS: usize = 8;

impl From<&Purchase> for v1::Purchase {
    fn from(Purchase { source, state }: &Purchase) -> Self {
        Self { source: Some(source.into()), state: Some((*state).into()) }
    }
}

/// Reads the purchases of an assignment.
///
/// # Errors
/// A field of a frame that the worker would not render, or too many purchases.
pub(crate) fn purchases(wire: Vec<v1::Purchase>, limits: &Limits) -> Result<Vec<Purchase>, InvalidField> {
    InvalidField::within("purchases", wire.len(), 0..=MOST_PURCHASES)?;
    let purchase = |v1::Purchase { source, state }| {
        let source = source.ok_or_else(|| InvalidField::new("purchases.source", "must be given"))?;
        let source = FrameSource::try_from(source)?;
        source.validate(limits)?;
        Ok(Purchase { source, state: state.map(SceneState::try_from).transpose()?.unwrap_or_default() })
    };
    wire.into_iter().map(purchase).collect()
}

impl From<HeldSource> for v1::HeldSource {
    fn from(held: HeldSource) -> Self {
        let HeldSource { id, source, state, visibility, ranges, bought, render_ms } = held;
        Self {
            id: Some(id.into()),
            source: Some((&source).into()),
            state: Some(state.into()),
            visibility: visibility.number(),
            ranges: ranges.to_vec(),
            bought,
            render_ms,
        }
    }
}

impl From<SourceNews> for v1::SourceNews {
    fn from(SourceNews { whole, added, dropped }: SourceNews) -> Self {
        Self {
            whole,
            added: added.into_iter().map(Into::into).collect(),
            dropped: dropped.into_iter().map(Into::into).collect(),
        }
    }
}

/// Reads changes of a worker's sources. Sources that are malformed are left out.
pub(super) fn news_from(v1::SourceNews { whole, added, dropped }: v1::SourceNews) -> SourceNews {
    SourceNews {
        whole,
        added: added.into_iter().take(MOST_ADDED).filter_map(held_from).collect(),
        dropped: dropped.into_iter().map(Into::into).collect(),
    }
}

fn held_from(wire: v1::HeldSource) -> Option<HeldSource> {
    let is_range = |inverse: &f32| inverse.is_finite() && *inverse >= 0.0;
    let points = FrameSource::GRID.iter().product::<u32>() as usize;
    let ranges = Some(wire.ranges).filter(|all| all.len() == points && all.iter().all(is_range))?;
    Some(HeldSource {
        id: wire.id?.into(),
        source: wire.source?.try_into().ok()?,
        state: wire.state?.try_into().ok()?,
        visibility: Visibility::from_number(wire.visibility, "sources.visibility").ok()?,
        ranges: ranges.into(),
        bought: wire.bought,
        render_ms: if is_range(&wire.render_ms) { wire.render_ms } else { 0.0 },
    })
}

impl From<ProbeResult> for v1::ProbeResult {
    fn from(ProbeResult { view_id, attempt, excess }: ProbeResult) -> Self {
        Self { view_id: view_id.0, attempt, excess }
    }
}

/// Reads results of probes. An error that no frame can have counts as not measured.
pub(super) fn results_from(wire: Vec<v1::ProbeResult>) -> Vec<ProbeResult> {
    let excess = |excess: f32| if (-1.0..=1.0).contains(&excess) { excess } else { f32::NAN };
    wire.into_iter()
        .map(|result| ProbeResult {
            view_id: ViewId(result.view_id),
            attempt: result.attempt,
            excess: result.excess.into_iter().take(1 + MOST_PLANS).map(excess).collect(),
        })
        .collect()
}

/// A validated order to measure errors of a view.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Probe {
    pub(crate) view_id: ViewId,
    pub(crate) attempt: u32,
    /// Plans beside that of the answered frame.
    pub(crate) plans: Vec<Plan>,
}

/// Reads an order to measure errors of a view.
///
/// # Errors
/// A plan that is malformed or needs samples of a set, or too many plans.
pub(crate) fn probe(wire: v1::Probe) -> Result<Probe, InvalidField> {
    const FIELD: &str = "order.probe.plans";
    InvalidField::within(FIELD, wire.plans.len(), 0..=MOST_PLANS)?;
    let plans: Vec<Plan> = wire.plans.into_iter().map(Plan::try_from).collect::<Result<_, _>>()?;
    if plans.iter().any(Plan::needs_samples) {
        return Err(InvalidField::new(FIELD, "must be from triangles or frames"));
    }
    Ok(Probe { view_id: ViewId(wire.view_id), attempt: wire.attempt, plans })
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, SampleId};
    use glam::DVec3;

    use super::*;
    use crate::core::{Report, Role};

    fn source() -> FrameSource {
        let camera = Camera::look_at(DVec3::new(3.0, 2.0, 5.0), DVec3::ZERO);
        FrameSource { camera, width: 80, height: 60, samples_per_pixel: 4, band_rows: 0, light: None }
    }

    fn held() -> HeldSource {
        HeldSource {
            id: source().id(),
            source: source(),
            state: SceneState::of_epoch(3),
            visibility: Visibility::default(),
            ranges: vec![0.25; 108].into(),
            bought: true,
            render_ms: 12.0,
        }
    }

    fn sent(report: Report) -> Report {
        match super::super::report(report, Role::Both).body {
            Some(v1::worker_report::Body::Measurements(measured)) => super::super::report_from(measured),
            _ => Report::default(),
        }
    }

    #[test]
    fn held_sources_and_probes_survive_the_wire() {
        let sources = SourceNews { whole: true, added: vec![held()], dropped: vec![source().id()] };
        let probes = vec![ProbeResult { view_id: ViewId(9), attempt: 2, excess: vec![-0.01, 0.125] }];
        let report = Report { sources: Some(sources), probes, ..Report::default() };
        assert_eq!(sent(report.clone()), report);
        assert_eq!(sent(Report::default()).sources, None);
    }

    #[test]
    fn malformed_sources_are_left_out_and_odd_errors_count_as_not_measured() {
        let odd = [vec![0.25; 107], vec![f32::NAN; 108], vec![-1.0; 108]];
        let added = odd.map(|ranges| HeldSource { ranges: ranges.into(), ..held() });
        let without_kind = HeldSource { render_ms: f32::NAN, ..held() };
        let added = added.into_iter().chain([without_kind]).collect();
        let news = SourceNews { whole: false, added, dropped: Vec::new() };
        let excess = vec![f32::NAN, 7.0, f32::INFINITY];
        let probes = vec![ProbeResult { view_id: ViewId(1), attempt: 1, excess }];
        let got = sent(Report { sources: Some(news), probes, ..Report::default() });
        assert_eq!(got.sources.unwrap().added, [HeldSource { render_ms: 0.0, ..held() }]);
        assert!(got.probes[0].excess.len() == 3 && got.probes[0].excess.iter().all(|excess| excess.is_nan()));
    }

    #[test]
    fn purchases_that_a_worker_would_not_render_are_refused() {
        let limits = Limits::default();
        let purchase = Purchase { source: source(), state: SceneState::of_epoch(2) };
        assert_eq!(purchases(vec![(&purchase).into()], &limits), Ok(vec![purchase]));
        let large = Purchase { source: FrameSource { width: 100_000, ..source() }, ..purchase };
        assert_eq!(purchases(vec![(&large).into()], &limits).unwrap_err().field, "width");
        assert_eq!(purchases(vec![v1::Purchase::default()], &limits).unwrap_err().field, "purchases.source");
        assert!(purchases(vec![(&purchase).into(); 65], &limits).is_err());
    }

    #[test]
    fn a_probe_of_a_plan_from_samples_of_a_set_is_refused() {
        let plan = |plan: &Plan| v1::Probe { view_id: 4, attempt: 1, plans: vec![plan.into()] };
        let asked = probe(plan(&Plan::direct(1))).unwrap();
        assert_eq!(asked, Probe { view_id: ViewId(4), attempt: 1, plans: vec![Plan::direct(1)] });
        let samples = vec![SampleId { version: 0, camera: 3 }];
        let warp = Plan::Warp(argus_scene::Warp { samples, ..argus_scene::Warp::default() });
        assert_eq!(probe(plan(&warp)).unwrap_err().field, "order.probe.plans");
    }
}

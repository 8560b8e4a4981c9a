//! Rows of the cluster study.

mod figures;

use argus_cluster::core::balance;
use serde::Serialize;
use serde_json::{Map, Value};

use super::measure::Measured;
use super::method::{Method, load, paper, predicted_secs};
use crate::load::simulate::efficiency::Outcome;
use crate::load::simulate::{Parameters, trouble};
use crate::report;

pub(super) use self::figures::{notes, notes_of_measured, plots_of_measured, plots_of_simulated};

/// One row of the table; times are milliseconds per tick.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Row {
    kind: &'static str,
    #[serde(rename = "way")]
    method: &'static str,
    /// The trouble of a simulated row.
    trouble: Option<&'static str>,
    processes: u32,
    /// Cores of each simulated machine.
    cores: Option<u32>,
    /// Views per tick, or all views of a row with a trouble.
    views: u64,
    clients: Option<u64>,
    samplers: u32,
    relayed: bool,
    tick_ms: Option<f64>,
    predicted_ms: Option<f64>,
    per_predicted: Option<f64>,
    /// The simulated tick, its relative difference from the measured one, and whether the simulation's costs come
    /// from this very row.
    simulated_ms: Option<f64>,
    agreement_fraction: Option<f64>,
    calibrates: Option<bool>,
    sample_ms: f64,
    direct_ms: f64,
    view_ms: f64,
    sampling_ms: Option<f64>,
    sampling_rest_ms: Option<f64>,
    passes_ms: Option<f64>,
    pooled_ms: Option<f64>,
    record_ms: Option<f64>,
    unpack_ms: Option<f64>,
    rest_ms: Option<f64>,
    unpack_samples_ms: Option<f64>,
    hold_samples_ms: Option<f64>,
    encode_ms: Option<f64>,
    relay_ms: Option<f64>,
    await_samples_ms: Option<f64>,
    queue_ms: Option<f64>,
    /// Speedups of a tick by g and c over sampling and compositing one after another, and over rendering all
    /// views directly.
    speedup_by_costs: Option<f64>,
    speedup_over_direct: Option<f64>,
    /// T(1) of the same method, measured, divided by T(P).
    speedup_over_alone: Option<f64>,
    /// The speedups divided by the number of processes.
    efficiency: Option<f64>,
    efficiency_over_alone: Option<f64>,
    bound: Option<f64>,
    per_bound: Option<f64>,
    paper_efficiency: Option<f64>,
    core_us_per_view: Option<f64>,
    p50_ms: Option<f64>,
    p99_ms: Option<f64>,
    worst_ms: Option<f64>,
    processes_lost: Option<u64>,
    retried: Option<u64>,
    rejected: Option<u64>,
    lost: Option<u64>,
    passed: Option<bool>,
}

/// Largest accepted relative difference of simulation and measurement.
const AGREEMENT: f64 = 0.15;

/// What a measured row is compared with.
pub(super) struct Beside<'a> {
    /// The run from samples whose costs apply if this run has none.
    pub(super) proposed: &'a Measured,
    /// T(1) of the same method and number of views, if it was run.
    pub(super) alone_secs: Option<f64>,
    pub(super) simulated_secs: f64,
    pub(super) calibrates: bool,
    pub(super) judged: bool,
}

impl Row {
    /// The row of one tick.
    fn new(
        kind: &'static str,
        (processes, views, method): (u32, u64, Method),
        samplers: u32,
        tick_secs: f64,
        costs: (f64, f64, f64),
    ) -> Self {
        let load_of_method = load(views, method, costs);
        let proposed = load(views, if method == Method::Naive { Method::Proposed } else { method }, costs);
        let serial = proposed.sampling_secs + proposed.compositing_secs;
        let predicted = predicted_secs(load_of_method, processes, samplers, method);
        let efficiency = serial / (f64::from(processes) * tick_secs);
        let bound = match method {
            Method::Helping => 1.0,
            Method::Naive => serial / (f64::from(processes) * predicted),
            _ => balance::efficiency_bound(proposed, processes),
        };
        Self {
            tick_ms: Some(tick_secs * 1e3),
            predicted_ms: Some(predicted * 1e3),
            per_predicted: Some(tick_secs / predicted),
            speedup_by_costs: Some(serial / tick_secs),
            speedup_over_direct: Some(views as f64 * costs.1 * 1e-3 / tick_secs),
            efficiency: Some(efficiency),
            bound: Some(bound),
            per_bound: Some(efficiency / bound),
            paper_efficiency: paper(processes, method).filter(|_| views == 1000),
            ..Self::empty(kind, (processes, views, method), samplers, costs)
        }
    }

    /// A row with its costs only.
    fn empty(
        kind: &'static str,
        (processes, views, method): (u32, u64, Method),
        samplers: u32,
        costs: (f64, f64, f64),
    ) -> Self {
        Self {
            kind,
            method: method.name(),
            trouble: None,
            processes,
            cores: None,
            views,
            clients: None,
            samplers,
            relayed: true,
            tick_ms: None,
            predicted_ms: None,
            per_predicted: None,
            simulated_ms: None,
            agreement_fraction: None,
            calibrates: None,
            sample_ms: costs.0,
            direct_ms: costs.1,
            view_ms: costs.2,
            sampling_ms: None,
            sampling_rest_ms: None,
            passes_ms: None,
            pooled_ms: None,
            record_ms: None,
            unpack_ms: None,
            rest_ms: None,
            unpack_samples_ms: None,
            hold_samples_ms: None,
            encode_ms: None,
            relay_ms: None,
            await_samples_ms: None,
            queue_ms: None,
            speedup_by_costs: None,
            speedup_over_direct: None,
            speedup_over_alone: None,
            efficiency: None,
            efficiency_over_alone: None,
            bound: None,
            per_bound: None,
            paper_efficiency: None,
            core_us_per_view: None,
            p50_ms: None,
            p99_ms: None,
            worst_ms: None,
            processes_lost: None,
            retried: None,
            rejected: None,
            lost: None,
            passed: None,
        }
    }

    pub(super) fn measured(
        processes: u32,
        views: u32,
        method: Method,
        m: &Measured,
        beside: &Beside<'_>,
    ) -> Self {
        let of_samples = if method == Method::Naive { beside.proposed } else { m };
        let costs = (of_samples.sample_secs * 1e3, m.direct_secs * 1e3, of_samples.view_secs * 1e3);
        let ms = |secs: f64| Some(secs * 1e3);
        let agreement = (m.tick_secs / beside.simulated_secs - 1.0).abs();
        let over_alone = beside.alone_secs.map(|alone| alone / m.tick_secs);
        Self {
            simulated_ms: ms(beside.simulated_secs),
            agreement_fraction: Some(agreement),
            calibrates: Some(beside.calibrates),
            sampling_ms: ms(m.sampling),
            sampling_rest_ms: m.sampling_shares.map(|shares| shares.rest * m.sampling * 1e3),
            passes_ms: ms(m.parts.passes),
            pooled_ms: ms(m.parts.pooled),
            record_ms: ms(m.parts.record),
            unpack_ms: ms(m.parts.unpack),
            rest_ms: ms(m.rest),
            unpack_samples_ms: ms(m.unpacking),
            hold_samples_ms: ms(m.holding),
            encode_ms: ms(m.parts.encode),
            relay_ms: ms(m.parts.relay),
            await_samples_ms: ms(m.parts.await_samples),
            queue_ms: ms(m.parts.queue),
            speedup_over_alone: over_alone,
            efficiency_over_alone: over_alone.map(|speedup| speedup / f64::from(processes)),
            // A row cannot be judged by costs that were taken from it.
            passed: (beside.judged && !beside.calibrates).then_some(agreement <= AGREEMENT),
            ..Self::new("measured", (processes, u64::from(views), method), m.samplers, m.tick_secs, costs)
        }
    }

    pub(super) fn simulated(
        processes: u32,
        views: u64,
        method: Method,
        costs: &Parameters,
        outcome: &Outcome,
    ) -> Self {
        let of = costs.wall_ms(processes).into();
        Self {
            relayed: costs.relayed,
            cores: Some(costs.machines.cores()),
            core_us_per_view: Some(outcome.core_us_per_view),
            ..Self::new("simulated", (processes, views, method), outcome.samplers, outcome.tick_secs, of)
        }
    }

    /// A row of a simulated cluster with a trouble. It passes if no view is lost.
    pub(super) fn troubled(costs: &Parameters, outcome: &trouble::Outcome) -> Self {
        let trouble::Outcome { processes, asked, samplers, .. } = *outcome;
        let of = costs.wall_ms(processes).into();
        Self {
            method: "still scene, samplers compose",
            trouble: Some(outcome.trouble.name()),
            clients: Some(outcome.clients),
            relayed: costs.relayed,
            cores: Some(costs.machines.cores()),
            core_us_per_view: Some(outcome.core_us_per_view),
            p50_ms: Some(outcome.p50_ms),
            p99_ms: Some(outcome.p99_ms),
            worst_ms: Some(outcome.worst_ms),
            processes_lost: Some(outcome.processes_lost),
            retried: Some(outcome.retried),
            rejected: Some(outcome.rejected),
            lost: Some(outcome.lost),
            passed: Some(outcome.lost == 0),
            ..Self::empty("simulated", (processes, asked, Method::Still), samplers, of)
        }
    }
}

pub(super) fn table(rows: &[Row]) -> Vec<Map<String, Value>> {
    rows.iter().map(|row| report::row(serde_json::to_value(row).unwrap_or_default())).collect()
}

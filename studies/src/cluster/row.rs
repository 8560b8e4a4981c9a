//! Rows, plots and notes of the cluster study.

use argus_cluster::core::balance;
use serde::Serialize;
use serde_json::{Map, Value};

use super::measure::Measured;
use super::{Way, load, paper, predicted_secs};
use crate::plot::{Axis, Plot, Series};
use crate::report;
use crate::simulate::Parameters;
use crate::simulate::efficiency::Outcome;

/// One figure of the table; times are milliseconds a tick.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Row {
    kind: &'static str,
    way: &'static str,
    processes: u32,
    views: u64,
    samplers: u32,
    relayed: bool,
    tick_ms: f64,
    predicted_ms: f64,
    per_predicted: f64,
    /// What the simulation says of a measured tick.
    simulated_ms: Option<f64>,
    per_simulated: Option<f64>,
    sample_ms: f64,
    direct_ms: f64,
    view_ms: f64,
    sampling_ms: Option<f64>,
    compositing_ms: Option<f64>,
    gpu_cpu_ms: Option<f64>,
    network_ms: Option<f64>,
    encode_ms: Option<f64>,
    /// Against one process that does the same work from samples, and against one that renders all views directly.
    speedup: f64,
    speedup_over_direct: f64,
    efficiency: f64,
    bound: f64,
    per_bound: f64,
    paper_efficiency: Option<f64>,
    core_us_per_view: Option<f64>,
}

/// Agreement that is asked of simulation and measurement.
const AGREEMENT: f64 = 0.15;

impl Row {
    fn new(
        kind: &'static str,
        (processes, views, way): (u32, u64, Way),
        samplers: u32,
        tick_secs: f64,
        costs: (f64, f64, f64),
    ) -> Self {
        let load_of_way = load(views, way, costs);
        let proposed = load(views, if way == Way::Naive { Way::Proposed } else { way }, costs);
        let serial = proposed.sampling_secs + proposed.compositing_secs;
        let predicted = predicted_secs(load_of_way, processes, samplers, way);
        let efficiency = serial / (f64::from(processes) * tick_secs);
        let bound = match way {
            Way::Helping => 1.0,
            Way::Naive => serial / (f64::from(processes) * predicted),
            _ => balance::efficiency_bound(proposed, processes),
        };
        Self {
            kind,
            way: way.name(),
            processes,
            views,
            samplers,
            relayed: true,
            tick_ms: tick_secs * 1e3,
            predicted_ms: predicted * 1e3,
            per_predicted: tick_secs / predicted,
            simulated_ms: None,
            per_simulated: None,
            sample_ms: costs.0,
            direct_ms: costs.1,
            view_ms: costs.2,
            sampling_ms: None,
            compositing_ms: None,
            gpu_cpu_ms: None,
            network_ms: None,
            encode_ms: None,
            speedup: serial / tick_secs,
            speedup_over_direct: views as f64 * costs.1 * 1e-3 / tick_secs,
            efficiency,
            bound,
            per_bound: efficiency / bound,
            paper_efficiency: paper(processes, way).filter(|_| views == 1000),
            core_us_per_view: None,
        }
    }

    /// `proposed`: the run with samples, by whose costs the work of a tick is reckoned where there are none.
    pub(super) fn measured(
        processes: u32,
        views: u32,
        way: Way,
        (m, proposed): (&Measured, &Measured),
        simulated_secs: f64,
    ) -> Self {
        let of_samples = if way == Way::Naive { proposed } else { m };
        let costs = (of_samples.sample_secs * 1e3, m.direct_secs * 1e3, of_samples.view_secs * 1e3);
        let ms = |secs: f64| Some(secs * 1e3);
        Self {
            simulated_ms: ms(simulated_secs),
            per_simulated: Some(m.tick_secs / simulated_secs),
            sampling_ms: ms(m.sampling),
            compositing_ms: ms(m.compositing),
            gpu_cpu_ms: ms(m.readback),
            network_ms: ms(m.network),
            encode_ms: ms(m.encode),
            ..Self::new("measured", (processes, u64::from(views), way), m.samplers, m.tick_secs, costs)
        }
    }

    pub(super) fn simulated(
        processes: u32,
        views: u64,
        way: Way,
        costs: &Parameters,
        outcome: &Outcome,
    ) -> Self {
        let of = (costs.sample_ms, costs.direct_ms, costs.view_ms);
        Self {
            relayed: costs.relayed,
            core_us_per_view: Some(outcome.core_us_per_view),
            ..Self::new("simulated", (processes, views, way), outcome.samplers, outcome.tick_secs, of)
        }
    }

    /// Whether measurement and simulation agree, where both are.
    pub(super) fn agrees(&self) -> bool {
        self.per_simulated.is_none_or(|ratio| (ratio - 1.0).abs() <= AGREEMENT)
    }
}

pub(super) fn table(rows: &[Row]) -> Vec<Map<String, Value>> {
    rows.iter().map(|row| report::row(serde_json::to_value(row).unwrap_or_default())).collect()
}

/// One part of a tick, milliseconds.
type Part = fn(&Row) -> Option<f64>;

fn line(name: &str, points: impl Iterator<Item = (f64, f64)>) -> Series {
    let mut points: Vec<(f64, f64)> = points.collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    Series { name: name.to_owned(), points, line: true }
}

fn lines(rows: &[Row], is: impl Fn(&Row) -> bool, at: impl Fn(&Row) -> (f64, f64)) -> Vec<Series> {
    Way::ALL.map(|way| line(way.name(), rows.iter().filter(|r| r.way == way.name() && is(r)).map(&at))).into()
}

/// Time against views, its parts, and efficiency against processes (figures 5 to 8).
pub(super) fn plots_of_measured(rows: &[Row], processes: u32, views: u32) -> Vec<Plot> {
    let here = |row: &Row| row.processes == processes;
    let time = Plot {
        name: "time".to_owned(),
        title: format!("A tick on {processes} processes"),
        x: Axis::log("views a tick"),
        y: Axis::log("milliseconds"),
        series: lines(rows, here, |r| (r.views as f64, r.tick_ms)),
        rises: true,
        ..Plot::default()
    };
    let parts: [(&str, Part); 5] = [
        ("sampling", |r| r.sampling_ms),
        ("compositing", |r| r.compositing_ms),
        ("GPU to CPU and back", |r| r.gpu_cpu_ms),
        ("relay and network", |r| r.network_ms),
        ("encode", |r| r.encode_ms),
    ];
    let proposed = || rows.iter().filter(|r| r.way == Way::Proposed.name() && r.processes == processes);
    let parts = Plot {
        name: "parts".to_owned(),
        title: format!("What a tick is made of, proposed, {processes} processes (sums over all)"),
        x: Axis::log("views a tick"),
        y: Axis::log("milliseconds"),
        series: parts
            .map(|(name, part)| line(name, proposed().filter_map(|r| Some((r.views as f64, part(r)?)))))
            .into(),
        rises: true,
        ..Plot::default()
    };
    let many = |row: &Row| row.views == u64::from(views);
    let mut series = lines(rows, many, |r| (f64::from(r.processes), r.efficiency));
    let proposed = rows.iter().filter(|r| many(r) && r.way == Way::Proposed.name());
    series.push(line("bound of whole K", proposed.map(|r| (f64::from(r.processes), r.bound))));
    let efficiency = Plot {
        name: "efficiency".to_owned(),
        title: format!("Efficiency at {views} views a tick"),
        x: Axis::linear("processes"),
        y: Axis::linear("efficiency"),
        series,
        ..Plot::default()
    };
    vec![time, parts, efficiency]
}

/// Efficiency against processes, and time against views.
pub(super) fn plots_of_simulated(rows: &[Row]) -> Vec<Plot> {
    let each =
        |row: &Row| row.views == if row.processes <= 11 { 1000 } else { 100 * u64::from(row.processes) };
    let direct_to_clients = |row: &Row| each(row) && (row.processes <= 11 || !row.relayed);
    let mut series = lines(rows, direct_to_clients, |r| (f64::from(r.processes), r.efficiency));
    let proposed = || rows.iter().filter(|r| direct_to_clients(r) && r.way == Way::Proposed.name());
    series.push(line("bound of whole K", proposed().map(|r| (f64::from(r.processes), r.bound))));
    let of_paper = proposed().filter_map(|r| Some((f64::from(r.processes), r.paper_efficiency?)));
    series.push(line("the cluster paper (table 1)", of_paper));
    let efficiency = Plot {
        name: "efficiency".to_owned(),
        title: "Efficiency, simulated".to_owned(),
        x: Axis::log("processes"),
        y: Axis::linear("efficiency"),
        series,
        ..Plot::default()
    };
    let of = |processes| {
        let here = rows.iter().filter(move |r| r.way == Way::Proposed.name() && r.processes == processes);
        line(&format!("{processes} processes"), here.map(|r| (r.views as f64, r.tick_ms)))
    };
    let views = Plot {
        name: "views".to_owned(),
        title: "A tick against views, proposed, simulated".to_owned(),
        x: Axis::log("views a tick"),
        y: Axis::log("milliseconds"),
        series: vec![of(5), of(1024)],
        rises: true,
        ..Plot::default()
    };
    vec![efficiency, views]
}

/// Whether the bars are met.
pub(super) fn notes(rows: &[Row]) -> Vec<String> {
    let mut notes = Vec::new();
    for (processes, way) in
        [11, 1024].into_iter().flat_map(|p| [Way::Proposed, Way::Helping].map(|way| (p, way)))
    {
        let wanted = |row: &&Row| {
            row.processes == processes
                && row.way == way.name()
                && row.views == if processes <= 11 { 1000 } else { 100 * u64::from(processes) }
                && (processes <= 11 || !row.relayed)
        };
        if let Some(row) = rows.iter().find(wanted) {
            let met = if row.per_bound >= 0.95 { "met" } else { "not met" };
            notes.push(format!(
                "P = {processes}, {}: efficiency {:.3}, {:.3} of the bound {:.3} (wanted: 0.95 of it: {met}).",
                row.way, row.efficiency, row.per_bound, row.bound
            ));
        }
    }
    notes
}

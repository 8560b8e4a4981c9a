//! Plots of the cluster study's rows, and what is said beside them.

use super::{AGREEMENT, Row};
use crate::cluster::Way;
use crate::plot::{Axis, Plot, Series};

/// One part of a tick, milliseconds.
type Part = fn(&Row) -> Option<f64>;

fn line(name: &str, points: impl Iterator<Item = (f64, f64)>) -> Series {
    let mut points: Vec<(f64, f64)> = points.collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    Series { name: name.to_owned(), points, line: true }
}

fn lines(rows: &[Row], is: impl Fn(&Row) -> bool, at: impl Fn(&Row) -> Option<(f64, f64)>) -> Vec<Series> {
    let of = |way: Way| rows.iter().filter(move |r| r.way == way.name() && r.trouble.is_none());
    Way::ALL.map(|way| line(way.name(), of(way).filter(|r| is(r)).filter_map(&at))).into()
}

/// Time against views, its parts, and efficiency against processes (figures 5 to 8).
pub(in crate::cluster) fn plots_of_measured(rows: &[Row], processes: u32, views: u32) -> Vec<Plot> {
    let here = |row: &Row| row.processes == processes;
    let time = Plot {
        name: "time".to_owned(),
        title: format!("A tick on {processes} processes"),
        x: Axis::log("views a tick"),
        y: Axis::log("milliseconds"),
        series: lines(rows, here, |r| Some((r.views as f64, r.tick_ms?))),
        rises: true,
        ..Plot::default()
    };
    let parts: [(&str, Part); 10] = [
        ("sampling", |r| r.sampling_ms),
        ("compositing: passes", |r| r.passes_ms),
        ("rays on all cores", |r| r.pooled_ms),
        ("preparing views, recording passes", |r| r.record_ms),
        ("unpacking what was read back", |r| r.unpack_ms),
        ("rest of c: waiting for the device", |r| r.rest_ms),
        ("unpacking samples", |r| r.unpack_samples_ms),
        ("bringing samples to the device", |r| r.hold_samples_ms),
        ("relay and network", |r| r.relay_ms),
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
    let mut series = lines(rows, many, |r| Some((f64::from(r.processes), r.efficiency?)));
    let proposed = rows.iter().filter(|r| many(r) && r.way == Way::Proposed.name());
    series.push(line("bound of whole K", proposed.filter_map(|r| Some((f64::from(r.processes), r.bound?)))));
    let over_alone = rows.iter().filter(|r| many(r) && r.way == Way::Proposed.name());
    let over_alone = over_alone.filter_map(|r| Some((f64::from(r.processes), r.efficiency_over_alone?)));
    series.push(line("proposed, T(1) by P·T(P)", over_alone));
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
pub(in crate::cluster) fn plots_of_simulated(rows: &[Row]) -> Vec<Plot> {
    let each =
        |row: &Row| row.views == if row.processes <= 11 { 1000 } else { 100 * u64::from(row.processes) };
    let most = most_cores(rows);
    let direct_to_clients = |row: &Row| {
        each(row) && row.trouble.is_none() && row.cores == most && (row.processes <= 11 || !row.relayed)
    };
    let mut series = lines(rows, direct_to_clients, |r| Some((f64::from(r.processes), r.efficiency?)));
    let proposed = || rows.iter().filter(|r| direct_to_clients(r) && r.way == Way::Proposed.name());
    series
        .push(line("bound of whole K", proposed().filter_map(|r| Some((f64::from(r.processes), r.bound?)))));
    if rows.iter().any(|row| row.cores != most) {
        let one_core = rows.iter().filter(|r| each(r) && r.way == Way::Proposed.name() && r.cores != most);
        let one_core = one_core.filter_map(|r| Some((f64::from(r.processes), r.efficiency?)));
        series.push(line("proposed, one core a process", one_core));
    }
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
        let ticks = here.filter(|r| r.cores == most).filter_map(|r| Some((r.views as f64, r.tick_ms?)));
        line(&format!("{processes} processes"), ticks)
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

/// Cores of a simulated machine in most rows.
fn most_cores(rows: &[Row]) -> Option<u32> {
    rows.iter().filter_map(|row| row.cores).max()
}

/// What columns mean, and where simulation and measurement differ.
pub(in crate::cluster) fn notes_of_measured(rows: &[Row], processes: u32, views: u32) -> Vec<String> {
    let judged = || rows.iter().filter(|row| row.calibrates == Some(false));
    let apart = judged().filter(|row| row.agreement_fraction > Some(AGREEMENT)).count();
    vec![
        format!(
            "Simulated by what the runs of {processes} processes and {views} views took of cores; rows that calibrate it \
             count for no agreement. Of the {} others, {apart} differ from the measured tick by more than {:.0}%.",
            judged().count(),
            AGREEMENT * 100.0
        ),
        "speedup_by_costs: (S·g + V·c)/T(P), by g and c as they were measured in this very run, that is while all processes \
         ran: where they share cores, both are dearer than alone, and the figure flatters. speedup_over_alone: T(1)/T(P), by \
         the tick of one process that does the same, where that was run. efficiency and efficiency_over_alone: each by P."
            .to_owned(),
        "Parts of a tick, summed over all processes. sampling: samples by g; sampling_rest: the part of it that samples' \
         stages call other (submission, waiting for the device and for planes to be read back). passes: on the device; \
         pooled: rays on the processor, on all of its cores; record: preparing views and recording passes; unpack: putting in \
         place what was read back; rest: what c, or a direct view, takes beyond (submission, waiting for the device and for \
         readback). unpack_samples: of samples that came from others, beside rendering; hold_samples: bringing them to the \
         device. encode: packing frames; relay: from the worker through the coordinator. await_samples and queue: what views \
         waited, many at the same time."
            .to_owned(),
    ]
}

/// Whether the bars are met.
pub(in crate::cluster) fn notes(rows: &[Row]) -> Vec<String> {
    let most = most_cores(rows);
    let mut notes = Vec::new();
    for (processes, way) in
        [11, 1024].into_iter().flat_map(|p| [Way::Proposed, Way::Helping].map(|way| (p, way)))
    {
        let wanted = |row: &&Row| {
            row.processes == processes
                && row.trouble.is_none()
                && row.way == way.name()
                && row.views == if processes <= 11 { 1000 } else { 100 * u64::from(processes) }
                && (processes <= 11 || !row.relayed)
        };
        for row in rows.iter().filter(wanted) {
            let (Some(efficiency), Some(bound), Some(cores)) = (row.efficiency, row.bound, row.cores) else {
                continue;
            };
            let met = if efficiency >= 0.95 * bound { "met" } else { "not met" };
            notes.push(format!(
                "P = {processes}, {}, {cores} core{} each: efficiency {efficiency:.3}, {:.3} of the bound {bound:.3} (wanted: \
                 0.95 of it: {met}).",
                row.way,
                if cores == 1 { "" } else { "s" },
                efficiency / bound
            ));
        }
    }
    if most > Some(1) && rows.iter().any(|row| row.cores == Some(1)) {
        notes.push(
            "Packing, unpacking and sending happen beside rendering: with two cores a process the second does that, and its \
             time counts in no efficiency; with one core it is taken from rendering."
                .to_owned(),
        );
    }
    notes
}

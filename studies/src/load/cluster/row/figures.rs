//! Plots of the cluster study's rows, and the notes beside them.

use super::{AGREEMENT, Row};
use crate::load::cluster::method::Method;
use argus_plot::{Axis, Plot, Series};

/// One part of a tick, in milliseconds.
type Part = fn(&Row) -> Option<f64>;

fn line(name: &str, points: impl Iterator<Item = (f64, f64)>) -> Series {
    let mut points: Vec<(f64, f64)> = points.collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    Series { name: name.to_owned(), points, line: true }
}

fn lines(rows: &[Row], is: impl Fn(&Row) -> bool, at: impl Fn(&Row) -> Option<(f64, f64)>) -> Vec<Series> {
    let of = |method: Method| rows.iter().filter(move |r| r.method == method.name() && r.trouble.is_none());
    Method::ALL.map(|method| line(method.name(), of(method).filter(|r| is(r)).filter_map(&at))).into()
}

/// Time against views, its parts, and efficiency against processes (figures 5 to 8).
pub(in crate::load::cluster) fn plots_of_measured(rows: &[Row], processes: u32, views: u32) -> Vec<Plot> {
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
    let proposed = || rows.iter().filter(|r| r.method == Method::Proposed.name() && r.processes == processes);
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
    let proposed = rows.iter().filter(|r| many(r) && r.method == Method::Proposed.name());
    series.push(line("bound of whole K", proposed.filter_map(|r| Some((f64::from(r.processes), r.bound?)))));
    let over_alone = rows.iter().filter(|r| many(r) && r.method == Method::Proposed.name());
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
pub(in crate::load::cluster) fn plots_of_simulated(rows: &[Row]) -> Vec<Plot> {
    let each =
        |row: &Row| row.views == if row.processes <= 11 { 1000 } else { 100 * u64::from(row.processes) };
    let most = most_cores(rows);
    let direct_to_clients = |row: &Row| {
        each(row) && row.trouble.is_none() && row.cores == most && (row.processes <= 11 || !row.relayed)
    };
    let mut series = lines(rows, direct_to_clients, |r| Some((f64::from(r.processes), r.efficiency?)));
    let proposed = || rows.iter().filter(|r| direct_to_clients(r) && r.method == Method::Proposed.name());
    series
        .push(line("bound of whole K", proposed().filter_map(|r| Some((f64::from(r.processes), r.bound?)))));
    if rows.iter().any(|row| row.cores != most) {
        let one_core =
            rows.iter().filter(|r| each(r) && r.method == Method::Proposed.name() && r.cores != most);
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
        let here =
            rows.iter().filter(move |r| r.method == Method::Proposed.name() && r.processes == processes);
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

/// The most cores of a simulated machine.
fn most_cores(rows: &[Row]) -> Option<u32> {
    rows.iter().filter_map(|row| row.cores).max()
}

/// Notes on the columns, and on the agreement of simulation and measurement.
pub(in crate::load::cluster) fn notes_of_measured(rows: &[Row], processes: u32, views: u32) -> Vec<String> {
    let judged = || rows.iter().filter(|row| row.calibrates == Some(false));
    let apart = judged().filter(|row| row.agreement_fraction > Some(AGREEMENT)).count();
    vec![
        format!(
            "Simulated with the CPU times of the runs with {processes} processes and {views} views. The rows that calibrate \
            the simulation are not judged. Of the {} other rows, {apart} differ from the measured tick by more than {:.0}%.",
            judged().count(),
            AGREEMENT * 100.0
        ),
        "speedup_by_costs: (S·g + V·c)/T(P), with g and c as measured in the same run, while all processes ran. If \
        processes share cores, g and c are higher than alone, and this figure flatters. speedup_over_alone: T(1)/T(P), \
        with the measured tick of one process and the same method. efficiency and efficiency_over_alone: divided by P."
            .to_owned(),
        "Parts of a tick, summed over all processes. sampling: samples times g. sampling_rest: the share of it in the \
        samples' stage other (submission, waiting for the device and for readback). passes: on the device. pooled: CPU \
        rays on all cores. record: preparing views and recording passes. unpack: putting read-back pixels in place. \
        rest: the remainder of c or of a direct view (submission, waiting for the device and for readback). \
        unpack_samples: unpacking samples from other workers, beside rendering. hold_samples: uploading samples to the \
        device. encode: packing frames. relay: from the worker through the coordinator. await_samples and queue: waits \
        of views, which overlap."
            .to_owned(),
    ]
}

/// Whether the simulated efficiencies reach 0.95 of their bound.
pub(in crate::load::cluster) fn notes(rows: &[Row]) -> Vec<String> {
    let most = most_cores(rows);
    let mut notes = Vec::new();
    for (processes, method) in
        [11, 1024].into_iter().flat_map(|p| [Method::Proposed, Method::Helping].map(|method| (p, method)))
    {
        let wanted = |row: &&Row| {
            row.processes == processes
                && row.trouble.is_none()
                && row.method == method.name()
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
                row.method,
                if cores == 1 { "" } else { "s" },
                efficiency / bound
            ));
        }
    }
    if most > Some(1) && rows.iter().any(|row| row.cores == Some(1)) {
        notes.push(
            "Packing, unpacking and sending run beside rendering. With two cores a process, the second core does them and \
            they do not count in efficiency; with one core they take time from rendering."
                .to_owned(),
        );
    }
    notes
}

//! The rows of the service study: what was measured in a phase, and how several runs of it become one row.
//!
//! A further column is a field of [`Measured`] and a line of [`COLUMNS`].

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use super::mode::{Mode, Phase};
use super::predictions::Timed;
use super::regret::Regret;
use super::truth::Errors;
use super::watch::Samples;
use crate::median::{mean, median};
use crate::plot::{Axis, Plot, Series};

/// One phase of one run.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    /// From the start of the first process to the first whole frame, milliseconds; of the cold phase alone. Where no view of
    /// that phase was answered, the frame is one of the load that warms the service up.
    pub(super) first_view_ms: Option<f64>,
    /// Views that fell due.
    pub(super) sent: u64,
    /// Views whose frame came within the deadline.
    pub(super) answered: u64,
    /// Views that the service turned away because of overload.
    pub(super) rejected: u64,
    /// Milliseconds from when each view was due, ascending. A view without a frame counts with its deadline.
    pub(super) latencies_ms: Vec<f64>,
    pub(super) views_per_sec: f64,
    pub(super) errors: Errors,
    /// Mean share of pixels that no sample saw and nothing else served.
    pub(super) unresolved: Option<f64>,
    /// Answered views by the way in which they were made.
    pub(super) ways: BTreeMap<&'static str, u64>,
    /// At the end of the phase.
    pub(super) samples: Samples,
    /// Whether the service had nothing left to do before the phase; `None` of a cold one.
    pub(super) settled: Option<bool>,
    /// How well times were predicted.
    pub(super) timed: Timed,
    /// Microseconds that the coordinator took to choose way and worker, a view; `None` where no view left them open.
    pub(super) planning_us: Option<f64>,
    /// By what probes had the service multiply predicted errors, at the end of the phase.
    pub(super) error_factor: Option<f64>,
    /// Against the best way of each view; of the warm phase by default.
    pub(super) regret: Regret,
    /// Views a second that fell due; of overloads.
    pub(super) offered_per_sec: Option<f64>,
    /// Views a second, as a share of the most that a forced way answers as well; of overloads.
    pub(super) share_of_peak: Option<f64>,
    /// Why the first view failed that did.
    pub(super) first_error: Option<String>,
}

impl Measured {
    /// The latency that this share of the views does not exceed.
    pub(super) fn quantile_ms(&self, share: f64) -> Option<f64> {
        let rank = (share * self.latencies_ms.len() as f64).ceil() as usize;
        self.latencies_ms.get(rank.max(1) - 1).copied()
    }
}

/// One number of a row.
struct Column {
    name: &'static str,
    of: fn(&Measured) -> Option<f64>,
    /// Whether it counts things.
    whole: bool,
    /// Whether the least and the most of several runs are stated.
    spread: bool,
}

const fn count(name: &'static str, of: fn(&Measured) -> Option<f64>) -> Column {
    Column { name, of, whole: true, spread: false }
}

const fn judged(name: &'static str, of: fn(&Measured) -> Option<f64>) -> Column {
    Column { name, of, whole: false, spread: true }
}

const fn beside(name: &'static str, of: fn(&Measured) -> Option<f64>) -> Column {
    Column { name, of, whole: false, spread: false }
}

const COLUMNS: [Column; 27] = [
    judged("first_view_ms", |m| m.first_view_ms),
    count("sent", |m| Some(m.sent as f64)),
    count("answered", |m| Some(m.answered as f64)),
    count("failed", |m| Some((m.sent - m.answered) as f64)),
    count("rejected", |m| Some(m.rejected as f64)),
    judged("p50_ms", |m| m.quantile_ms(0.5)),
    judged("p99_ms", |m| m.quantile_ms(0.99)),
    judged("views_per_sec", |m| Some(m.views_per_sec)),
    count("judged", |m| Some(m.errors.judged as f64)),
    judged("flip", |m| m.errors.flip),
    judged("worst_tile_flip", |m| m.errors.worst_tile),
    judged("excess_flip", |m| m.errors.excess),
    judged("excess_tile", |m| m.errors.excess_tile),
    beside("unresolved", |m| m.unresolved),
    count("samples_rendered", |m| Some(m.samples.rendered as f64)),
    beside("samples_mib", |m| m.samples.mib),
    count("settled", |m| m.settled.map(f64::from)),
    judged("time_predicted", |m| m.timed.share()),
    count("warped_judged", |m| Some(m.errors.warped as f64)),
    judged("error_bounded", |m| m.errors.bounded),
    judged("error_ratio", |m| m.errors.ratio),
    beside("error_factor", |m| m.error_factor),
    count("regret_views", |m| Some(m.regret.views as f64)),
    judged("regret", |m| m.regret.share),
    beside("planning_us", |m| m.planning_us),
    beside("offered_per_sec", |m| m.offered_per_sec),
    judged("share_of_peak", |m| m.share_of_peak),
];

/// The ways in which a view is made, as [`Measured::ways`] names them.
pub(super) const WAYS: [&str; 3] = ["direct", "warp", "warp+trace"];

/// The row of a mode and a phase: of each column the median of the runs that have it.
pub(super) fn row(mode: Mode, phase: Phase, runs: &[&Measured]) -> Map<String, Value> {
    let mut row = Map::new();
    row.insert("mode".to_owned(), mode.name().into());
    row.insert("phase".to_owned(), phase.name().into());
    let mut spread = Map::new();
    for column in &COLUMNS {
        let values: Vec<f64> = runs.iter().filter_map(|measured| (column.of)(measured)).collect();
        let value = if values.is_empty() { Value::Null } else { number(median(&values), column.whole) };
        row.insert(column.name.to_owned(), value);
        if column.spread && values.len() > 1 {
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            spread.insert(column.name.to_owned(), json!([least, most]));
        }
    }
    row.insert("ways".to_owned(), ways(runs));
    row.insert("spread".to_owned(), if spread.is_empty() { Value::Null } else { spread.into() });
    row
}

/// Shares of the answered views, the mean of the runs that answered any; those ways that were taken.
fn ways(runs: &[&Measured]) -> Value {
    let answering: Vec<_> = runs.iter().filter(|measured| measured.answered > 0).collect();
    let share =
        |way: &str| {
            mean(answering.iter().map(|measured| {
                measured.ways.get(way).copied().unwrap_or(0) as f64 / measured.answered as f64
            }))
        };
    let taken = WAYS.iter().map(|way| (*way, share(way))).filter(|(_, share)| *share > 0.0);
    taken.map(|(way, share)| (way.to_owned(), share.into())).collect::<Map<String, Value>>().into()
}

fn number(value: f64, whole: bool) -> Value {
    if whole && value.fract() == 0.0 { (value as u64).into() } else { value.into() }
}

/// Error against latency, a point for each run.
pub(super) fn plot(measured: &[(Mode, Phase, Measured)], scene: &str) -> Plot {
    let series = Mode::ALL.into_iter().flat_map(|mode| Phase::ALL.map(|phase| (mode, phase)));
    let series = series.map(|(mode, phase)| {
        let of = measured.iter().filter(|(m, p, _)| (*m, *p) == (mode, phase));
        let points = of.filter_map(|(.., m)| Some((m.quantile_ms(0.5)?, m.errors.flip?)));
        Series {
            name: format!("{}, {}", mode.name(), phase.name()),
            points: points.collect(),
            ..Series::default()
        }
    });
    Plot {
        name: "error-against-latency".to_owned(),
        title: format!("{scene}: error and latency of a view"),
        x: Axis::log("half of the views came within, milliseconds from when they were due"),
        y: Axis::linear("mean FLIP against 16 samples a pixel"),
        series: series.filter(|series| !series.points.is_empty()).collect(),
        ..Plot::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(latencies_ms: &[f64], answered: u64) -> Measured {
        Measured {
            sent: latencies_ms.len() as u64,
            answered,
            latencies_ms: latencies_ms.to_vec(),
            ..Measured::default()
        }
    }

    #[test]
    fn quantiles_are_those_of_views_that_were_measured() {
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        let of = measured(&hundred, 100);
        assert_eq!((of.quantile_ms(0.5), of.quantile_ms(0.99)), (Some(50.0), Some(99.0)));
        let two = measured(&[1.0, 9.0], 2);
        assert_eq!((two.quantile_ms(0.5), two.quantile_ms(0.99)), (Some(1.0), Some(9.0)));
        assert_eq!(measured(&[], 0).quantile_ms(0.5), None);
    }

    #[test]
    fn one_run_is_its_own_row_without_a_spread() {
        let ways = [("direct", 1), ("warp", 3)].into();
        let run = Measured { ways, rejected: 1, ..measured(&[1.0, 2.0, 3.0, 4.0, 30.0], 4) };
        let row = row(Mode::Default, Phase::Cold, &[&run]);
        assert_eq!((&row["mode"], &row["phase"]), (&json!("default"), &json!("cold")));
        assert_eq!((&row["sent"], &row["failed"], &row["rejected"]), (&json!(5), &json!(1), &json!(1)));
        assert_eq!((&row["p50_ms"], &row["p99_ms"]), (&json!(3.0), &json!(30.0)));
        assert_eq!(row["ways"], json!({"direct": 0.25, "warp": 0.75}));
        assert!(row["spread"].is_null() && row["flip"].is_null() && row["first_view_ms"].is_null());
    }

    #[test]
    fn several_runs_give_medians_with_the_least_and_the_most() {
        let runs = [[5.0; 4], [9.0; 4], [7.0; 4]].map(|latencies| measured(&latencies, 4));
        let row = row(Mode::Warp, Phase::Warm, &[&runs[0], &runs[1], &runs[2]]);
        assert_eq!(row["p50_ms"], json!(7.0));
        assert_eq!(row["spread"]["p50_ms"], json!([5.0, 9.0]));
        assert!(row["spread"].get("flip").is_none(), "nothing was judged: {row:?}");
    }

    #[test]
    fn a_phase_that_answered_nothing_has_a_row_without_numbers_that_are_none() {
        let row = row(Mode::Default, Phase::Warm, &[&Measured::default()]);
        assert!(row.values().all(|value| value.as_f64().is_none_or(f64::is_finite)), "{row:?}");
        assert_eq!((&row["p50_ms"], &row["ways"]), (&Value::Null, &json!({})));
    }

    #[test]
    fn all_rows_have_the_same_columns() {
        let runs = [measured(&[1.0], 1), measured(&[2.0], 1)];
        let [one, two] = [vec![&runs[0]], vec![&runs[0], &runs[1]]]
            .map(|runs| row(Mode::Direct, Phase::Cold, &runs).keys().cloned().collect::<Vec<_>>());
        assert_eq!(one, two);
    }
}

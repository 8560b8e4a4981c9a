//! Rows of the service study: the figures of a phase, and their medians over several runs.
//!
//! A new column is a field of [`Measured`] and a line of [`COLUMNS`].

use std::collections::BTreeMap;

use argus_plot::{Axis, Plot, Series};
use serde_json::{Map, Value, json};

use super::mode::{Mode, Phase};
use super::predictions::Timed;
use super::regret::Regret;
use super::truth::Errors;
use super::watch::Samples;
use crate::median::{mean, median};

/// One phase of one run.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    /// Milliseconds from the start of the first process to the first whole frame; cold phase only. If that phase answered
    /// nothing, the frame is one of the warm-up.
    pub(super) first_view_ms: Option<f64>,
    /// Views that fell due.
    pub(super) sent: u64,
    /// Views whose frame came within the deadline.
    pub(super) answered: u64,
    /// Views rejected because of overload.
    pub(super) rejected: u64,
    /// Latencies in milliseconds from when each view was due, ascending. A failed view counts with its deadline.
    pub(super) latencies_ms: Vec<f64>,
    pub(super) views_per_sec: f64,
    pub(super) errors: Errors,
    /// Mean share of pixels that no sample saw and no ray filled.
    pub(super) unresolved: Option<f64>,
    /// Answered views by [`METHODS`].
    pub(super) methods: BTreeMap<&'static str, u64>,
    /// Samples at the end of the phase.
    pub(super) samples: Samples,
    /// Whether the service was idle before the phase; `None` for the cold phase.
    pub(super) settled: Option<bool>,
    /// How well times were predicted.
    pub(super) timed: Timed,
    /// Microseconds per view in which the coordinator chose method and worker; `None` if every view named its plan.
    pub(super) planning_us: Option<f64>,
    /// Time of open views, if all were from triangles, over that of the views as they were, at the end of the phase.
    pub(super) speed_up: Option<f64>,
    /// Regret against the best method of each view; warm default phase only.
    pub(super) regret: Regret,
    /// Views due per second; overloads only.
    pub(super) offered_per_sec: Option<f64>,
    /// Views per second over the most that a forced method answers as well; overloads only.
    pub(super) share_of_peak: Option<f64>,
    /// The error of the first failed view.
    pub(super) first_error: Option<String>,
}

impl Measured {
    /// The latency that a share of the views (0–1) does not exceed.
    pub(super) fn quantile_ms(&self, share: f64) -> Option<f64> {
        let rank = (share * self.latencies_ms.len() as f64).ceil() as usize;
        self.latencies_ms.get(rank.max(1) - 1).copied()
    }
}

/// One numeric column of a row.
struct Column {
    name: &'static str,
    of: fn(&Measured) -> Option<f64>,
    /// Whether the column is a count.
    whole: bool,
    /// Whether the least and the largest of several runs are shown.
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
    beside("speed_up", |m| m.speed_up),
    count("regret_views", |m| Some(m.regret.views as f64)),
    judged("regret", |m| m.regret.share),
    beside("planning_us", |m| m.planning_us),
    beside("offered_per_sec", |m| m.offered_per_sec),
    judged("share_of_peak", |m| m.share_of_peak),
];

/// How a frame was made: the keys of [`Measured::methods`].
pub(super) const METHODS: [&str; 3] = ["direct", "warp", "warp+trace"];

/// The row of a mode and a phase: each column's median over the runs that have it.
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
    row.insert("ways".to_owned(), methods(runs));
    row.insert("spread".to_owned(), if spread.is_empty() { Value::Null } else { spread.into() });
    row
}

/// Mean shares of answered views by how they were made, without zeros. Runs that answered nothing are left out.
fn methods(runs: &[&Measured]) -> Value {
    let answering: Vec<_> = runs.iter().filter(|measured| measured.answered > 0).collect();
    let share = |method: &str| {
        mean(answering.iter().map(|measured| {
            measured.methods.get(method).copied().unwrap_or(0) as f64 / measured.answered as f64
        }))
    };
    let taken = METHODS.iter().map(|method| (*method, share(method))).filter(|(_, share)| *share > 0.0);
    taken.map(|(method, share)| (method.to_owned(), share.into())).collect::<Map<String, Value>>().into()
}

fn number(value: f64, whole: bool) -> Value {
    if whole && value.fract() == 0.0 { (value as u64).into() } else { value.into() }
}

/// A plot of error against latency, with a point for each run.
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
        x: Axis::log("median latency from when a view was due, milliseconds"),
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
    fn quantiles_are_measured_latencies() {
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        let of = measured(&hundred, 100);
        assert_eq!((of.quantile_ms(0.5), of.quantile_ms(0.99)), (Some(50.0), Some(99.0)));
        let two = measured(&[1.0, 9.0], 2);
        assert_eq!((two.quantile_ms(0.5), two.quantile_ms(0.99)), (Some(1.0), Some(9.0)));
        assert_eq!(measured(&[], 0).quantile_ms(0.5), None);
    }

    #[test]
    fn a_single_run_is_its_own_row_without_a_spread() {
        let methods = [("direct", 1), ("warp", 3)].into();
        let run = Measured { methods, rejected: 1, ..measured(&[1.0, 2.0, 3.0, 4.0, 30.0], 4) };
        let row = row(Mode::Default, Phase::Cold, &[&run]);
        assert_eq!((&row["mode"], &row["phase"]), (&json!("default"), &json!("cold")));
        assert_eq!((&row["sent"], &row["failed"], &row["rejected"]), (&json!(5), &json!(1), &json!(1)));
        assert_eq!((&row["p50_ms"], &row["p99_ms"]), (&json!(3.0), &json!(30.0)));
        assert_eq!(row["ways"], json!({"direct": 0.25, "warp": 0.75}));
        assert!(row["spread"].is_null() && row["flip"].is_null() && row["first_view_ms"].is_null());
    }

    #[test]
    fn several_runs_give_medians_and_their_spread() {
        let runs = [[5.0; 4], [9.0; 4], [7.0; 4]].map(|latencies| measured(&latencies, 4));
        let row = row(Mode::Warp, Phase::Warm, &[&runs[0], &runs[1], &runs[2]]);
        assert_eq!(row["p50_ms"], json!(7.0));
        assert_eq!(row["spread"]["p50_ms"], json!([5.0, 9.0]));
        assert!(row["spread"].get("flip").is_none(), "nothing was judged: {row:?}");
    }

    #[test]
    fn a_phase_without_answers_has_a_row_without_nan() {
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

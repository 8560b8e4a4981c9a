//! The figures of one phase of the demo's crowd.

use std::collections::BTreeMap;
use std::fmt;

use argus_client::ClusterStatus;
use argus_client::load::LoadReport;
use serde::Serialize;

use crate::demo::crowd::Crowd;
use crate::demo::judge::Judged;
use crate::demo::rate::Rate;
use crate::demo::timeline::Timeline;

/// The first second of a phase that counts as settled.
const SETTLED: usize = 5;
/// Excess up to which an answer counts as close: mean FLIP.
const CLOSE: f64 = 0.04;

/// The outcome of one load.
#[derive(Serialize)]
pub(crate) struct Outcome {
    pub(crate) seconds: f64,
    #[serde(flatten)]
    pub(crate) load: LoadReport,
    /// Mean FLIP of the judged views against sixteen samples a pixel.
    pub(crate) flip: f64,
    pub(crate) by_second: Timeline,
    /// Answered views by the reason for their plan.
    reasons: BTreeMap<&'static str, u64>,
}

impl Outcome {
    /// The outcome of a crowd whose views have this mean error.
    pub(crate) fn of(crowd: Crowd, seconds: f64, flip: f64) -> Self {
        let Crowd { report: load, timeline: by_second, reasons, .. } = crowd;
        Self { seconds, load, flip, by_second, reasons }
    }

    /// The reasons for the plans of answered views, the most frequent first, with their shares.
    pub(crate) fn reasons(&self) -> String {
        let answered: u64 = self.reasons.values().sum();
        let mut reasons: Vec<_> = self.reasons.iter().collect();
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let share = |count: u64| 100.0 * count as f64 / answered.max(1) as f64;
        let reasons = reasons.iter().map(|(reason, count)| format!("{reason} {:.0} %", share(**count)));
        reasons.collect::<Vec<_>>().join("; ")
    }
}

/// One phase: a load that the service answers as it decides, and how good its answers were.
#[derive(Serialize)]
pub(crate) struct Phase {
    /// Views a second asked for, over those that the workers carry from triangles.
    times: f64,
    asked_per_sec: f64,
    #[serde(flatten)]
    pub(crate) outcome: Outcome,
    /// Number of judged views.
    judged: usize,
    /// Mean FLIP of the same views from triangles at one sample a pixel.
    pub(crate) flip_direct: f64,
    /// Mean of the judged views' errors beyond those from triangles, in all seconds, before and from the fifth on.
    excess: f64,
    excess_first: Option<f64>,
    excess_settled: Option<f64>,
    /// The greatest of them.
    worst_excess: f64,
    /// Share of all views asked for that were answered with an excess of at most 0.04, as the views chosen to be judged show.
    within_04: f64,
    /// Latency of views due from the fifth second on, milliseconds.
    p50_settled_ms: Option<f64>,
    p99_settled_ms: Option<f64>,
    /// Share of answered views that are warped from sources, and from bought ones.
    from_sources: f64,
    from_bought: f64,
    /// Share of a viewer's consecutive answered views that change between full size, half, quarter and sources.
    changes: f64,
    /// Samples rendered during the phase.
    samples: u64,
    #[serde(skip)]
    pub(crate) rate: Rate,
}

impl Phase {
    /// The figures of a crowd and its judged views.
    pub(crate) fn of(crowd: Crowd, seconds: f64, rate: Rate, judged: &[Judged], samples: u64) -> Self {
        let mean = |of: &dyn Fn(&Judged) -> bool, what: &dyn Fn(&Judged) -> f64| {
            let values: Vec<f64> = judged.iter().filter(|view| of(view)).map(what).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let all = |what: &dyn Fn(&Judged) -> f64| mean(&|_| true, what).unwrap_or_default();
        let settled = |view: &Judged| view.due_secs >= SETTLED as f64;
        let close = judged.iter().filter(|view| view.excess() <= CLOSE).count();
        let (answered, from_sources) = crowd.timeline.sourced();
        let share = |count: u64| count as f64 / answered.max(1) as f64;
        Self {
            times: rate.times(),
            asked_per_sec: rate.asked_per_sec,
            judged: judged.len(),
            flip_direct: all(&|view| view.flip_direct),
            excess: all(&Judged::excess),
            excess_first: mean(&|view| !settled(view), &Judged::excess),
            excess_settled: mean(&settled, &Judged::excess),
            worst_excess: judged.iter().map(Judged::excess).fold(f64::NEG_INFINITY, f64::max),
            within_04: close as f64 / crowd.chosen.max(1) as f64,
            p50_settled_ms: crowd.timeline.latency_from(SETTLED, 0.5),
            p99_settled_ms: crowd.timeline.latency_from(SETTLED, 0.99),
            from_sources: share(from_sources),
            from_bought: share(crowd.bought),
            changes: crowd.changes,
            samples,
            rate,
            outcome: Outcome::of(crowd, seconds, all(&|view| view.flip)),
        }
    }

    /// What the phase shows, in one line.
    pub(crate) fn closing_line(&self) -> String {
        let times = self.outcome.load.views_per_sec / self.rate.carried_per_sec;
        format!(
            "{times:.1} times as many views a second as from triangles, at FLIP {:.3} against {:.3}",
            self.outcome.flip, self.flip_direct
        )
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { outcome, .. } = self;
        let Rate { asked_per_sec, carried_per_sec } = self.rate;
        writeln!(
            f,
            "The crowd asks for {asked_per_sec:.0} views a second for {:.0} s: {:.1} times the {carried_per_sec:.1} that the \
             workers carry from triangles. By the second in which views were due:",
            outcome.seconds, self.times,
        )?;
        write!(f, "{}", outcome.by_second)?;
        writeln!(f, "  why: {}", outcome.reasons())?;
        writeln!(
            f,
            "  {} judged views: excess {:+.4}, worst {:+.3}; {:.0} % of all asked for are answered within {CLOSE}",
            self.judged,
            self.excess,
            self.worst_excess,
            100.0 * self.within_04
        )?;
        writeln!(
            f,
            "  {:.0} % from sources, {:.0} % from bought ones; {} samples rendered; a viewer's view changes its kind {:.1} % of the time",
            100.0 * self.from_sources,
            100.0 * self.from_bought,
            self.samples,
            100.0 * self.changes
        )?;
        Ok(())
    }
}

/// Samples that all workers have rendered so far.
pub(crate) fn samples_rendered(status: &ClusterStatus) -> u64 {
    status.workers.iter().map(|worker| worker.samples_rendered).sum()
}

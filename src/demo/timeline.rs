//! A crowd second by second: latency, error, and how its views were answered.

use std::fmt;
use std::time::Duration;

use argus_scene::Frame;
use serde::{Serialize, Serializer};

use crate::demo::kind::{COLUMNS, KINDS, is_from_sources, kind_of};

/// The views that fell due in one second.
#[derive(Default)]
pub(crate) struct Second {
    pub(crate) refused: u64,
    pub(crate) failed: u64,
    /// Milliseconds from when a view was due to its frame.
    latencies_ms: Vec<f64>,
    /// Answered views of each of [`KINDS`].
    kinds: [u64; KINDS.len()],
    /// Errors of judged views beyond those of the views from triangles: mean FLIP.
    excesses: Vec<f64>,
}

impl Second {
    /// Counts an answered view.
    pub(crate) fn answer(&mut self, latency: Duration, frame: &Frame) {
        self.latencies_ms.push(latency.as_secs_f64() * 1e3);
        self.kinds[kind_of(frame)] += 1;
    }

    /// Adds the error of a judged view beyond that of the view from triangles.
    pub(crate) fn judge(&mut self, excess: f64) {
        self.excesses.push(excess);
    }

    fn answered(&self) -> u64 {
        self.latencies_ms.len() as u64
    }

    /// Views that ended: all that were asked for, but those that a newer one of their session superseded.
    fn asked(&self) -> u64 {
        self.answered() + self.refused + self.failed
    }
}

/// The value that a share of the values (0 to 1) does not exceed; `None` without values.
fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64).ceil() as usize;
    values.get(rank.max(1) - 1).copied()
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// A crowd's seconds, from its first view on.
pub(crate) struct Timeline(Vec<Second>);

impl Timeline {
    /// The timeline of a crowd that asks for so many seconds.
    pub(crate) fn new(seconds: f64) -> Self {
        Self((0..seconds.ceil().max(1.0) as usize).map(|_| Second::default()).collect())
    }

    /// The second in which a view fell due. The last one takes what is due just after it.
    pub(crate) fn second(&mut self, due_secs: f64) -> &mut Second {
        let last = self.0.len() - 1;
        &mut self.0[(due_secs as usize).min(last)]
    }

    /// The points of a quantile (0 to 1): latency in milliseconds at the middle of each second.
    pub(crate) fn latency(&self, share: f64) -> Vec<(f64, f64)> {
        self.points(|second| quantile(second.latencies_ms.clone(), share))
    }

    /// The points of the error: mean excess of the judged views at the middle of each second.
    pub(crate) fn excess(&self) -> Vec<(f64, f64)> {
        self.points(|second| mean(&second.excesses))
    }

    fn points(&self, value: impl Fn(&Second) -> Option<f64>) -> Vec<(f64, f64)> {
        let points = self.0.iter().enumerate();
        points.filter_map(|(i, second)| Some((i as f64 + 0.5, value(second)?))).collect()
    }

    /// The latency in milliseconds that a share (0 to 1) of the views due from a second on does not exceed.
    pub(crate) fn latency_from(&self, second: usize, share: f64) -> Option<f64> {
        let seconds = self.0.iter().skip(second);
        quantile(seconds.flat_map(|second| second.latencies_ms.iter().copied()).collect(), share)
    }

    /// Answered views, and those of them that are warped from sources.
    pub(crate) fn sourced(&self) -> (u64, u64) {
        let answered = self.0.iter().map(Second::answered).sum();
        let kinds = self.0.iter().flat_map(|second| second.kinds.iter().enumerate());
        (answered, kinds.filter(|(kind, _)| is_from_sources(*kind)).map(|(_, count)| count).sum())
    }
}

impl Serialize for Timeline {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Row {
            second: usize,
            asked: u64,
            answered: u64,
            refused: u64,
            failed: u64,
            p50_ms: Option<f64>,
            p99_ms: Option<f64>,
            judged: usize,
            excess: Option<f64>,
            kinds: serde_json::Map<String, serde_json::Value>,
        }
        serializer.collect_seq(self.0.iter().enumerate().map(|(i, second)| Row {
            second: i,
            asked: second.asked(),
            answered: second.answered(),
            refused: second.refused,
            failed: second.failed,
            p50_ms: quantile(second.latencies_ms.clone(), 0.5),
            p99_ms: quantile(second.latencies_ms.clone(), 0.99),
            judged: second.excesses.len(),
            excess: mean(&second.excesses),
            kinds: KINDS.into_iter().map(str::to_owned).zip(second.kinds.map(Into::into)).collect(),
        }))
    }
}

/// A number with so many digits behind the point, or a dash.
fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

impl fmt::Display for Timeline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "  second  asked answered refused failed  p50, ms  p99, ms  excess")?;
        COLUMNS.iter().try_for_each(|(name, _)| write!(f, " {name:>7}"))?;
        writeln!(f)?;
        for (i, second) in self.0.iter().enumerate() {
            let answered = second.answered();
            write!(f, "  {i:>6} {:>6} {answered:>8}", second.asked())?;
            write!(f, " {:>7} {:>6}", second.refused, second.failed)?;
            for share in [0.5, 0.99] {
                write!(f, " {:>8}", number(quantile(second.latencies_ms.clone(), share), 1))?;
            }
            write!(f, " {:>7}", mean(&second.excesses).map_or("-".to_owned(), |e| format!("{e:+.3}")))?;
            for (_, kinds) in &COLUMNS {
                let count: u64 = second.kinds[kinds.clone()].iter().sum();
                let percent = 100.0 * count as f64 / answered.max(1) as f64;
                let shown = if count == 0 { String::new() } else { format!("{percent:.0} %") };
                write!(f, " {shown:>7}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_measured_latencies_and_late_views_belong_to_the_last_second() {
        let mut timeline = Timeline::new(1.5);
        timeline.second(0.9).latencies_ms = vec![30.0, 10.0, 20.0];
        timeline.second(7.0).refused += 1;
        assert_eq!(timeline.0.len(), 2);
        assert_eq!((timeline.latency_from(0, 0.5), timeline.latency_from(0, 0.99)), (Some(20.0), Some(30.0)));
        assert_eq!((timeline.0[1].refused, timeline.latency_from(1, 0.5)), (1, None));
        assert_eq!(timeline.latency(0.5), [(0.5, 20.0)]);
        assert_eq!(timeline.to_string().lines().count(), 3);
    }

    #[test]
    fn the_error_of_a_second_is_the_mean_of_its_judged_views() {
        let mut timeline = Timeline::new(2.0);
        timeline.second(1.2).judge(0.02);
        timeline.second(1.9).judge(-0.01);
        let points = timeline.excess();
        assert_eq!(points.len(), 1);
        assert!((points[0].0 - 1.5).abs() < 1e-12 && (points[0].1 - 0.005).abs() < 1e-12);
    }
}

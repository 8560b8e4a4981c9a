//! A crowd second by second: latency, and how its views were answered.

use std::fmt;
use std::time::Duration;

use argus_plot::Series;
use argus_scene::Frame;
use serde::{Serialize, Serializer};

use crate::demo::kind::{KINDS, kind_of};

/// The views that fell due in one second.
#[derive(Default)]
pub(crate) struct Second {
    pub(crate) refused: u64,
    pub(crate) failed: u64,
    /// Milliseconds from when a view was due to its frame.
    latencies_ms: Vec<f64>,
    /// Answered views of each of [`KINDS`].
    kinds: [u64; KINDS.len()],
}

impl Second {
    /// Counts an answered view.
    pub(crate) fn answer(&mut self, latency: Duration, frame: &Frame) {
        self.latencies_ms.push(latency.as_secs_f64() * 1e3);
        self.kinds[kind_of(frame)] += 1;
    }

    /// The latency that a share of the answered views (0 to 1) does not exceed, milliseconds; `None` without answers.
    fn quantile_ms(&self, share: f64) -> Option<f64> {
        let mut sorted = self.latencies_ms.clone();
        sorted.sort_by(f64::total_cmp);
        let rank = (share * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.max(1) - 1).copied()
    }
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

    /// The curve of a quantile (0 to 1): latency in milliseconds at the middle of each second.
    pub(crate) fn curve(&self, name: &str, share: f64) -> Series {
        let points = self.0.iter().enumerate();
        let points = points.filter_map(|(i, second)| Some((i as f64 + 0.5, second.quantile_ms(share)?)));
        Series { name: name.to_owned(), points: points.collect(), line: true }
    }
}

impl Serialize for Timeline {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Row {
            second: usize,
            answered: u64,
            refused: u64,
            failed: u64,
            p50_ms: Option<f64>,
            p99_ms: Option<f64>,
            kinds: serde_json::Map<String, serde_json::Value>,
        }
        serializer.collect_seq(self.0.iter().enumerate().map(|(i, second)| Row {
            second: i,
            answered: second.latencies_ms.len() as u64,
            refused: second.refused,
            failed: second.failed,
            p50_ms: second.quantile_ms(0.5),
            p99_ms: second.quantile_ms(0.99),
            kinds: KINDS.into_iter().map(str::to_owned).zip(second.kinds.map(Into::into)).collect(),
        }))
    }
}

/// Width of a kind's column in characters.
fn width(kind: &str) -> usize {
    kind.len().max(5) + 1
}

impl fmt::Display for Timeline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "  second answered  refused  p50, ms  p99, ms")?;
        KINDS.iter().try_for_each(|kind| write!(f, " {kind:>w$}", w = width(kind)))?;
        writeln!(f)?;
        for (i, second) in self.0.iter().enumerate() {
            let answered = second.latencies_ms.len();
            write!(f, "  {i:>6} {answered:>8} {:>8}", second.refused)?;
            for share in [0.5, 0.99] {
                let ms = second.quantile_ms(share).map(|ms| format!("{ms:.1}"));
                write!(f, " {:>8}", ms.as_deref().unwrap_or("-"))?;
            }
            for (kind, count) in KINDS.iter().zip(second.kinds) {
                let percent = 100.0 * count as f64 / answered.max(1) as f64;
                let shown = if count == 0 { String::new() } else { format!("{percent:.0} %") };
                write!(f, " {shown:>w$}", w = width(kind))?;
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
        assert_eq!(
            (timeline.0[0].quantile_ms(0.5), timeline.0[0].quantile_ms(0.99)),
            (Some(20.0), Some(30.0))
        );
        assert_eq!((timeline.0[1].refused, timeline.0[1].quantile_ms(0.5)), (1, None));
        assert_eq!(timeline.curve("p50", 0.5).points, [(0.5, 20.0)]);
        assert_eq!(timeline.to_string().lines().count(), 3);
    }
}

//! The demo's figures, as a table and as JSON.

use std::collections::BTreeMap;
use std::fmt;

use argus_client::load::LoadReport;
use serde::Serialize;

use crate::demo::crowd::Crowd;
use crate::demo::rate::Rate;
use crate::demo::timeline::Timeline;

/// The demo's figures.
#[derive(Serialize)]
pub(crate) struct Figures {
    pub(crate) scene: String,
    pub(crate) workers: usize,
    pub(crate) viewers: u16,
    /// Width and height of a view in pixels.
    pub(crate) size: [u32; 2],
    #[serde(flatten)]
    pub(crate) rate: Rate,
    pub(crate) default: Outcome,
    pub(crate) direct: Outcome,
    /// Samples rendered during both loads.
    pub(crate) samples: u64,
    /// g of the cluster paper: cost of one sample, milliseconds; 0: none was rendered.
    pub(crate) sample_ms: f64,
    /// c of the cluster paper: cost of one view from samples, milliseconds; 0: there was none.
    pub(crate) view_ms: f64,
    /// Path of the contact sheet.
    pub(crate) sheet: String,
}

/// The outcome of one load.
#[derive(Serialize)]
pub(crate) struct Outcome {
    seconds: f64,
    #[serde(flatten)]
    load: LoadReport,
    /// Mean FLIP of the judged views against sixteen samples a pixel.
    flip: f64,
    by_second: Timeline,
    /// Answered views by the reason for their plan.
    reasons: BTreeMap<&'static str, u64>,
}

impl Outcome {
    /// The outcome of a crowd, with the error of each judged view.
    pub(crate) fn of(crowd: Crowd, seconds: f64, flips: impl ExactSizeIterator<Item = f64>) -> Self {
        let Crowd { report: load, timeline: by_second, reasons, .. } = crowd;
        let count = flips.len() as f64;
        Self { seconds, load, flip: flips.sum::<f64>() / count, by_second, reasons }
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, workers, viewers, size: [width, height], rate, default, direct, .. } = self;
        writeln!(f, "{scene}: {viewers} viewers of {width}x{height}, {workers} workers")?;
        writeln!(
            f,
            "The crowd asks for {:.0} views a second: {:.1} times the {:.0} that the workers carry from triangles.",
            rate.asked_per_sec,
            rate.times(),
            rate.carried_per_sec
        )?;
        writeln!(
            f,
            "\nBy default, for {:.0} s, by the second in which views were due; all from triangles but the last two kinds:",
            default.seconds
        )?;
        write!(f, "{}", default.by_second)?;
        let answered: u64 = default.reasons.values().sum();
        let mut reasons: Vec<_> = default.reasons.iter().collect();
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let share = |count: u64| 100.0 * count as f64 / answered.max(1) as f64;
        let reasons = reasons.iter().map(|(reason, count)| format!("{reason} {:.0} %", share(**count)));
        writeln!(f, "  why: {}", reasons.collect::<Vec<_>>().join("; "))?;

        let [a, b] = [default, direct].map(|outcome| &outcome.load);
        let mut row = |name: &str, a: String, b: String| writeln!(f, "  {name:<24} {a:>12} {b:>16}");
        row("", "by default".to_owned(), "from triangles".to_owned())?;
        row("seconds", format!("{:.1}", default.seconds), format!("{:.1}", direct.seconds))?;
        row("views asked for", a.sent.to_string(), b.sent.to_string())?;
        row("  refused: overload", a.rejected.to_string(), b.rejected.to_string())?;
        row("  failed", a.failed.to_string(), b.failed.to_string())?;
        row("  answered a second", format!("{:.1}", a.views_per_sec), format!("{:.1}", b.views_per_sec))?;
        row("latency p50, ms", format!("{:.1}", a.latency_ms.p50), format!("{:.1}", b.latency_ms.p50))?;
        row("latency p99, ms", format!("{:.1}", a.latency_ms.p99), format!("{:.1}", b.latency_ms.p99))?;
        row("mean FLIP to reference", format!("{:.4}", default.flip), format!("{:.4}", direct.flip))?;
        for (name, load) in [("by default", a), ("from triangles", b)] {
            if let Some(error) = &load.first_error {
                writeln!(f, "  first view without a frame, {name}: {error}")?;
            }
        }
        let Self { samples, sample_ms, view_ms, .. } = self;
        writeln!(
            f,
            "  {samples} samples were rendered, at {sample_ms:.1} ms; a view from samples costs {view_ms:.1} ms"
        )
    }
}

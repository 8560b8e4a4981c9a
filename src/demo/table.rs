//! The demo's figures, as a table and as JSON.

use std::fmt;

use argus_client::load::WalkKind;
use serde::Serialize;

use crate::demo::phase::{Outcome, Phase};
use crate::demo::rate::Rate;

/// The demo's figures.
#[derive(Serialize)]
pub(crate) struct Figures {
    pub(crate) scene: String,
    pub(crate) walk: WalkKind,
    pub(crate) workers: usize,
    pub(crate) viewers: u16,
    /// Width and height of a view in pixels.
    pub(crate) size: [u32; 2],
    /// Of the first phase.
    #[serde(flatten)]
    pub(crate) rate: Rate,
    /// The first phase.
    pub(crate) default: Phase,
    /// The load of the first phase with all views from triangles; `None` if it was left out.
    pub(crate) direct: Option<Outcome>,
    /// The phases after the first.
    pub(crate) more: Vec<Phase>,
    /// Samples rendered during all loads.
    pub(crate) samples: u64,
    /// g of the cluster paper: cost of one sample, milliseconds; 0: none was rendered.
    pub(crate) sample_ms: f64,
    /// c of the cluster paper: cost of one view from samples, milliseconds; 0: there was none.
    pub(crate) view_ms: f64,
    /// Path of the contact sheet.
    pub(crate) sheet: String,
}

impl Figures {
    /// All phases, in order.
    pub(crate) fn phases(&self) -> impl Iterator<Item = &Phase> {
        std::iter::once(&self.default).chain(&self.more)
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, walk, workers, viewers, size: [width, height], .. } = self;
        writeln!(f, "{scene}: {viewers} viewers of {width}x{height}, walk {walk}, {workers} workers\n")?;
        self.phases().try_for_each(|phase| writeln!(f, "{phase}"))?;
        let outcomes: Vec<(String, &Outcome)> = self
            .phases()
            .map(|phase| (format!("{:.1} times", phase.rate.times()), &phase.outcome))
            .chain(self.direct.as_ref().map(|direct| ("all from triangles".to_owned(), direct)))
            .collect();
        write!(f, "  {:<24}", "")?;
        outcomes.iter().try_for_each(|(name, _)| write!(f, " {name:>18}"))?;
        writeln!(f)?;
        let mut row = |name: &str, of: &dyn Fn(&Outcome) -> String| {
            write!(f, "  {name:<24}")?;
            outcomes.iter().try_for_each(|(_, outcome)| write!(f, " {:>18}", of(outcome)))?;
            writeln!(f)
        };
        row("seconds", &|outcome| format!("{:.1}", outcome.seconds))?;
        row("views asked for", &|outcome| outcome.load.sent.to_string())?;
        row("  refused: overload", &|outcome| outcome.load.rejected.to_string())?;
        row("  failed", &|outcome| outcome.load.failed.to_string())?;
        row("  answered a second", &|outcome| format!("{:.1}", outcome.load.views_per_sec))?;
        row("latency p50, ms", &|outcome| format!("{:.1}", outcome.load.latency_ms.p50))?;
        row("latency p99, ms", &|outcome| format!("{:.1}", outcome.load.latency_ms.p99))?;
        row("mean FLIP to reference", &|outcome| format!("{:.4}", outcome.flip))?;
        for (name, outcome) in &outcomes {
            if let Some(error) = &outcome.load.first_error {
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

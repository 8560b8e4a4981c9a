//! The cost of the demo's views, from samples and from triangles.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use argus_scene::{Plan, SampleId};
use serde::Serialize;

use crate::demo::Round;
use crate::demo::judge::Judged;

/// The demo's figures.
#[derive(Serialize)]
pub(crate) struct Figures {
    pub(crate) scene: String,
    workers: usize,
    views: usize,
    /// S: number of samples used.
    samples: usize,
    /// g of the cluster paper: cost of one sample.
    sample_ms: f64,
    /// S·g: cost of all samples.
    samples_ms: f64,
    /// Cost of one view from triangles.
    direct_ms: f64,
    /// c of the cluster paper: cost of one view from samples.
    view_ms: f64,
    /// c over the cost of a view from triangles.
    view_per_direct: f64,
    /// Time of all views from samples, including the samples.
    total_ms: f64,
    /// Time of the same views with the samples already rendered: the median of a few rounds.
    steady_ms: f64,
    /// Time of all views from triangles.
    naive_ms: f64,
    flip: Spread,
    flip_direct: Spread,
    unresolved_fraction: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    sheet: Option<String>,
}

#[derive(Serialize)]
struct Spread {
    mean: f64,
    median: f64,
    max: f64,
}

impl Spread {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        let median = match values.len() {
            0 => f64::NAN,
            n if n % 2 == 1 => values[middle],
            _ => (values[middle - 1] + values[middle]) / 2.0,
        };
        Self {
            mean: values.iter().sum::<f64>() / values.len() as f64,
            median,
            max: values.last().copied().unwrap_or(f64::NAN),
        }
    }
}

impl Figures {
    /// The figures of a demo. `warped` started without samples; the `steady` rounds followed.
    pub(crate) fn of(
        scene: &str,
        workers: usize,
        warped: &Round,
        steady: &[Round],
        naive: &Round,
        judged: &[Judged],
    ) -> Self {
        let samples: BTreeSet<SampleId> = warped
            .answers
            .iter()
            .flat_map(|answer| match &answer.frame.provenance.plan {
                Plan::Warp(warp) => warp.samples.clone(),
                Plan::Direct { .. } => Vec::new(),
            })
            .collect();
        let sample_ms = warped.status.sample_ms;
        // The cluster's costs are running means. The last one hardly includes the first views.
        let view_ms = steady.last().unwrap_or(warped).status.view_ms;
        let steady_ms = Spread::of(steady.iter().map(|round| round.total.as_secs_f64() * 1e3)).median;
        let naive_ms = naive.total.as_secs_f64() * 1e3;
        // For few views the cluster has no mean, since it leaves out views during compilation. Then the wall time is
        // used, as if all workers had been busy throughout.
        let by_the_clock = naive_ms * workers as f64 / judged.len().max(1) as f64;
        let known = naive.status.direct_ms > 0.0;
        let direct_ms = if known { naive.status.direct_ms } else { by_the_clock };
        Self {
            scene: scene.to_owned(),
            workers,
            views: judged.len(),
            samples: samples.len(),
            sample_ms,
            samples_ms: samples.len() as f64 * sample_ms,
            direct_ms,
            view_ms,
            view_per_direct: view_ms / direct_ms,
            total_ms: warped.total.as_secs_f64() * 1e3,
            steady_ms,
            naive_ms,
            flip: Spread::of(judged.iter().map(|view| view.flip)),
            flip_direct: Spread::of(judged.iter().map(|view| view.flip_direct)),
            unresolved_fraction: judged.iter().map(|view| view.unresolved_fraction).sum::<f64>()
                / judged.len() as f64,
            sheet: None,
        }
    }

    pub(crate) fn with_sheet(self, sheet: &Path) -> Self {
        Self { sheet: Some(sheet.display().to_string()), ..self }
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let spread = |s: &Spread| format!("mean {:.4}  median {:.4}  max {:.4}", s.mean, s.median, s.max);
        writeln!(f, "{}: {} views, {} workers", self.scene, self.views, self.workers)?;
        writeln!(f, "  a view from triangles            {:9.2} ms", self.direct_ms)?;
        writeln!(f, "  a view from samples          c   {:9.2} ms", self.view_ms)?;
        writeln!(f, "    of a view from triangles       {:9.3}", self.view_per_direct)?;
        writeln!(f, "  a sample                     g   {:9.2} ms", self.sample_ms)?;
        writeln!(f, "  {:<3} samples, once          S·g   {:9.2} ms", self.samples, self.samples_ms)?;
        writeln!(f, "  all views, samples included      {:9.1} ms", self.total_ms)?;
        writeln!(f, "  all views, samples at hand       {:9.1} ms", self.steady_ms)?;
        writeln!(f, "  all views from triangles         {:9.1} ms", self.naive_ms)?;
        writeln!(f, "  FLIP from samples                {}", spread(&self.flip))?;
        writeln!(f, "  FLIP from triangles, 1 a pixel   {}", spread(&self.flip_direct))?;
        writeln!(f, "  pixels that no sample saw        {:8.3} %", self.unresolved_fraction * 100.0)
    }
}

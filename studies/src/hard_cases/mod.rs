//! The conformance suite: what makes a reconstruction go wrong, case by case, against the f64 ray tracer.
//!
//! Every case is a small scene built in code, sampled by the sampler, a view of it, and what the view may get
//! wrong. Each search composes it by both of its programs, whose bytes must be equal. A pixel is *wrong* if it
//! claims to be resolved and shows neither the surface (range within [`oracle::RANGE`]) nor the place on it
//! (colour within [`oracle::COLOR`] steps) that its own ray or one of the eight around it meets. What no sample
//! saw must be said to be unresolved: that is never wrong, but it is bounded too.
//!
//! The command that prints the table, the page in `docs/` and the test all run the same cases, so that none of
//! them can say what another does not.

mod omni;
mod oracle;
mod page;
mod poses;
mod precision;
mod rays;
mod sizes;
mod stage;
mod surfaces;
mod world;

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use indicatif::ProgressBar;
use serde::Serialize;
use serde_json::Value;

use crate::{Machine, Report, report};
pub use page::{claims, page};
pub use stage::Stages;

/// What cases have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Theme {
    /// Where the viewer stands.
    Poses,
    /// Rays that run along what a search is made of.
    Rays,
    /// What there is to see.
    Surfaces,
    /// Images of uncommon shape.
    Sizes,
    /// Scenes far from zero, very small and very large.
    Precision,
    /// Seams, poles and rims of samples that look everywhere.
    Omni,
}

impl Theme {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 6] =
        [Self::Poses, Self::Rays, Self::Surfaces, Self::Sizes, Self::Precision, Self::Omni];

    /// Runs its cases.
    ///
    /// # Errors
    /// No GPU, or a render that fails; a frame that is wrong is a row that did not pass.
    pub fn run(self, stages: &mut Stages) -> Result<Vec<Row>> {
        let rows = match self {
            Self::Poses => poses::run(stages),
            Self::Rays => rays::run(stages),
            Self::Surfaces => surfaces::run(stages),
            Self::Sizes => sizes::run(stages),
            Self::Precision => precision::run(stages),
            Self::Omni => omni::run(stages),
        }?;
        Ok(rows.into_iter().map(|row| Row { theme: Some(self), ..row }).collect())
    }
}

/// One case by one search.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What it belongs to.
    pub theme: Option<Theme>,
    /// Its name.
    pub case: String,
    /// By which search.
    pub search: &'static str,
    /// What the error is a share or a number of.
    pub measure: &'static str,
    /// How far from the oracle it is.
    pub oracle_error: f64,
    /// How far it may be.
    pub tolerance: f64,
    /// Share of pixels that no sample saw.
    pub unresolved: f64,
    /// The greatest share that may be.
    pub unresolved_tolerance: f64,
    /// Pixels that contradict themselves; none may.
    pub malformed: usize,
    /// Bytes in which the search's two programs differ; none may.
    pub twin_bytes: usize,
    /// Milliseconds of the slower program, less than [`MOST_MS`].
    pub ms: f64,
    /// Why the limits are wide, or not those of the other searches; mostly empty.
    pub why: &'static str,
    /// Whether it is within all of these.
    pub passed: bool,
}

/// No case may take longer, whatever its rays run along: a loop that does not end would.
pub const MOST_MS: f64 = 20_000.0;

impl Row {
    /// Says whether it passed. Written so that a NaN did not.
    fn judged(self) -> Self {
        let within = self.oracle_error <= self.tolerance && self.unresolved <= self.unresolved_tolerance;
        let passed = within && self.malformed == 0 && self.twin_bytes == 0 && self.ms < MOST_MS;
        Self { passed, ..self }
    }
}

/// Runs all cases; `progress` counts themes.
///
/// # Errors
/// As [`Theme::run`].
pub fn run(progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let mut stages = Stages::new(&gpu)?;
    progress.set_length(Theme::ALL.len() as u64);
    let mut rows = Vec::new();
    for theme in Theme::ALL {
        progress.set_message(format!("{theme:?}"));
        rows.extend(theme.run(&mut stages)?);
        progress.inc(1);
    }
    let failed = rows.iter().filter(|row| !row.passed).count();
    let as_object = |row: &Row| report::row(serde_json::to_value(row).unwrap_or(Value::Null));
    let machine = Machine::here(gpu.kind());
    let mut report = Report::new("scenes built in code", machine, rows.iter().map(as_object).collect());
    report.notes = stages.notes();
    report.notes.push(match failed {
        0 => format!("All {} passed.", rows.len()),
        _ => format!("{failed} of {} did not pass.", rows.len()),
    });
    Ok(report)
}

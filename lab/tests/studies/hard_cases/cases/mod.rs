//! Hard cases: the conformance suite of image reconstruction, judged by the f64 ray tracer.
//!
//! Every case is a small scene built in code, a view of it, and limits on the view's error. Each search composes it with
//! both of its programs, whose bytes must be equal. A pixel is *wrong* if it claims to be resolved but shows neither the
//! surface (range within [`oracle::RANGE`]) nor the position on it (colour within [`oracle::COLOR`] steps) that its own
//! ray or one of the eight around it meets. A pixel that no sample saw must be marked unresolved; that is never wrong,
//! but its share is limited too. A case whose limit accepts more than a quarter of all pixels as wrong can hardly fail,
//! so it never counts as passed: it is a *known failure*.
//!
//! The tests and the page in `docs/` run the same cases.

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

pub(super) use self::page::{claims, page};
pub(super) use self::stage::Stages;

/// What the cases of a group have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Theme {
    /// Positions of the viewer.
    Poses,
    /// Rays along the planes and borders of a search's data structures.
    Rays,
    /// Difficult surfaces.
    Surfaces,
    /// Images of unusual shape.
    Sizes,
    /// Scenes far from the origin, very small and very large.
    Precision,
    /// Seams, poles and rims of omnidirectional samples.
    Omni,
}

impl Theme {
    /// All themes, in the order of the table.
    pub(super) const ALL: [Self; 6] =
        [Self::Poses, Self::Rays, Self::Surfaces, Self::Sizes, Self::Precision, Self::Omni];

    /// Runs the theme's cases.
    ///
    /// # Errors
    /// No GPU, or a render that fails. A wrong frame is not an error, but a row that failed.
    pub(super) fn run(self, stages: &mut Stages) -> Result<Vec<Row>> {
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

/// The result of one case with one search.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    /// The case's theme.
    pub(super) theme: Option<Theme>,
    /// The case's name.
    pub(super) case: String,
    /// The search's name.
    pub(super) search: &'static str,
    /// What `oracle_error` counts.
    pub(super) measure: &'static str,
    /// The error against the oracle.
    pub(super) oracle_error: f64,
    /// The largest accepted error.
    pub(super) tolerance: f64,
    /// Share of pixels that no sample saw.
    pub(super) unresolved: f64,
    /// The largest accepted share of unresolved pixels.
    pub(super) unresolved_tolerance: f64,
    /// Pixels whose outputs contradict each other; must be 0.
    pub(super) malformed: usize,
    /// Bytes that differ between the search's two programs; must be 0.
    pub(super) twin_bytes: usize,
    /// Milliseconds of the slower program; must be below [`MOST_MS`].
    pub(super) ms: f64,
    /// Why the limits are wide or differ from other searches; usually empty.
    pub(super) why: &'static str,
    /// Whether the limits are kept, and whether that says anything.
    pub(super) outcome: Outcome,
}

/// The outcome of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Outcome {
    /// All limits are kept.
    Passed,
    /// All limits are kept, but the one on wrong pixels is above [`KNOWN_FAILURE`].
    KnownFailure,
    /// A limit is exceeded.
    #[default]
    Failed,
}

impl Outcome {
    /// All outcomes.
    pub(super) const ALL: [Self; 3] = [Self::Passed, Self::KnownFailure, Self::Failed];

    /// The outcome in words.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::KnownFailure => "known failure",
            Self::Failed => "failed",
        }
    }
}

/// A case that accepts a larger share of wrong pixels than this is a known failure.
pub(super) const KNOWN_FAILURE: f64 = 0.25;

/// Time limit of a case in milliseconds. Only a loop that does not end exceeds it.
pub(super) const MOST_MS: f64 = 20_000.0;

impl Row {
    /// Sets `outcome`. NaN fails.
    fn judged(self) -> Self {
        let within = self.oracle_error <= self.tolerance && self.unresolved <= self.unresolved_tolerance;
        let kept = within && self.malformed == 0 && self.twin_bytes == 0 && self.ms < MOST_MS;
        let outcome = match kept {
            true if self.tolerance <= KNOWN_FAILURE => Outcome::Passed,
            true => Outcome::KnownFailure,
            false => Outcome::Failed,
        };
        Self { outcome, ..self }
    }
}

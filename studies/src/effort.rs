//! How much a study measures: its default options, or the smallest that run all of it.

/// Options of a study.
pub trait Effort: Default {
    /// Options that take a few seconds and show that everything works; the figures are noise. The default takes minutes.
    fn quick() -> Self;

    /// The quick or the default options.
    fn of(quick: bool) -> Self {
        if quick { Self::quick() } else { Self::default() }
    }
}

//! How much a study measures: its options by default, or the least that runs all of it.

/// Options of a study.
pub trait Effort: Default {
    /// A few seconds, to see that everything works; the figures are noise. The default takes minutes.
    fn quick() -> Self;

    /// One or the other.
    fn of(quick: bool) -> Self {
        if quick { Self::quick() } else { Self::default() }
    }
}

//! Ways to answer a view.

use argus_scene::Detail;

/// A way to answer a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum OfferKind {
    /// From triangles, in some detail.
    Direct(Detail),
    /// Warped from sources; pixels that none sees are guessed.
    Guessed,
    /// Warped from sources; pixels that none sees are traced.
    Traced,
}

impl OfferKind {
    /// Whether it is warped from sources.
    pub fn is_warped(self) -> bool {
        matches!(self, Self::Guessed | Self::Traced)
    }
}

//! What finding cuts may be told.

use crate::hierarchy::HierarchyError;
use crate::many_views::{Knobs, Texel};

/// How cuts are found (ManyLoDs, sections 3.1 to 3.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CutMethod {
    /// From the root, every frame.
    Basic,
    /// From the last frame's cuts, whose nodes are divided and merged until the cuts are those of the basic method.
    Incremental,
    /// Incremental, but a node is followed down by at most `edges` edges a frame, and cuts may lag behind by
    /// [`CutKnobs::lag`] while views move; once they stand still, cuts come to be those of the basic method. Merges are
    /// followed to their end: nodes that rise part of the way would leave some of a view's scene in its cut twice.
    Lazy {
        /// 1 or more.
        edges: u32,
    },
}

impl CutMethod {
    /// As tables have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Basic => "basic",
            Self::Incremental => "incremental",
            Self::Lazy { .. } => "lazy",
        }
    }
}

/// What finding cuts may be told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutKnobs {
    /// How cuts are found.
    pub method: CutMethod,
    /// Texels of a hemisphere's side: 8 to 1024.
    pub side: u32,
    /// What a texel holds.
    pub texel: Texel,
    /// How large a node may appear and still be in a cut, texels: 1 to a quarter of `side`, at most 8.
    pub threshold: f32,
    /// The disc by which a node of an octree covers texels' sample points: as [`Knobs::disc`].
    pub disc: f32,
    /// Whether nodes that a view does not see are left as large as they are.
    pub culling: bool,
    /// Share of the root's edge: a view that moves by more starts over from the root.
    pub jump: f64,
    /// Share of the root's edge by which views may move on before a lazy cut's node is looked at again; 0 to 0.25.
    pub lag: f64,
    /// Most nodes in the cuts of all views; `None`: as many as turn out to be needed and fit.
    pub entries: Option<u32>,
}

impl Default for CutKnobs {
    fn default() -> Self {
        Self {
            method: CutMethod::Incremental,
            side: 16,
            texel: Texel::Range,
            threshold: 1.0,
            disc: Knobs::DISC,
            culling: true,
            jump: 1.0 / 32.0,
            lag: 0.005,
            entries: None,
        }
    }
}

impl CutKnobs {
    /// Rejects what cannot be, by field.
    ///
    /// # Errors
    /// [`HierarchyError::OutOfRange`].
    pub fn validate(&self) -> Result<(), HierarchyError> {
        let check = |field, holds: bool, range: &str, value: String| match holds {
            true => Ok(()),
            false => Err(HierarchyError::OutOfRange { field, range: range.to_owned(), value }),
        };
        check("resolution", (8..=1024).contains(&self.side), "8 to 1024 texels", self.side.to_string())?;
        check("disc", self.disc > 0.0 && self.disc <= 1.0, "above 0 and at most 1", self.disc.to_string())?;
        // What a verdict is worth by distance and by radius holds for these alone.
        let most = (self.side as f32 / 4.0).min(8.0);
        let threshold = self.threshold >= 1.0 && self.threshold <= most;
        check("threshold", threshold, &format!("1 to {most} texels"), self.threshold.to_string())?;
        let edges = !matches!(self.method, CutMethod::Lazy { edges: 0 });
        check("edges", edges, "at least 1", "0".to_owned())?;
        check("jump", self.jump > 0.0 && self.jump <= 1.0, "above 0 and at most 1", self.jump.to_string())?;
        check("lag", (0.0..=0.25).contains(&self.lag), "0 to 0.25", self.lag.to_string())?;
        let entries = self.entries.is_none_or(|n| n >= 64);
        check("entries", entries, "at least 64", format!("{:?}", self.entries))
    }
}

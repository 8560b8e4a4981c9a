//! Settings of cuts.

use argus_megaviews::hierarchy::HierarchyError;
use argus_megaviews::many_views::{Settings, Texel};

/// Method of finding cuts (ManyLoDs, sections 3.1 to 3.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CutMethod {
    /// From the root, every frame.
    Basic,
    /// From the last frame's cuts, whose nodes are divided and merged until the cuts are those of the basic method.
    Incremental,
    /// Incremental, but a node is followed down by at most `edges` edges a frame, and cuts may lag behind by
    /// [`CutSettings::lag`] while views move; once they stand still, cuts come to be those of the basic method. Merges are
    /// followed to their end: nodes that rise part of the way would leave some of a view's scene in its cut twice.
    Lazy {
        /// 1 or more.
        edges: u32,
    },
}

impl CutMethod {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Basic => "basic",
            Self::Incremental => "incremental",
            Self::Lazy { .. } => "lazy",
        }
    }
}

/// Settings of cuts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutSettings {
    /// Method of finding cuts.
    pub method: CutMethod,
    /// Texels on a side of a hemisphere: 8 to 1024.
    pub side: u32,
    /// Format of texels.
    pub texel: Texel,
    /// Largest apparent size of a node of a cut, texels: 1 to a quarter of `side`, at most 8.
    pub threshold: f32,
    /// Radius of the disc by which a node covers sample points; see [`Settings::disc`].
    pub disc: f32,
    /// Whether nodes outside a view are not divided.
    pub culling: bool,
    /// A view that moves by more than this share of the root's edge restarts from the root.
    pub jump: f64,
    /// Motion before a node of a lazy cut is tested again, as a share of the root's edge, 0 to 0.25.
    pub lag: f64,
    /// Most nodes in the cuts of all views; `None` for as many as are needed and fit.
    pub entries: Option<u32>,
}

impl Default for CutSettings {
    fn default() -> Self {
        Self {
            method: CutMethod::Incremental,
            side: 16,
            texel: Texel::Range,
            threshold: 1.0,
            disc: Settings::DISC,
            culling: true,
            jump: 1.0 / 32.0,
            lag: 0.005,
            entries: None,
        }
    }
}

impl CutSettings {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`HierarchyError::OutOfRange`] with the field.
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

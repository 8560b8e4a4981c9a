//! Settings of traversals.

use super::Texel;
use crate::hierarchy::{HierarchyError, MAX_DEPTH};

/// Occlusion culling of pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Occlusion {
    /// No occlusion culling.
    Off,
    /// Pairs are traversed in shells, near ones first, and culled where a map already has nearer texels. Conservative:
    /// maps have the same bytes. Counts may vary between runs.
    Shells,
    /// Pairs are culled against the last frame's maps, which are kept. Measures the upper bound of culling for static
    /// scenes; wrong if anything moves.
    Known,
}

impl Occlusion {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Off, Self::Shells, Self::Known];

    /// Name in options and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Shells => "on",
            Self::Known => "known",
        }
    }
}

/// Bounding volume of the views of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Bounding {
    /// The sphere around the cell, as in the paper.
    Cell,
    /// A sphere around the views, if it is smaller.
    Tight,
}

/// What a traversal may be told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Texels on a side of a hemisphere: 8 to 1024.
    pub side: u32,
    /// Format of texels.
    pub texel: Texel,
    /// Largest apparent size of a node that is rendered, texels: 1 to 8.
    pub threshold: f32,
    /// Radius of the disc by which a rendered node covers sample points, in radii of its cell's sphere.
    /// [`Settings::COVERING`] leaves no gaps, as images need. Smaller discs cause fewer false shadows but leak light.
    pub disc: f32,
    /// Radius of the disc of nodes that several views share.
    pub shared_disc: f32,
    /// Whether views share nodes that look alike from all of them (MegaViews); otherwise each view is traversed alone
    /// (ManyLoDs).
    pub sharing: bool,
    /// Whether the scene's octree is traversed too. Otherwise each leaf descends the view octree alone: a baseline that
    /// measures the gain of the scene's hierarchy. Requires sharing without fallback.
    pub scene_hierarchy: bool,
    /// Whether views are traversed alone after a frame in which a rendered pair was shared by fewer than
    /// [`Settings::WORTH_SHARING`] views on average.
    pub falls_back: bool,
    /// Levels of the view octree that divide cells, 1 to [`MAX_DEPTH`]. `None` computes them from the views' positions
    /// (`view_depth.rs`).
    pub view_depth: Option<u32>,
    /// Whether a last level divides the views of a cell by the axis nearest to their direction. Then views on both sides
    /// of a wall share no map, whose centre would lie on neither side. Not for omnidirectional views, and not below
    /// [`MAX_DEPTH`] levels.
    pub tells_directions: bool,
    /// Bounding volume of the views of a node.
    pub bounding: Bounding,
    /// Whether pairs that no view sees are culled.
    pub culling: bool,
    /// Occlusion culling.
    pub occlusion: Occlusion,
    /// Whether maps are fused with their parents; otherwise texels are looked up along the chain of parents.
    pub fusion: bool,
    /// Whether a map shows the leaf's cell that its centre is in, in every direction: conservative, for shadows.
    /// Otherwise rays start behind that cell, for images.
    pub own_cell: bool,
    /// Most pairs of a queue; `None` for the limit of a binding.
    pub queue_pairs: Option<u32>,
}

impl Default for Settings {
    /// Maps of 16² texels, with sharing.
    fn default() -> Self {
        Self {
            side: 16,
            texel: Texel::Range,
            threshold: 1.0,
            disc: Self::DISC,
            shared_disc: 0.4,
            sharing: true,
            scene_hierarchy: true,
            falls_back: true,
            view_depth: None,
            tells_directions: true,
            bounding: Bounding::Tight,
            culling: true,
            occlusion: Occlusion::Off,
            fusion: true,
            own_cell: true,
            queue_pairs: None,
        }
    }
}

impl Settings {
    /// Mean number of views that share a rendered pair, below which sharing costs more pairs than it saves.
    pub const WORTH_SHARING: f64 = 1.4;

    /// Smallest disc that covers a plane with discs at the centres of cells, one edge apart.
    pub const COVERING: f32 = 0.8165;

    /// Disc with the least shadow error for unshared maps, without more light leaks than exact maps of the same
    /// resolution. Sponza, 4K views of four bounces: error 0.221 at 0.4, 0.212 at 0.5, 0.248 at 0.8165; leaks 0.089,
    /// 0.055, 0.027, and about 0.06 for exact maps (`argus-lab study method megaviews --disc`).
    pub const DISC: f32 = 0.5;

    /// Ends of the shells of pairs, in edges of the scene's root. Each doubling has about as many nodes of a cut.
    pub(super) fn shells(&self) -> &'static [[f32; 2]] {
        const ALL: [[f32; 2]; 1] = [[0.0, f32::MAX]];
        const SHELLS: [[f32; 2]; 4] = [[0.0, 0.06], [0.06, 0.14], [0.14, 0.3], [0.3, f32::MAX]];
        // All shells but the first are tested.
        const TESTED: [[f32; 2]; 1] = [[1e-30, f32::MAX]];
        match self.occlusion {
            Occlusion::Off => &ALL,
            Occlusion::Shells => &SHELLS,
            Occlusion::Known => &TESTED,
        }
    }

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
        check(
            "threshold",
            self.threshold >= 1.0 && self.threshold <= 8.0,
            "1 to 8 texels",
            self.threshold.to_string(),
        )?;
        for (field, disc) in [("disc", self.disc), ("shared disc", self.shared_disc)] {
            check(field, disc > 0.0 && disc <= 1.0, "above 0 and at most 1", disc.to_string())?;
        }
        check(
            "scene hierarchy",
            self.scene_hierarchy || (self.sharing && !self.falls_back),
            "on unless views share and never fall back",
            "off".to_owned(),
        )?;
        let depth = self.view_depth.is_none_or(|depth| (1..=MAX_DEPTH).contains(&depth));
        check("levels of the view octree", depth, "1 to 10", format!("{:?}", self.view_depth))?;
        check(
            "queue",
            self.queue_pairs.is_none_or(|n| n >= 64),
            "at least 64 pairs",
            format!("{:?}", self.queue_pairs),
        )
    }
}

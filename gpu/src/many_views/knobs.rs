//! What a traversal may be told.

use super::Texel;
use crate::hierarchy::{HierarchyError, MAX_DEPTH};

/// Whether pairs are left out behind what a map already holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Occlusion {
    /// No.
    Off,
    /// Pairs are met in shells, the near ones first, and left out where a map already holds what hides them. Strictly
    /// conservative: maps are the same, byte for byte. What is counted may vary from run to run.
    Shells,
    /// Pairs are left out behind what the last frame's maps hold, which stay: how much the same test could leave out if
    /// it knew all beforehand. To measure with, where nothing moves; else maps are wrong.
    Known,
}

impl Occlusion {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Off, Self::Shells, Self::Known];

    /// As options and tables have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Shells => "on",
            Self::Known => "known",
        }
    }
}

/// What bounds the views of a node of their octree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Bounding {
    /// The sphere around their cell, as in the paper.
    Cell,
    /// A sphere around the views themselves where that is smaller.
    Tight,
}

/// What a traversal may be told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knobs {
    /// Texels of a hemisphere's side: 8 to 1024.
    pub side: u32,
    /// What a texel holds.
    pub texel: Texel,
    /// How large a node may appear and still be rendered whole, texels: 1 to 8.
    pub threshold: f32,
    /// The disc by which a rendered node covers texels' sample points, in radii of its cell's ball. [`Knobs::COVERING`]
    /// leaves no gap in a surface, as a picture has it; less lets less stand in the way that is not there, as a shadow has
    /// it, up to where light leaks.
    pub disc: f32,
    /// The same where several views share what is rendered: each sees it somewhere else, so that less is sure.
    pub shared_disc: f32,
    /// Whether views share what looks alike from all of them (MegaViews); otherwise each is traversed by itself
    /// (ManyLoDs).
    pub sharing: bool,
    /// Whether the scene's octree is traversed too; else each of its leaves goes down the octree over the views by itself: a
    /// baseline, which says what the scene's hierarchy is worth. Where views share, and do not fall back.
    pub scene_hierarchy: bool,
    /// Whether views are traversed each by itself after a frame in which rendered pairs were shared by fewer than
    /// [`Knobs::WORTH_SHARING`] views in the mean.
    pub falls_back: bool,
    /// Levels of the view octree below its root that divide cells, 1 to [`MAX_DEPTH`]; `None`: as many as where the views
    /// are calls for (`view_depth.rs`).
    pub view_depth: Option<u32>,
    /// Whether a last level, below those, tells the views of a cell apart by the axis that is nearest to the way they look:
    /// views on both sides of a wall, or on the walls of a corner, share no map then, whose middle would lie on neither. Of
    /// views that look everywhere, and below [`MAX_DEPTH`] levels, there is none.
    pub tells_directions: bool,
    /// What bounds the views of a node.
    pub bounding: Bounding,
    /// Whether what no view sees is culled.
    pub culling: bool,
    /// Whether pairs are left out behind what a map already holds.
    pub occlusion: Occlusion,
    /// Whether maps take what the maps above them hold; else texels are looked up one by one.
    pub fusion: bool,
    /// Whether a map holds what is in the leaf's cell that it is seen from, and that in every direction: conservative, as a
    /// shadow has it. Else rays begin behind that cell, as a picture has it.
    pub own_cell: bool,
    /// Most pairs of a queue; `None`: what one binding holds.
    pub queue_pairs: Option<u32>,
}

impl Default for Knobs {
    /// Maps of 16² texels, shared by an octree over the views.
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

impl Knobs {
    /// Views that share a rendered pair, in the mean, below which an octree over the views costs more pairs than it
    /// saves.
    pub const WORTH_SHARING: f64 = 1.4;

    /// The disc with which discs around the middles of cells, an edge apart, cover a plane.
    pub const COVERING: f32 = 0.8165;

    /// The disc with which maps of single views err least about shadow while light leaks no more often than through exact
    /// maps of as many texels: Sponza, 4K views of four bounces, 0.212 wrong at 0.5, 0.221 at 0.4, 0.248 at 0.8165; lit
    /// wrongly 0.055, 0.089, 0.027, and about 0.06 through exact maps (`argus study megaviews --disc`).
    pub const DISC: f32 = 0.5;

    /// Where shells of pairs end, edges of the scene's root: nodes of a cut are about as many in each doubling.
    pub(super) fn shells(&self) -> &'static [[f32; 2]] {
        const ALL: [[f32; 2]; 1] = [[0.0, f32::MAX]];
        const SHELLS: [[f32; 2]; 4] = [[0.0, 0.06], [0.06, 0.14], [0.14, 0.3], [0.3, f32::MAX]];
        // Whatever is not the first shell is tested.
        const TESTED: [[f32; 2]; 1] = [[1e-30, f32::MAX]];
        match self.occlusion {
            Occlusion::Off => &ALL,
            Occlusion::Shells => &SHELLS,
            Occlusion::Known => &TESTED,
        }
    }

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

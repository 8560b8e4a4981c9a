//! What changed from one pose or lighting to the next, and which pages of cells it touches.
//!
//! Cells depend on surfaces in them and a little around them, on what their rays meet, and on what the leaf sides that their
//! rays hit reflect. A mover changes the first where its boxes are, the second where rays cross its boxes, and the third wherever it
//! changes what arrives at a leaf side: directly, by its shadow, or over bounces. The first two are decided by boxes. For the third
//! each leaf side's radiance of before is compared with that of now, to the bit. So a page that is kept is what filling it in the new
//! pose would give. What cells met is recorded once something may move: the first move of a still scene touches all pages.

use glam::Vec3;

use super::super::lattice::{Lattice, PageKey};
use super::super::paths::LeafChanges;
use super::blocks::{BlockSet, Blocks};
use super::inputs::CellInputs;
use super::record::Record;
use super::sides::LIFT;

/// Cells along an edge of a page, and one more: corners reach a cell further.
const PAGE_REACH: f32 = 9.0;

/// Changes from one pose or lighting to the next.
pub(super) struct Changes {
    lattice: Lattice,
    /// Boxes of what moved, before and after.
    boxes: Vec<[Vec3; 2]>,
    /// The blocks that these meet.
    blocks: BlockSet,
    leaves: LeafChanges,
    /// What moved is not known, and every page counts as touched.
    is_anything: bool,
}

impl Changes {
    /// The changes between two states of a scene; `None` if nothing of before can be shown: the sky is another one, or the lattice is
    /// elsewhere.
    pub(super) fn between(before: &CellInputs, now: &CellInputs) -> Option<Self> {
        if before.lighting.sky != now.lighting.sky {
            return None;
        }
        let leaves = now.leaves.changes_from(&before.leaves, [&before.radiance, &now.radiance])?;
        let lattice = now.leaves.lattice();
        let blocks = Blocks::new(&lattice);
        let poses = now.pose.as_ref().zip(before.pose.as_ref());
        let moved = poses.map(|(pose, earlier)| pose.boxes_of_moved(earlier));
        let is_anything = moved.is_none();
        let boxes: Vec<[Vec3; 2]> =
            moved.into_iter().flatten().map(|around| blocks.widened(around)).collect();
        let mut met = BlockSet::default();
        boxes.iter().for_each(|around| blocks.add_box(&mut met, *around));
        Some(Self { lattice, boxes, blocks: met, leaves, is_anything })
    }

    /// Whether what moved was or is in a page of cells, or so near that it counts.
    pub(super) fn are_in(&self, page: PageKey) -> bool {
        let Some(first) = page.cell(0).filter(|_| !self.is_anything) else { return true };
        let ([low, _], spacing) = (self.lattice.corners(first), self.lattice.spacing(first.level()));
        // Rays against leaks start above surfaces.
        let [low, high] = [low - 1.5 * LIFT * spacing, low + (PAGE_REACH + 1.5 * LIFT) * spacing];
        self.boxes.iter().any(|[least, most]| (least.cmple(high) & most.cmpge(low)).all())
    }

    /// Whether what rays met is as it was. Then the record is renewed: it names leaf sides as they are now.
    pub(super) fn leave(&self, record: &mut Record) -> bool {
        !self.is_anything
            && !record.crossed().meets(&self.blocks)
            && record.rename(|read| self.leaves.now(read))
    }
}

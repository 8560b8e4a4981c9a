//! What changed from one pose or lighting to the next, and which pages of cells it touches.
//!
//! Cells depend on surfaces in them and a little around them, on what their rays meet, and on what the leaf sides that their
//! rays hit reflect. A mover changes the first where its boxes are, the second where rays cross its boxes, and the third wherever it
//! changes what arrives at a leaf side: directly, by its shadow, or over bounces. The first two are decided by boxes. For the third
//! each leaf side's radiance of before is compared with that of now, to the bit. So a page that is kept is what filling it in the new
//! pose would give.

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
}

impl Changes {
    /// The changes between two states of a scene; `None` if all cells change: the sky is another one, the lattice is elsewhere, or what
    /// cells met is not recorded since nothing moves.
    pub(super) fn between(before: &CellInputs, now: &CellInputs) -> Option<Self> {
        let (pose, earlier) = (now.pose.as_ref()?, before.pose.as_ref()?);
        if before.lighting.sky != now.lighting.sky {
            return None;
        }
        let leaves = now.leaves.changes_from(&before.leaves, [&before.radiance, &now.radiance])?;
        let lattice = now.leaves.lattice();
        let blocks = Blocks::new(&lattice);
        let moved = pose.boxes_of_moved(earlier);
        let boxes: Vec<[Vec3; 2]> = moved.into_iter().map(|around| blocks.widened(around)).collect();
        let mut met = BlockSet::default();
        boxes.iter().for_each(|around| blocks.add_box(&mut met, *around));
        Some(Self { lattice, boxes, blocks: met, leaves })
    }

    /// Whether what moved was or is in a page of cells, or so near that it counts.
    pub(super) fn are_in(&self, page: PageKey) -> bool {
        let Some(first) = page.cell(0) else { return true };
        let ([low, _], spacing) = (self.lattice.corners(first), self.lattice.spacing(first.level()));
        // Rays against leaks start above surfaces.
        let [low, high] = [low - 1.5 * LIFT * spacing, low + (PAGE_REACH + 1.5 * LIFT) * spacing];
        self.boxes.iter().any(|[least, most]| (least.cmple(high) & most.cmpge(low)).all())
    }

    /// Whether what rays met is as it was. Then the record is renewed: it names leaf sides as they are now.
    pub(super) fn leave(&self, record: &mut Record) -> bool {
        !record.crossed().meets(&self.blocks) && record.rename(|read| self.leaves.now(read))
    }
}

//! Cuts a batch into pieces and chunks. Large views become several pieces. A chunk is the pieces of one submission, side
//! by side in one target.
//!
//! The cut changes no bytes: pixels are computed from their position in the whole view.

use argus_scene::SampleId;

use crate::settings::CompositorSettings;

/// A rectangle of pixels: x, y, width, height.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rect {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// A part of a view that is drawn at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Piece {
    /// Index of the view in the batch.
    pub(crate) view: usize,
    /// Pixels of the view that it covers.
    pub(crate) part: Rect,
    /// Its first pixel in the chunk's target.
    pub(crate) target: [u32; 2],
    /// Sub-pixels along the edge of a pixel.
    pub(crate) side: u32,
}

impl Piece {
    /// Its first sub-pixel in the chunk's target of sub-pixels.
    pub(crate) fn fine_target(&self) -> [u32; 2] {
        self.target.map(|at| at * self.side)
    }

    /// Columns and rows of its sub-pixels.
    pub(crate) fn fine_size(&self) -> [u32; 2] {
        [self.part.width * self.side, self.part.height * self.side]
    }
}

/// Properties of a view that decide how a batch is cut into chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ViewExtent {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Sub-pixels along the edge of a pixel.
    pub(crate) side: u32,
    /// Whether its sub-pixels are drawn as linear radiance.
    pub(crate) linear: bool,
    /// Index of the pool of its samples.
    pub(crate) pool: usize,
    /// The reflection probes that its samples look up.
    pub(crate) probes: Option<SampleId>,
    /// Hash of the environment map that its samples were shaded with.
    pub(crate) environment: Option<[u8; 32]>,
}

/// Pieces of one submission, and the size of their target in pixels.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Chunk {
    pub(crate) pieces: Vec<Piece>,
    pub(crate) size: [u32; 2],
}

/// Most rows of a chunk's target.
const MAX_ROWS: u32 = 8192;

/// Cuts views into chunks. All pieces of a chunk have the same pool, reflection probes, environment, supersampling and kind of colour.
pub(crate) fn chunks(views: &[ViewExtent], settings: &CompositorSettings) -> Vec<Chunk> {
    let mut order: Vec<usize> = (0..views.len()).collect();
    let alike = |view: &ViewExtent| (view.pool, view.probes, view.environment, view.side, view.linear);
    order.sort_by_key(|&i| alike(&views[i]));
    let mut chunks = Vec::new();
    let mut open: Vec<Piece> = Vec::new();
    let mut pixels = 0;
    for view in order {
        let ViewExtent { width, height, side, .. } = views[view];
        let step = (settings.piece_side / side).max(1);
        for y in (0..height).step_by(step as usize) {
            for x in (0..width).step_by(step as usize) {
                let part = Rect { x, y, width: step.min(width - x), height: step.min(height - y) };
                let area = u64::from(part.width) * u64::from(part.height) * u64::from(side * side);
                let other = open.last().is_some_and(|p| alike(&views[p.view]) != alike(&views[view]));
                if !open.is_empty() && (pixels + area > settings.chunk_pixels || other) {
                    chunks.push(place(std::mem::take(&mut open)));
                    pixels = 0;
                }
                pixels += area;
                open.push(Piece { view, part, target: [0, 0], side });
            }
        }
    }
    if !open.is_empty() {
        chunks.push(place(open));
    }
    chunks
}

/// Places pieces on shelves, left to right and top to bottom. The target is as narrow as [`MAX_ROWS`] allows, so that the
/// rows of a piece lie close together after readback.
fn place(mut pieces: Vec<Piece>) -> Chunk {
    let widest = pieces.iter().map(|p| p.part.width).max().unwrap_or(0);
    let mut width = widest;
    let size = loop {
        let (mut x, mut y, mut shelf) = (0, 0, 0);
        for piece in &mut pieces {
            if x + piece.part.width > width {
                (x, y, shelf) = (0, y + shelf, 0);
            }
            piece.target = [x, y];
            x += piece.part.width;
            shelf = shelf.max(piece.part.height);
        }
        if (y + shelf) * pieces.first().map_or(1, |p| p.side) <= MAX_ROWS {
            break [width, y + shelf];
        }
        width += widest;
    };
    Chunk { pieces, size }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn overlap(a: &Piece, b: &Piece) -> bool {
        let apart = |a0: u32, a1: u32, b0: u32, b1: u32| a0 + a1 <= b0 || b0 + b1 <= a0;
        !apart(a.target[0], a.part.width, b.target[0], b.part.width)
            && !apart(a.target[1], a.part.height, b.target[1], b.part.height)
    }

    proptest! {
        #[test]
        fn every_pixel_of_every_view_is_in_one_piece_and_no_two_pieces_share_a_place(
            views in prop::collection::vec((1u32..700, 1u32..700, 1u32..4, 0usize..2), 1..12),
            piece_side in 1u32..400,
        ) {
            let piece_side = piece_side.max(40);
            let views: Vec<ViewExtent> = views
                .into_iter()
                .map(|(width, height, side, pool)| ViewExtent {
                    width,
                    height,
                    side,
                    linear: side > 1,
                    pool,
                    probes: None,
                    environment: None,
                })
                .collect();
            let settings = CompositorSettings { piece_side, chunk_pixels: 200_000, ..Default::default() };
            let chunks = chunks(&views, &settings);
            let mut covered = vec![0u64; views.len()];
            for chunk in &chunks {
                for (i, piece) in chunk.pieces.iter().enumerate() {
                    covered[piece.view] += u64::from(piece.part.width) * u64::from(piece.part.height);
                    prop_assert!(piece.part.width * piece.side <= piece_side.max(piece.side));
                    prop_assert!(piece.target[0] + piece.part.width <= chunk.size[0]);
                    prop_assert!(piece.target[1] + piece.part.height <= chunk.size[1]);
                    prop_assert!(chunk.pieces[..i].iter().all(|other| !overlap(other, piece)));
                }
            }
            for (covered, view) in covered.iter().zip(&views) {
                prop_assert_eq!(*covered, u64::from(view.width) * u64::from(view.height));
            }
        }
    }
}

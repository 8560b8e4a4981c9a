//! `shaders/compositor/fill.wgsl` and `sky_mask.wgsl`: depths of a band of cells from those that texels left there.

use super::lookup::{CONTINUES, Depth, SKY, bits_of, depth_of_cell, farther};
use super::second::ray_is_sky;
use super::view::View;

/// Sub-pixels along the edge of the block that one ray is tested for.
const SKY_BLOCK: usize = 4;

/// Cells along the edge of that block.
pub(super) fn sky_block(cell: u32) -> usize {
    (SKY_BLOCK / cell.max(1) as usize).max(1)
}

/// Three rows of cells, a column wider on both sides.
struct Rows {
    q: [Vec<f32>; 3],
    source: [Vec<u32>; 3],
}

impl Rows {
    /// Decodes a row of cells; none is beyond the piece.
    #[inline(always)]
    fn load(&mut self, slot: usize, row: Option<&[u32]>) {
        let (q, source) = (&mut self.q[slot], &mut self.source[slot]);
        let Some(row) = row else {
            q.fill(0.0);
            source.fill(0);
            return;
        };
        let count = row.len();
        let (q, source) = (&mut q[1..=count], &mut source[1..=count]);
        for i in 0..count {
            let depth = depth_of_cell(row[i]);
            q[i] = depth.q;
            source[i] = depth.source;
        }
    }
}

/// Depth between two neighbours of one surface: their mean. None if they are different surfaces.
#[inline(always)]
fn between(a: Depth, b: Depth) -> Depth {
    let continues = (a.q - b.q).abs() <= CONTINUES * a.q.min(b.q);
    Depth { q: if continues { 0.5 * (a.q + b.q) } else { 0.0 }, source: a.source }
}

#[inline(always)]
fn nearer(a: Depth, b: Depth) -> Depth {
    let second = b.q > a.q;
    Depth { q: if second { b.q } else { a.q }, source: if second { b.source } else { a.source } }
}

/// Fills a band of rows of cells. `depths` are those of the band.
#[inline(always)]
pub(super) fn fill(cells: &[u32], columns: usize, first_row: usize, depths: &mut [u32]) {
    let all = cells.len() / columns;
    let row = |at: Option<usize>| at.filter(|at| *at < all).map(|at| &cells[at * columns..][..columns]);
    let width = columns + 2;
    let mut rows = Rows {
        q: std::array::from_fn(|_| vec![0.0; width]),
        source: std::array::from_fn(|_| vec![0; width]),
    };
    rows.load(0, row(first_row.checked_sub(1)));
    rows.load(1, row(Some(first_row)));
    for (i, out) in depths.chunks_exact_mut(columns).enumerate() {
        rows.load((i + 2) % 3, row(Some(first_row + i + 1)));
        let of = |slot: usize| (&rows.q[slot % 3][..width], &rows.source[slot % 3][..width]);
        fill_row(of(i), of(i + 1), of(i + 2), out);
    }
}

type Row<'a> = (&'a [f32], &'a [u32]);

#[inline(always)]
fn fill_row(above: Row<'_>, own: Row<'_>, below: Row<'_>, out: &mut [u32]) {
    let width = out.len() + 2;
    let (above, own, below) = (
        (&above.0[..width], &above.1[..width]),
        (&own.0[..width], &own.1[..width]),
        (&below.0[..width], &below.1[..width]),
    );
    for c in 0..out.len() {
        let middle = Depth { q: own.0[c + 1], source: own.1[c + 1] };
        let (left, right) =
            (Depth { q: own.0[c], source: own.1[c] }, Depth { q: own.0[c + 2], source: own.1[c + 2] });
        let (up, down) = (
            Depth { q: above.0[c + 1], source: above.1[c + 1] },
            Depth { q: below.0[c + 1], source: below.1[c + 1] },
        );
        let (up_left, up_right) = (
            Depth { q: above.0[c], source: above.1[c] },
            Depth { q: above.0[c + 2], source: above.1[c + 2] },
        );
        let (down_left, down_right) = (
            Depth { q: below.0[c], source: below.1[c] },
            Depth { q: below.0[c + 2], source: below.1[c + 2] },
        );
        let straight = nearer(between(left, right), between(up, down));
        let across = nearer(between(up_left, down_right), between(up_right, down_left));
        let surface = nearer(straight, across);
        let replaced = surface.q > middle.q * (1.0 + CONTINUES);
        let depth = if replaced { surface } else { middle };
        let edges = farther(farther(left, right), farther(up, down));
        let corners = farther(farther(up_left, down_right), farther(up_right, down_left));
        let edge = farther(edges, corners);
        let guess = Depth { q: -edge.q, source: edge.source };
        out[c] = bits_of(if depth.q == 0.0 { guess } else { depth });
    }
}

/// Marks the empty cells of a band that show the sky. One ray is tested for a block of cells: a surface that is in none of them is
/// smaller than a block. The band begins at a multiple of [`sky_block`].
pub(super) fn mask_sky(view: &View<'_>, columns: usize, first_row: usize, depths: &mut [u32]) {
    let side = sky_block(view.of.cell as u32);
    for (i, rows) in depths.chunks_mut(side * columns).enumerate() {
        for first in (0..columns).step_by(side) {
            let last = (first + side).min(columns);
            let is_empty = rows.chunks_exact(columns).any(|row| row[first..last].contains(&0));
            if !is_empty {
                continue;
            }
            let middle =
                [first as f32 + 0.5 * side as f32, (first_row + i * side) as f32 + 0.5 * side as f32];
            let position =
                [0, 1].map(|axis| (middle[axis] + view.of.cell_origin[axis] as f32) * view.of.cell);
            if ray_is_sky(view, view.direction_of(position)) {
                for row in rows.chunks_exact_mut(columns) {
                    row[first..last].iter_mut().filter(|bits| **bits == 0).for_each(|bits| *bits = SKY);
                }
            }
        }
    }
}

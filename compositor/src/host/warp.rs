//! `shaders/compositor/warp.wgsl`: a pixel has the depth of its cell, and the colour of the frame that left it there.

use super::lookup::{LANES, SETTLED, SKY, WHOLE, depth_of, fetch};
use super::second;
use super::view::{Pixel, Rows, View};

/// Computes a row of pixels, eight at a time. `depths` are the filled cells from the given row of cells on. `to` are the rows of
/// images, and the index of the first pixel in them.
#[inline(always)]
pub(super) fn row(
    view: &View<'_>,
    cells: &[u32],
    (depths, first_cell_row): (&[u32], usize),
    y: usize,
    (to, first): (&mut Rows<'_>, usize),
) {
    let (width, side) = (view.of.piece_size[0] as usize, view.of.cell as usize);
    let [left, top] = view.of.cell_origin;
    let cell_row = ((y / side) as i32 - top) as usize;
    let own = &depths[(cell_row - first_cell_row) * view.columns..][..view.columns];
    let start = view.direction_of([0.0, y as f32 + 0.5]);
    for first_lane in 0..width.div_ceil(LANES) {
        let x = first_lane * LANES;
        let count = LANES.min(width - x);
        let mut bits = [0u32; LANES];
        let mut columns = [0usize; LANES];
        for i in 0..LANES {
            columns[i] = (((x + i.min(count - 1)) / side) as i32 - left) as usize;
            bits[i] = own[columns[i]];
        }
        let ([cx, cy, cz], [rx, ry, rz]) = (start, view.of.right);
        let [mut dx, mut dy, mut dz, mut q] = [[0.0f32; LANES]; 4];
        let mut open = [0u32; LANES];
        for i in 0..LANES {
            let at = (x + i) as f32 + 0.5;
            dx[i] = cx + rx * at;
            dy[i] = cy + ry * at;
            dz[i] = cz + rz * at;
            q[i] = depth_of(bits[i]).q.max(0.0);
            open[i] = (((q[i] > 0.0) | (bits[i] == SKY)) as u32) << (bits[i] & 7);
        }
        let d = [dx, dy, dz];
        let mut present = 0;
        for one in open.iter().take(count) {
            present |= *one;
        }
        while present != 0 {
            let source = present.trailing_zeros();
            present &= present - 1;
            let found = fetch(view, source as usize, &d, &q);
            for i in 0..count {
                if open[i] != 1 << source {
                    continue;
                }
                let direction = [d[0][i], d[1][i], d[2][i]];
                let pixel: Pixel = if bits[i] == SKY {
                    match found.agreement[i] > WHOLE {
                        true => view.sky_in(&found, i, source as usize),
                        false => view.seen_sky(direction),
                    }
                } else if found.agreement[i] >= SETTLED {
                    view.surface(&found, i, source as usize, direction)
                } else {
                    open[i] = 0;
                    continue;
                };
                to.store(first + x + i, &pixel);
            }
        }
        for i in 0..count {
            if open[i] != 0 {
                continue;
            }
            let at = cell_row * view.columns + columns[i];
            let pixel = second::pixel(view, cells, at, bits[i], [d[0][i], d[1][i], d[2][i]]);
            to.store(first + x + i, &pixel);
        }
    }
}

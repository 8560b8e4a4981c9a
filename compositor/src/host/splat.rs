//! `shaders/compositor/splat.wgsl`: texels of a frame are projected into cells of the view. A cell keeps the nearest depth.

use argus_shaders::layout::compositor::{CellProjection, Splat};

use super::lookup::{LANES, Lanes, cell_of, continues, dot4};
use super::source::HostFrame;
use crate::draw_batch::SplatCall;

/// Texels on a side of a block.
const BLOCK: usize = 8;
/// Distance of a texel's points, in cells, if it has several; and the extent up to which one point is enough.
const APART: f32 = 1.4;
const CLOSED: f32 = 2.0;
/// Most points along the edge of a texel.
const MOST: f32 = 32.0;

/// Splats the blocks of a call.
#[inline(always)]
pub(super) fn splat(call: &SplatCall, blocks: &[u32], frame: &HostFrame, cells: &mut [u32]) {
    let first = call.splat.first_block as usize;
    for block in &blocks[first..first + call.block_count as usize] {
        let (left, top, stride) = (block & 0x3fff, block >> 14 & 0x3fff, (block >> 28) as usize);
        let (left, top) = (left as usize, top as usize);
        for row in 0..BLOCK {
            let y = top + row * stride;
            if y >= frame.height {
                break;
            }
            if call.sparse {
                squares(&call.splat, frame, (left, y, stride), cells);
            } else {
                points(&call.splat, frame, (left, y, stride), cells);
            }
        }
    }
}

/// Splats a row of a block whose texels are as dense as cells: each writes one cell.
#[inline(always)]
fn points(splat: &Splat, frame: &HostFrame, (left, y, stride): (usize, usize, usize), cells: &mut [u32]) {
    let to = &splat.projection;
    let row = &frame.inverse_range[y * frame.width..][..frame.width];
    // Beyond the image is sky, which is not splatted.
    let mut stored: Lanes = [0.0; LANES];
    if stride == 1 && left + LANES <= row.len() {
        stored.copy_from_slice(&row[left..left + LANES]);
    } else {
        for i in 0..LANES {
            let x = left + i * stride;
            if x < row.len() {
                stored[i] = row[x];
            }
        }
    }
    let dy = (y as f32 + 0.5) * to.scale[1] + to.bias[1];
    let mut places = [u32::MAX; LANES];
    let mut values = [0u32; LANES];
    let (columns, rows) = (to.cell_columns as f32, to.cell_rows as f32);
    let (first_column, first_row) = (to.origin_column as f32, to.origin_row as f32);
    let ([ax, ay, az, aw], [bx, by, bz, bw], [cx, cy, cz, cw]) = (to.column, to.row, to.depth);
    let (scale, bias) = (to.scale[0], to.bias[0]);
    for i in 0..LANES {
        let dx = ((left + i * stride) as f32 + 0.5) * scale + bias;
        let inverse_depth = stored[i] * (dx * dx + dy * dy + 1.0).sqrt();
        let x = ax * dx - ay * dy - az + aw * inverse_depth;
        let y = bx * dx - by * dy - bz + bw * inverse_depth;
        let w = cx * dx - cy * dy - cz + cw * inverse_depth;
        let by_w = 1.0 / w.max(1e-30);
        let q = inverse_depth * by_w;
        let column = (x * by_w).floor() - first_column;
        let row = (y * by_w).floor() - first_row;
        let inside = (w > 0.0)
            & (q > 0.0)
            & (q <= f32::MAX)
            & (column >= 0.0)
            & (row >= 0.0)
            & (column < columns)
            & (row < rows);
        // Within these, the conversions are exact.
        let place = (row.max(0.0).min(rows) as i32).wrapping_mul(to.cell_columns);
        let place = place.wrapping_add(column.max(0.0).min(columns) as i32) as u32;
        places[i] = if inside { place } else { u32::MAX };
        values[i] = cell_of(q, splat.source);
    }
    for (place, value) in places.into_iter().zip(values) {
        if let Some(cell) = cells.get_mut(place as usize) {
            *cell = (*cell).max(value);
        }
    }
}

/// Splats a row of a block whose texels are farther apart than cells.
fn squares(splat: &Splat, frame: &HostFrame, (left, y, stride): (usize, usize, usize), cells: &mut [u32]) {
    for x in (left..frame.width).step_by(stride).take(BLOCK) {
        square(splat, frame, [x as i64, y as i64], stride as i64, cells);
    }
}

/// Homogeneous cell coordinates of a direction at an inverse depth.
fn projected(to: &CellProjection, direction: [f32; 3], inverse_depth: f32) -> [f32; 3] {
    let p = [direction[0], direction[1], direction[2], inverse_depth];
    [dot4(to.column, p), dot4(to.row, p), dot4(to.depth, p)]
}

/// A surface along one axis of the image, relative to a texel's centre: the change of inverse depth from one texel to the next,
/// and its extent in texels, half way to each neighbour of the same surface.
struct Along {
    slope: f32,
    begin: f32,
    end: f32,
}

fn along(before: f32, own: f32, behind: f32) -> Along {
    let (goes_before, goes_behind) = (continues(before, own), continues(own, behind));
    let first = if goes_before { own - before } else { 1e30 };
    let second = if goes_behind { behind - own } else { 1e30 };
    // The larger of two slopes may be an edge.
    let least = if second.abs() < first.abs() { second } else { first };
    Along {
        slope: if goes_before || goes_behind { least } else { 0.0 },
        begin: if goes_before { -0.5 } else { 0.0 },
        end: if goes_behind { 0.5 } else { 0.0 },
    }
}

/// a + s b.
fn plus(a: [f32; 3], s: f32, b: [f32; 3]) -> [f32; 3] {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// Number of points between two ends of a texel, in homogeneous cell coordinates.
fn places_between(a: [f32; 3], b: [f32; 3]) -> f32 {
    let at = |h: [f32; 3]| [h[0] / h[2].max(1e-30), h[1] / h[2].max(1e-30)];
    let (at_a, at_b) = (at(a), at(b));
    let (dx, dy) = (at_a[0] - at_b[0], at_a[1] - at_b[1]);
    let apart = (dx * dx + dy * dy).sqrt();
    let measured = a[2] > 0.0 && b[2] > 0.0 && apart < APART * MOST;
    match (measured, apart <= CLOSED) {
        (false, _) => MOST,
        (true, true) => 1.0,
        (true, false) => (apart / APART).ceil(),
    }
}

/// One bit for each side of the piece, and one for the eye's plane, that a point lies beyond.
fn sides_beyond(to: &CellProjection, h: [f32; 3]) -> u32 {
    let beyond = |axis: usize, origin: i32, cells: i32| {
        let (first, last) = (origin as f32, origin as f32 + cells as f32);
        u32::from(h[axis] < first * h[2]) | u32::from(h[axis] > last * h[2]) << 1
    };
    beyond(0, to.origin_column, to.cell_columns)
        | beyond(1, to.origin_row, to.cell_rows) << 2
        | u32::from(h[2] <= 0.0) << 4
}

/// Splats a texel that is farther from the next one than cells are: a rectangle of its surface's plane.
fn square(splat: &Splat, frame: &HostFrame, [x, y]: [i64; 2], stride: i64, cells: &mut [u32]) {
    let to = &splat.projection;
    let direction = |x: i64, y: i64| {
        let [dx, dy] =
            [(x as f32 + 0.5) * to.scale[0] + to.bias[0], (y as f32 + 0.5) * to.scale[1] + to.bias[1]];
        [dx, -dy, -1.0]
    };
    let inverse_depth = |x: i64, y: i64| {
        let inside = (0..frame.width as i64).contains(&x) && (0..frame.height as i64).contains(&y);
        let stored = if inside { frame.inverse_range[y as usize * frame.width + x as usize] } else { 0.0 };
        let [dx, dy, _] = direction(x, y);
        stored * (dx * dx + dy * dy + 1.0).sqrt()
    };
    let own = inverse_depth(x, y);
    if !(own > 0.0) {
        return;
    }
    let across = along(inverse_depth(x - stride, y), own, inverse_depth(x + stride, y));
    let down = along(inverse_depth(x, y - stride), own, inverse_depth(x, y + stride));
    let middle = projected(to, direction(x, y), own);
    let right = projected(to, [to.scale[0] * stride as f32, 0.0, 0.0], across.slope);
    let below = projected(to, [0.0, -to.scale[1] * stride as f32, 0.0], down.slope);
    let columns = places_between(plus(middle, across.begin, right), plus(middle, across.end, right));
    let rows = places_between(plus(middle, down.begin, below), plus(middle, down.end, below));
    let beyond = [down.begin, down.end]
        .into_iter()
        .flat_map(|row| {
            [across.begin, across.end].map(|column| plus(plus(middle, row, below), column, right))
        })
        .fold(!0, |all, corner| all & sides_beyond(to, corner));
    if beyond != 0 {
        return;
    }
    let offset = |i: f32, count: f32, axis: &Along| {
        if count == 1.0 { 0.0 } else { axis.begin + (axis.end - axis.begin) * ((i + 0.5) / count) }
    };
    for j in 0..rows as u32 {
        let b = offset(j as f32, rows, &down);
        for i in 0..columns as u32 {
            let a = offset(i as f32, columns, &across);
            let h = plus(plus(middle, a, right), b, below);
            let q = (own + across.slope * a + down.slope * b) / h[2].max(1e-30);
            let place = [0, 1].map(|axis| (h[axis] / h[2].max(1e-30)).floor());
            let column = place[0] - to.origin_column as f32;
            let row = place[1] - to.origin_row as f32;
            let inside = h[2] > 0.0
                && q > 0.0
                && q <= f32::MAX
                && (0.0..to.cell_columns as f32).contains(&column)
                && (0.0..to.cell_rows as f32).contains(&row);
            if inside {
                let place = row as usize * to.cell_columns as usize + column as usize;
                cells[place] = cells[place].max(cell_of(q, splat.source));
            }
        }
    }
}

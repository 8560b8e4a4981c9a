// Program of papers/eye-points/src/device/cells.rs: points of pieces, conservatively (EPR, section 3.3). Defined in f64 by
// `papers/eye-points/src/cells.rs`.
//
// An invocation is a piece, then a row of cells, then a point. So no loop is longer than a binary search.

import package::eye_points::shared::eye_points::PointPiece;
import package::shared::linear::linear_index;

struct PointStep {
    // Number of pieces, rows or points: invocations.
    count: u32,
    // Number of pieces.
    pieces: u32,
    // Number of rows.
    rows: u32,
}

var<immediate> step: PointStep;

@group(0) @binding(0) var<storage, read> pieces: array<PointPiece>;
// Rows of each piece, which are scanned to `first_row`.
@group(0) @binding(1) var<storage, read_write> row_counts: array<u32>;
@group(0) @binding(2) var<storage, read> first_row: array<u32>;
// Cells of each row, which are scanned to `first_cell`.
@group(0) @binding(3) var<storage, read_write> cell_counts: array<u32>;
@group(0) @binding(4) var<storage, read> first_cell: array<u32>;
// Column and row in 16 bits each, then the piece.
@group(0) @binding(5) var<storage, read_write> points: array<vec2u>;
// For each piece an upper bound of its cells, in units of `BOUND_UNIT`.
@group(0) @binding(6) var<storage, read_write> cell_bounds: array<u32>;

// As in cells.rs.
const BOUND_UNIT: f32 = 256.0;
// Rows and columns that 16 bits can say.
const MOST_CELLS: f32 = 65000.0;
// A share of the row or column, added to the piece's slack.
const SLACK_SHARE: f32 = 2e-7;

fn slack(piece: u32, at: f32) -> f32 {
    return pieces[piece].slack + SLACK_SHARE * at;
}

// The first and last column of a row; the last is less than the first in a row without cells.
fn columns(piece: u32, row: u32) -> vec2i {
    let low = f32(row) - slack(piece, f32(row));
    let high = f32(row) + 1.0 + slack(piece, f32(row));
    var least = 3e38;
    var most = -3e38;
    for (var i = 0u; i < 3u; i++) {
        let p = pieces[piece].places[i];
        let q = pieces[piece].places[(i + 1u) % 3u];
        if max(p.y, q.y) < low || min(p.y, q.y) > high {
            continue;
        }
        // The ends of the part of the edge within the row.
        let held = clamp(vec2f(p.y, q.y), vec2f(low), vec2f(high));
        let rise = q.y - p.y;
        let inner = p.x + (q.x - p.x) * ((held - p.y) / select(1.0, rise, rise != 0.0));
        let x = select(inner, vec2f(p.x, q.x), held == vec2f(p.y, q.y));
        least = min(least, min(x.x, x.y));
        most = max(most, max(x.x, x.y));
    }
    if least > most {
        return vec2i(1, 0);
    }
    return vec2i(clamp(floor(vec2f(least - slack(piece, least), most + slack(piece, most))), vec2f(0.0), vec2f(MOST_CELLS)));
}

@compute @workgroup_size(64)
fn count_rows(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let places = pieces[at].places;
    let top = max(places[0].y, max(places[1].y, places[2].y));
    let rows = u32(clamp(floor(top + slack(at, top)), 0.0, MOST_CELLS)) + 1u;
    row_counts[at] = rows;
    let right = clamp(max(places[0].x, max(places[1].x, places[2].x)), 0.0, MOST_CELLS);
    cell_bounds[at] = u32((f32(rows) + 1.0) * (right + 2.0) / BOUND_UNIT) + 1u;
}

// The last piece whose first row is not after a row.
fn piece_of(row: u32) -> u32 {
    var low = 0u;
    var high = min(step.pieces, arrayLength(&first_row));
    while low + 1u < high {
        let middle = (low + high) / 2u;
        if first_row[middle] <= row {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

@compute @workgroup_size(64)
fn count_cells(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let piece = piece_of(at);
    let found = columns(piece, at - first_row[piece]);
    cell_counts[at] = u32(max(found.y + 1 - found.x, 0));
}

@compute @workgroup_size(64)
fn make_points(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    // The last row whose first point is not after this one. A row without cells is never the last.
    var low = 0u;
    var high = min(step.rows, arrayLength(&first_cell));
    while low + 1u < high {
        let middle = (low + high) / 2u;
        if first_cell[middle] <= at {
            low = middle;
        } else {
            high = middle;
        }
    }
    let piece = piece_of(low);
    let row = low - first_row[piece];
    let column = u32(columns(piece, row).x) + at - first_cell[low];
    points[at] = vec2u((row << 16u) | column, piece);
}

// Program of compositor/src/passes/fill.rs: depths from splatted cells. A surface that continues across a cell fills it
// and replaces farther depths. Other empty cells take a neighbour's depth as a guess.

import package::shared::cells::{CONTINUES, Depth, bits_of, continues, depth_of_cell};

struct Fill {
    first_cell: u32,
    columns: i32,
    rows: i32,
}

var<immediate> fill: Fill;

@group(0) @binding(0) var<storage, read> cells: array<u32>;
@group(0) @binding(1) var<storage, read_write> depths: array<u32>;

fn cell_at(column: i32, row: i32) -> Depth {
    let inside = column >= 0 && row >= 0 && column < fill.columns && row < fill.rows;
    let index = select(0u, u32(row * fill.columns + column), inside);
    return depth_of_cell(select(0u, cells[fill.first_cell + index], inside));
}

// Depth between two opposite neighbours of one surface: the mean inverse depth, which is affine over the image. None if
// they are different surfaces.
fn between(a: Depth, b: Depth) -> Depth {
    return Depth(select(0.0, 0.5 * (a.q + b.q), continues(a.q, b.q)), a.source);
}

fn nearer(a: Depth, b: Depth) -> Depth {
    return Depth(max(a.q, b.q), select(a.source, b.source, b.q > a.q));
}

// The farther of two depths; none is ignored.
fn farther(a: Depth, b: Depth) -> Depth {
    let second = a.q == 0.0 || (b.q > 0.0 && b.q < a.q);
    return Depth(select(a.q, b.q, second), select(a.source, b.source, second));
}

@compute @workgroup_size(8, 8)
fn fill_cell(@builtin(global_invocation_id) id: vec3u) {
    let c = i32(id.x);
    let r = i32(id.y);
    if c >= fill.columns || r >= fill.rows {
        return;
    }
    let own = cell_at(c, r);
    let left = cell_at(c - 1, r);
    let right = cell_at(c + 1, r);
    let up = cell_at(c, r - 1);
    let down = cell_at(c, r + 1);
    let up_left = cell_at(c - 1, r - 1);
    let up_right = cell_at(c + 1, r - 1);
    let down_left = cell_at(c - 1, r + 1);
    let down_right = cell_at(c + 1, r + 1);
    let straight = nearer(between(left, right), between(up, down));
    let across = nearer(between(up_left, down_right), between(up_right, down_left));
    let surface = nearer(straight, across);
    var depth = own;
    if surface.q > own.q * (1.0 + CONTINUES) {
        depth = surface;
    }
    if depth.q == 0.0 {
        let edges = farther(farther(left, right), farther(up, down));
        let corners = farther(farther(up_left, down_right), farther(up_right, down_left));
        let edge = farther(edges, corners);
        depth = Depth(-edge.q, edge.source);
    }
    depths[fill.first_cell + u32(r * fill.columns + c)] = bits_of(depth);
}

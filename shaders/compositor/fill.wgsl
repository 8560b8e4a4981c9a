// Program of compositor/src/passes/fill.rs: cells become depths. A surface that goes on from one side of a cell
// to the other fills it, over whatever lies farther; other empty cells take a neighbour's depth on trial.

struct Fill {
    first_cell: u32,
    columns: i32,
    rows: i32,
}

var<immediate> fill: Fill;

// Low word unused, high word the bits of the greatest inverse depth.
@group(0) @binding(0) var<storage, read> cells: array<vec2u>;
@group(0) @binding(1) var<storage, read_write> depths: array<f32>;

// Relative difference of inverse depth below which two cells are taken for one surface.
const CONTINUES: f32 = 0.1;

fn cell_at(column: i32, row: i32) -> f32 {
    let inside = column >= 0 && row >= 0 && column < fill.columns && row < fill.rows;
    let index = select(0u, u32(row * fill.columns + column), inside);
    return select(0.0, bitcast<f32>(cells[fill.first_cell + index].y), inside);
}

// Inverse depth between two opposite neighbours of one surface, which is affine over the image; 0 if they are
// not of one.
fn between(a: f32, b: f32) -> f32 {
    return select(0.0, 0.5 * (a + b), abs(a - b) <= CONTINUES * min(a, b));
}

// The lesser that is not 0: the farther of two.
fn farther(a: f32, b: f32) -> f32 {
    return select(select(min(a, b), a, b == 0.0), b, a == 0.0);
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
    let straight = max(between(left, right), between(up, down));
    let across = max(between(up_left, down_right), between(up_right, down_left));
    let surface = max(straight, across);
    var depth = own;
    if surface > own * (1.0 + CONTINUES) {
        depth = surface;
    }
    if depth == 0.0 {
        let edge = farther(farther(left, right), farther(up, down));
        depth = -farther(edge, farther(farther(up_left, down_right), farther(up_right, down_left)));
    }
    depths[fill.first_cell + u32(r * fill.columns + c)] = depth;
}

// Where a texel of a pinhole image lands among the cells of a view: what splat and recall leave their depths by.

import package::shared::camera::direction_in_face;

// One pinhole image, as one piece of one view sees it. Rows take a position in the image's axes times its inverse depth, and
// that inverse depth, to cell coordinates times w, and to w, the depth along the view's axis times the same.
struct Landing {
    column: vec4f,
    row: vec4f,
    depth: vec4f,
    // Texel of the image to its direction.
    scale: vec2f,
    bias: vec2f,
    first_cell: u32,
    // Columns and rows of the piece's cells.
    cell_columns: i32,
    cell_rows: i32,
    // Where the piece's cells begin in the view's.
    origin_column: i32,
    origin_row: i32,
}

struct Landed {
    // Inverse depth along the view's axis, 1/metres.
    q: f32,
    // Index of the cell.
    cell: u32,
    // A surface is there, and the piece has the cell.
    inside: bool,
}

// What lies in a direction (in the image's axes, at depth 1) at an inverse depth: cell coordinates times w, and w. Linear in
// both.
fn projected(landing: Landing, direction: vec3f, inverse_depth: f32) -> vec3f {
    let p = vec4f(direction, inverse_depth);
    return vec3f(dot(landing.column, p), dot(landing.row, p), dot(landing.depth, p));
}

// The cell that something falls into which was projected.
fn placed(landing: Landing, h: vec3f, inverse_depth: f32) -> Landed {
    let w = h.z;
    let q = inverse_depth / max(w, 1e-30);
    let at = floor(h.xy / max(w, 1e-30));
    // Written so that whatever is not finite, behind the eye or of another piece fails; sky has range 0.
    let size = vec2f(f32(landing.cell_columns), f32(landing.cell_rows));
    let cell = at - vec2f(f32(landing.origin_column), f32(landing.origin_row));
    let usable = (bitcast<u32>(q) - 1u) < 0x7f7fffffu && w > 0.0;
    let inside = usable && all(cell >= vec2f(0.0)) && all(cell < size);
    // What is not inside may have any index.
    let index = landing.first_cell + u32(cell.y) * u32(landing.cell_columns) + u32(cell.x);
    return Landed(q, index, inside);
}

// The direction of a texel's centre, in the image's axes at depth 1.
fn direction_of_texel(landing: Landing, texel: vec2u) -> vec3f {
    return direction_in_face(landing.scale, landing.bias, vec2f(texel) + 0.5);
}

// Where a texel lands whose surface has that inverse range.
fn landed(landing: Landing, texel: vec2u, inverse_range: f32) -> Landed {
    let direction = direction_of_texel(landing, texel);
    let inverse_depth = inverse_range * length(direction);
    return placed(landing, projected(landing, direction, inverse_depth), inverse_depth);
}

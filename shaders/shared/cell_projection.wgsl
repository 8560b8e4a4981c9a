// Where a texel of a pinhole image lands among the cells of a view: what splat and recall leave their depths by.

import package::shared::camera::direction_in_face;

// One pinhole image, as one piece of one view sees it. Rows take a position in the image's axes times its inverse depth, and
// that inverse depth, to cell coordinates times w, and to w, the depth along the view's axis times the same.
struct CellProjection {
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

struct ProjectedTexel {
    // Inverse depth along the view's axis, 1/metres.
    q: f32,
    // Index of the cell.
    cell: u32,
    // A surface is there, and the piece has the cell.
    inside: bool,
}

// What lies in a direction (in the image's axes, at depth 1) at an inverse depth: cell coordinates times w, and w. Linear in
// both.
fn projected(projection: CellProjection, direction: vec3f, inverse_depth: f32) -> vec3f {
    let p = vec4f(direction, inverse_depth);
    return vec3f(dot(projection.column, p), dot(projection.row, p), dot(projection.depth, p));
}

// The cell that something falls into which was projected.
fn cell_hit(projection: CellProjection, h: vec3f, inverse_depth: f32) -> ProjectedTexel {
    let w = h.z;
    let q = inverse_depth / max(w, 1e-30);
    let at = floor(h.xy / max(w, 1e-30));
    // Written so that whatever is not finite, behind the eye or of another piece fails; sky has range 0.
    let size = vec2f(f32(projection.cell_columns), f32(projection.cell_rows));
    let cell = at - vec2f(f32(projection.origin_column), f32(projection.origin_row));
    let usable = (bitcast<u32>(q) - 1u) < 0x7f7fffffu && w > 0.0;
    let inside = usable && all(cell >= vec2f(0.0)) && all(cell < size);
    // What is not inside may have any index.
    let index = projection.first_cell + u32(cell.y) * u32(projection.cell_columns) + u32(cell.x);
    return ProjectedTexel(q, index, inside);
}

// The direction of a texel's centre, in the image's axes at depth 1.
fn direction_of_texel(projection: CellProjection, texel: vec2u) -> vec3f {
    return direction_in_face(projection.scale, projection.bias, vec2f(texel) + 0.5);
}

// Where a texel lands whose surface has that inverse range.
fn project_texel(projection: CellProjection, texel: vec2u, inverse_range: f32) -> ProjectedTexel {
    let direction = direction_of_texel(projection, texel);
    let inverse_depth = inverse_range * length(direction);
    return cell_hit(projection, projected(projection, direction, inverse_depth), inverse_depth);
}

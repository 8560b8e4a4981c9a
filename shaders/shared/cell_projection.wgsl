// Projects texels of a pinhole image into cells of a view. Used by splat and reproject.

import package::shared::camera::direction_in_face;

// The transform from one pinhole image to the cells of one piece. Its rows take (position × inverse depth, inverse depth)
// in the image's axes to homogeneous cell coordinates; w is the depth along the view's axis times that inverse depth.
struct CellProjection {
    column: vec4f,
    row: vec4f,
    depth: vec4f,
    // Direction of a texel: scale * texel + bias.
    scale: vec2f,
    bias: vec2f,
    first_cell: u32,
    // Columns and rows of the piece's cells.
    cell_columns: i32,
    cell_rows: i32,
    // First cell of the piece, in cells of the view.
    origin_column: i32,
    origin_row: i32,
}

struct ProjectedTexel {
    // Inverse depth along the view's axis, 1/metres.
    q: f32,
    // Index of the cell.
    cell: u32,
    // There is a surface, and its cell belongs to the piece.
    inside: bool,
}

// Homogeneous cell coordinates of a direction (the image's axes, depth 1) at an inverse depth. Linear in both.
fn projected(projection: CellProjection, direction: vec3f, inverse_depth: f32) -> vec3f {
    let p = vec4f(direction, inverse_depth);
    return vec3f(dot(projection.column, p), dot(projection.row, p), dot(projection.depth, p));
}

// The cell of homogeneous cell coordinates.
fn cell_hit(projection: CellProjection, h: vec3f, inverse_depth: f32) -> ProjectedTexel {
    let w = h.z;
    let q = inverse_depth / max(w, 1e-30);
    let at = floor(h.xy / max(w, 1e-30));
    // False if not finite, behind the eye or outside the piece. Sky has inverse range 0.
    let size = vec2f(f32(projection.cell_columns), f32(projection.cell_rows));
    let cell = at - vec2f(f32(projection.origin_column), f32(projection.origin_row));
    let usable = (bitcast<u32>(q) - 1u) < 0x7f7fffffu && w > 0.0;
    let inside = usable && all(cell >= vec2f(0.0)) && all(cell < size);
    // The index is arbitrary if not inside.
    let index = projection.first_cell + u32(cell.y) * u32(projection.cell_columns) + u32(cell.x);
    return ProjectedTexel(q, index, inside);
}

// Direction of a texel's centre, in the image's axes at depth 1.
fn direction_of_texel(projection: CellProjection, texel: vec2u) -> vec3f {
    return direction_in_face(projection.scale, projection.bias, vec2f(texel) + 0.5);
}

// Projects a texel with that inverse range.
fn project_texel(projection: CellProjection, texel: vec2u, inverse_range: f32) -> ProjectedTexel {
    let direction = direction_of_texel(projection, texel);
    let inverse_depth = inverse_range * length(direction);
    return cell_hit(projection, projected(projection, direction, inverse_depth), inverse_depth);
}

// Program of compositor/src/passes/splat.rs: texels of a sample that lie in the view's frustum leave their
// depth in the cells of the view that they fall into; the nearest stays.

import package::shared::camera::direction_in_face;
import package::shared::cells::cell_of;

// One face of one sample, as one view sees it. Rows take a position in the face's axes times its inverse depth,
// and that inverse depth, to cell coordinates times w, and to w, the depth along the view's axis times the same.
struct Splat {
    column: vec4f,
    row: vec4f,
    depth: vec4f,
    // Texel of the face to its direction.
    scale: vec2f,
    bias: vec2f,
    face_offset: vec2u,
    face_size: vec2u,
    layer: u32,
    first_block: u32,
    first_cell: u32,
    // Columns and rows of the piece's cells.
    cell_columns: i32,
    cell_rows: i32,
    // Where the piece's cells begin in the view's.
    origin_column: i32,
    origin_row: i32,
    // Position of the sample in the plan's list.
    source: u32,
}

var<immediate> splat: Splat;

@group(0) @binding(0) var inverse_range: texture_2d_array<f32>;
// 8x8 texels each, every stride-th: column and row of the first in the face in 14 bits each, stride in 4.
@group(0) @binding(1) var<storage, read> blocks: array<u32>;
@group(0) @binding(2) var<storage, read_write> cells: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn splat_block(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let block = blocks[splat.first_block + group.x];
    let texel = vec2u(block & 0x3fffu, (block >> 14u) & 0x3fffu) + local.xy * (block >> 28u);
    let stored = textureLoad(inverse_range, splat.face_offset + texel, splat.layer, 0).x;
    let direction = direction_in_face(splat.scale, splat.bias, vec2f(texel) + 0.5);
    let inverse_depth = stored * length(direction);
    let p = vec4f(direction, inverse_depth);
    let w = dot(splat.depth, p);
    let q = inverse_depth / max(w, 1e-30);
    let at = floor(vec2f(dot(splat.column, p), dot(splat.row, p)) / max(w, 1e-30));
    // Written so that whatever is not finite, behind the eye or of another piece fails; sky has range 0.
    let size = vec2f(f32(splat.cell_columns), f32(splat.cell_rows));
    let cell = at - vec2f(f32(splat.origin_column), f32(splat.origin_row));
    let usable = (bitcast<u32>(q) - 1u) < 0x7f7fffffu && w > 0.0;
    if usable && all(texel < splat.face_size) && all(cell >= vec2f(0.0)) && all(cell < size) {
        let index = splat.first_cell + u32(cell.y) * u32(splat.cell_columns) + u32(cell.x);
        atomicMax(&cells[index], cell_of(q, splat.source));
    }
}

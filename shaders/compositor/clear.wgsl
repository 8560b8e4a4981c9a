// Program of compositor/src/passes/clear.rs: cells that no texel came near are clear if the samples see past everything there.
// One ray is followed for a block of them: a surface that none of a block's texels hit would have to be smaller than they.

import package::shared::cells::CLEAR;
import package::shared::fetch::{direction_of, is_clear, not_baked, view};

struct Clear {
    columns: u32,
    rows: u32,
    // Cells on the edge of a block.
    side: u32,
}

var<immediate> clear: Clear;

@group(0) @binding(9) var<storage, read_write> depths: array<u32>;

// Place of a block's cell number i, or of its last where the piece ends before.
fn place_of_cell(block: vec2u, i: u32) -> u32 {
    let offset = vec2u(i % clear.side, i / clear.side);
    let cell = min(block * clear.side + offset, vec2u(clear.columns, clear.rows) - 1u);
    return view.first_cell + cell.y * clear.columns + cell.x;
}

@compute @workgroup_size(8, 8)
fn clear_block(@builtin(global_invocation_id) id: vec3u) {
    let inside = all(id.xy * clear.side < vec2u(clear.columns, clear.rows));
    let count = select(0u, clear.side * clear.side, inside);
    var any_empty = false;
    for (var i = 0u; i < not_baked(count); i++) {
        any_empty = any_empty || depths[place_of_cell(id.xy, i)] == 0u;
    }
    // A loop, since the software driver leaves one that none of its eight blocks needs, where it would run a branch.
    for (var k = 0u; k < not_baked(1u) && any_empty; k++) {
        let middle = (vec2f(id.xy) + 0.5) * f32(clear.side) + vec2f(view.cell_origin);
        let is_sky = is_clear(direction_of(middle * view.cell));
        for (var i = 0u; i < not_baked(count) && is_sky; i++) {
            let at = place_of_cell(id.xy, i);
            depths[at] = select(depths[at], CLEAR, depths[at] == 0u);
        }
    }
}

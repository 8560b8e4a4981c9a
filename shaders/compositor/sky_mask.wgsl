// Program of compositor/src/passes/sky_mask.rs: empty cells are marked as sky if the samples see past every point of
// their ray. One ray is tested for a block of cells: a surface that is in none of them is smaller than a block.

import package::shared::cells::SKY;
import package::shared::fetch::{direction_of, ray_is_sky, runtime_bound, view};

struct SkyMask {
    columns: u32,
    rows: u32,
    // Cells along the edge of a block.
    side: u32,
}

var<immediate> sky_mask: SkyMask;

@group(0) @binding(9) var<storage, read_write> depths: array<u32>;

// Index of a block's cell number i, clamped to the piece.
fn place_of_cell(block: vec2u, i: u32) -> u32 {
    let offset = vec2u(i % sky_mask.side, i / sky_mask.side);
    let cell = min(block * sky_mask.side + offset, vec2u(sky_mask.columns, sky_mask.rows) - 1u);
    return view.first_cell + cell.y * sky_mask.columns + cell.x;
}

@compute @workgroup_size(8, 8)
fn mask_block(@builtin(global_invocation_id) id: vec3u) {
    let inside = all(id.xy * sky_mask.side < vec2u(sky_mask.columns, sky_mask.rows));
    let count = select(0u, sky_mask.side * sky_mask.side, inside);
    var any_empty = false;
    for (var i = 0u; i < runtime_bound(count); i++) {
        any_empty = any_empty || depths[place_of_cell(id.xy, i)] == 0u;
    }
    // A loop in place of a branch. Quirk: both-sides.
    for (var k = 0u; k < runtime_bound(1u) && any_empty; k++) {
        let middle = (vec2f(id.xy) + 0.5) * f32(sky_mask.side) + vec2f(view.cell_origin);
        let is_sky = ray_is_sky(direction_of(middle * view.cell));
        for (var i = 0u; i < runtime_bound(count) && is_sky; i++) {
            let at = place_of_cell(id.xy, i);
            depths[at] = select(depths[at], SKY, depths[at] == 0u);
        }
    }
}

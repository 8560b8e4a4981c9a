// Program of compositor/src/passes/build_pyramid.rs: all levels of the pyramid of a sample's nearest surfaces. Level 0
// has the sample's texels. A cell of each further level has the greatest inverse range of four cells.

import package::shared::levels::{LEVELS, place_of_level};

struct BuildPyramid {
    layer: u32,
    // Size of the sample, texels.
    width: u32,
    height: u32,
}

var<immediate> pyramid: BuildPyramid;

@group(0) @binding(0) var inverse_range: texture_2d_array<f32>;
// All levels of a sample side by side: shared/levels.wgsl.
@group(0) @binding(1) var levels: texture_storage_2d_array<r32float, write>;

// Cells on a side of an invocation's block, and the levels that an invocation reduces alone.
const BLOCK: u32 = 8u;
const BLOCK_LEVELS: u32 = 3u;

var<private> block: array<f32, 64>;
var<workgroup> shared_cells: array<f32, 64>;

// Inverse range at a texel. 0 (no surface) unless its bits are those of a positive finite number. Quirk: folded-nan.
fn surface_at(at: vec2u) -> f32 {
    let last = vec2u(pyramid.width, pyramid.height) - 1u;
    let stored = textureLoad(inverse_range, min(at, last), pyramid.layer, 0).x;
    return select(0.0, stored, all(at <= last) && (bitcast<u32>(stored) - 1u) < 0x7f7fffffu);
}

fn store(level: u32, cell: vec2u, surface: f32) {
    let place = place_of_level(textureDimensions(levels), level) + cell;
    textureStore(levels, place, pyramid.layer, vec4f(surface, 0.0, 0.0, 0.0));
}

@compute @workgroup_size(8, 8)
fn build_tile(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_id) local: vec3u) {
    for (var i = 0u; i < BLOCK * BLOCK; i++) {
        let cell = id.xy * BLOCK + vec2u(i % BLOCK, i / BLOCK);
        block[i] = surface_at(cell);
        store(0u, cell, block[i]);
    }
    for (var level = 1u; level <= BLOCK_LEVELS; level++) {
        let side = BLOCK >> level;
        // In place: the four source cells lie at or after the result in row order.
        for (var i = 0u; i < side * side; i++) {
            let cell = vec2u(i % side, i / side);
            let first = 2u * cell.y * BLOCK + 2u * cell.x;
            let upper = max(block[first], block[first + 1u]);
            let lower = max(block[first + BLOCK], block[first + BLOCK + 1u]);
            block[cell.y * BLOCK + cell.x] = max(upper, lower);
            store(level, id.xy * side + cell, max(upper, lower));
        }
    }
    shared_cells[local.y * BLOCK + local.x] = block[0];
    for (var level = BLOCK_LEVELS + 1u; level < LEVELS; level++) {
        let side = BLOCK >> (level - BLOCK_LEVELS);
        let works = all(local.xy < vec2u(side));
        let first = select(0u, 2u * local.y * BLOCK + 2u * local.x, works);
        workgroupBarrier();
        let upper = max(shared_cells[first], shared_cells[first + 1u]);
        let lower = max(shared_cells[first + BLOCK], shared_cells[first + BLOCK + 1u]);
        workgroupBarrier();
        if works {
            shared_cells[local.y * BLOCK + local.x] = max(upper, lower);
            store(level, (id.xy / BLOCK) * side + local.xy, max(upper, lower));
        }
    }
}

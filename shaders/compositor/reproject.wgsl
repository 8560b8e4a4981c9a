// Program of compositor/src/passes/reproject.rs: pixels of an earlier frame leave their depth in the cells of the view that they
// fall into; the nearest stays. The coarse splat of a search that begins from that frame.

import package::shared::cells::cell_of;
import package::shared::cell_projection::{CellProjection, project_texel};

// Some pixels of an earlier frame, as one view sees them.
struct Reproject {
    projection: CellProjection,
    // Of the pixels that are looked at.
    columns: u32,
    rows: u32,
    // First of their words.
    first_word: u32,
    // Position in this plan's list of each sample of the earlier one, three bits each.
    sources: u32,
}

var<immediate> reproject: Reproject;

// Bits of the inverse range, the last three replaced by the sample that served the pixel: `History::words`.
@group(0) @binding(0) var<storage, read> words: array<u32>;
@group(0) @binding(1) var<storage, read_write> cells: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn reproject_pixel(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= reproject.columns || id.y >= reproject.rows {
        return;
    }
    let word = words[reproject.first_word + id.y * reproject.columns + id.x];
    let place = project_texel(reproject.projection, id.xy, bitcast<f32>(word & ~7u));
    if place.inside {
        let source = (reproject.sources >> (3u * (word & 7u))) & 7u;
        atomicMax(&cells[place.cell], cell_of(place.q, source));
    }
}

// Program of compositor/src/passes/reproject.rs: pixels of an earlier frame are projected into cells of the view. A cell
// keeps the nearest depth. A seeded search starts from it.

import package::shared::cells::cell_of;
import package::shared::cell_projection::{CellProjection, project_texel};

// Some pixels of an earlier frame, projected into one view.
struct Reproject {
    projection: CellProjection,
    // Number of the pixels.
    columns: u32,
    rows: u32,
    // Index of their first word.
    first_word: u32,
    // For each sample of the earlier plan its position in this plan's list, three bits each.
    sources: u32,
}

var<immediate> reproject: Reproject;

// Inverse range as f32 bits; the last three bits are the sample that served the pixel: `History::words`.
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

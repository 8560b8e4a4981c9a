// Program of compositor/src/passes/splat.rs: texels of a sample that lie in the view's frustum leave their
// depth in the cells of the view that they fall into; the nearest stays.

import package::shared::cells::cell_of;
import package::shared::landing::{Landing, landed};

// One face of one sample, as one view sees it.
struct Splat {
    landing: Landing,
    face_offset: vec2u,
    face_size: vec2u,
    layer: u32,
    first_block: u32,
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
    let place = landed(splat.landing, texel, stored);
    if place.inside && all(texel < splat.face_size) {
        atomicMax(&cells[place.cell], cell_of(place.q, splat.source));
    }
}

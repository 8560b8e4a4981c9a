// Program of compositor/src/passes/splat.rs: projects texels of a sample into cells of the view. A cell keeps the nearest
// depth.

import package::shared::cells::{cell_of, continues};
import package::shared::cell_projection::{CellProjection, direction_of_texel, project_texel, cell_hit, projected};

// One face of one sample, projected into one view.
struct Splat {
    projection: CellProjection,
    face_offset: vec2u,
    face_size: vec2u,
    layer: u32,
    first_block: u32,
    // Position of the sample in the plan's list.
    source: u32,
}

var<immediate> splat: Splat;

@group(0) @binding(0) var inverse_range: texture_2d_array<f32>;
// Blocks of 8x8 texels at a stride: column and row of the first texel in 14 bits each, stride in 4 bits.
@group(0) @binding(1) var<storage, read> blocks: array<u32>;
@group(0) @binding(2) var<storage, read_write> cells: array<atomic<u32>>;

// A texel of a block, and whether it lies in the face.
struct Texel {
    at: vec2u,
    stride: u32,
    inside: bool,
}

fn texel_of(group: u32, local: vec2u) -> Texel {
    let block = blocks[splat.first_block + group];
    let at = vec2u(block & 0x3fffu, (block >> 14u) & 0x3fffu) + local * (block >> 28u);
    return Texel(at, block >> 28u, all(at < splat.face_size));
}

// Splats texels that are as dense as cells: each writes one cell.
@compute @workgroup_size(8, 8)
fn splat_block(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let texel = texel_of(group.x, local.xy);
    let stored = textureLoad(inverse_range, splat.face_offset + texel.at, splat.layer, 0).x;
    let place = project_texel(splat.projection, texel.at, stored);
    if place.inside && texel.inside {
        atomicMax(&cells[place.cell], cell_of(place.q, splat.source));
    }
}

// Distance of a texel's points, in cells, if it has several; and the extent up to which one point is enough, because
// `fill.wgsl` fills gaps of one cell.
const APART: f32 = 1.4;
const CLOSED: f32 = 2.0;

// Most points along the edge of a texel. An eye closer by more than this factor sees through the surface.
const MOST: f32 = 32.0;

// Inverse depth of a texel; 0 outside the face.
fn inverse_depth_at(at: vec2i) -> f32 {
    let inside = all(at >= vec2i(0)) && all(at < vec2i(splat.face_size));
    let texel = vec2u(select(vec2i(0), at, inside));
    let stored = textureLoad(inverse_range, splat.face_offset + texel, splat.layer, 0).x;
    return select(0.0, stored * length(direction_of_texel(splat.projection, texel)), inside);
}

// A surface along one axis of the image, relative to a texel's centre.
struct Along {
    // Change of inverse depth from one texel to the next.
    slope: f32,
    // Its extent in texels: half way to each neighbour of the same surface, otherwise 0.
    begin: f32,
    end: f32,
}

// A surface continues to neighbours of nearly its inverse depth. The smaller of two slopes is used, because the larger
// may be an edge.
fn along(before: f32, own: f32, behind: f32) -> Along {
    let goes_before = continues(before, own);
    let goes_behind = continues(own, behind);
    let first = select(1e30, own - before, goes_before);
    let second = select(1e30, behind - own, goes_behind);
    let least = select(first, second, abs(second) < abs(first));
    let slope = select(0.0, least, goes_before || goes_behind);
    return Along(slope, select(0.0, -0.5, goes_before), select(0.0, 0.5, goes_behind));
}

// Number of points between two ends of a texel, given in homogeneous cell coordinates.
fn places_between(a: vec3f, b: vec3f) -> f32 {
    let apart = distance(a.xy / max(a.z, 1e-30), b.xy / max(b.z, 1e-30));
    // False if an end is behind the eye or not finite.
    let measured = a.z > 0.0 && b.z > 0.0 && apart < APART * MOST;
    return select(MOST, select(ceil(apart / APART), 1.0, apart <= CLOSED), measured);
}

// Position of point i of `count`, in texels from the centre.
fn offset_of(i: u32, count: f32, axis: Along) -> f32 {
    return select(mix(axis.begin, axis.end, (f32(i) + 0.5) / count), 0.0, count == 1.0);
}

// One bit for each side of the piece, and one for the eye's plane, that a projected point lies beyond.
fn sides_beyond(h: vec3f) -> u32 {
    let first = vec2f(f32(splat.projection.origin_column), f32(splat.projection.origin_row));
    let last = first + vec2f(f32(splat.projection.cell_columns), f32(splat.projection.cell_rows));
    let before = select(vec2u(0u), vec2u(1u, 2u), h.xy < first * h.z);
    let behind = select(vec2u(0u), vec2u(4u, 8u), h.xy > last * h.z);
    return before.x | before.y | behind.x | behind.y | select(0u, 16u, h.z <= 0.0);
}

// Splats texels that are farther apart than cells. Each is a rectangle of its surface's plane and writes all cells of it;
// otherwise the background would show between texels. It ends at the surface's edge.
@compute @workgroup_size(8, 8)
fn splat_squares(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let texel = texel_of(group.x, local.xy);
    let stride = i32(texel.stride);
    let at = vec2i(texel.at);
    let own = inverse_depth_at(at);
    let across = along(inverse_depth_at(at - vec2i(stride, 0)), own, inverse_depth_at(at + vec2i(stride, 0)));
    let down = along(inverse_depth_at(at - vec2i(0, stride)), own, inverse_depth_at(at + vec2i(0, stride)));
    let step = splat.projection.scale * f32(stride);
    let middle = projected(splat.projection, direction_of_texel(splat.projection, texel.at), own);
    let right = projected(splat.projection, vec3f(step.x, 0.0, 0.0), across.slope);
    let below = projected(splat.projection, vec3f(0.0, -step.y, 0.0), down.slope);
    let columns = places_between(middle + across.begin * right, middle + across.end * right);
    let rows = places_between(middle + down.begin * below, middle + down.end * below);
    let above = middle + down.begin * below;
    let under = middle + down.end * below;
    let beyond = sides_beyond(above + across.begin * right) & sides_beyond(above + across.end * right)
        & sides_beyond(under + across.begin * right) & sides_beyond(under + across.end * right);
    let count = select(0u, u32(columns * rows), own > 0.0 && beyond == 0u);
    for (var i = 0u; i < count; i++) {
        let x = offset_of(i % u32(columns), columns, across);
        let y = offset_of(i / u32(columns), rows, down);
        let place = cell_hit(splat.projection, middle + right * x + below * y, own + across.slope * x + down.slope * y);
        if place.inside {
            atomicMax(&cells[place.cell], cell_of(place.q, splat.source));
        }
    }
}

// Program of compositor/src/passes/second_pass.rs: pixels that the warp did not settle with its one sample are looked up in all
// samples. First at the depths splatted nearby. Then a pixel is sky if the samples see past every point of its ray. The
// others are searched linearly along the ray (cluster paper): other searches may return a nearby surface where no sample
// saw the pixel's own.
//
// Each step is a loop over the pixels that the previous one left, because eight or more pixels run together: all would
// wait for the one that needs a search of a hundred fetches (a quarter of this program's time).

import package::shared::cells::{Depth, depth_of, depth_of_cell};
import package::shared::fetch::{
    Fetch, SETTLED, crossing_of_bounds, direction_of, fetch_from, is_better, ray_is_sky, runtime_bound, nothing_at, position_of,
    view,
};
import package::shared::unsettled::{Segment, place_of, segment_of};
import package::shared::march::march;
import package::shared::pixel::{CERTAIN, OTHER_SAMPLE, Pixel, UNRESOLVED, sky_pixel, surface_pixel, unresolved_pixel};
import package::shared::targets::store_pixel;

@group(0) @binding(9) var<storage, read> depths: array<u32>;
@group(0) @binding(10) var<storage, read_write> unsettled: array<u32>;
@group(0) @binding(11) var<storage, read> cells: array<u32>;

// Steps of the linear search.
const STEPS_ALONG: u32 = 64u;

// The best fetch of all samples for one depth.
struct Found {
    fetch: Fetch,
    source: u32,
    // Some sample has the surface at its nearest texel, and no sample sees past it.
    settled: bool,
}

// Looks up a depth in all samples. A sample that sees past the point refutes all others: near a surface's edge the point
// may lie in empty space and yet be within tolerance of what another camera sees behind it.
fn look_up(d: vec3f, depth: Depth) -> Found {
    var best = nothing_at(depth.q);
    var source = 0u;
    var refuted = false;
    for (var i = 0u; i < runtime_bound(view.sample_count) && !refuted; i++) {
        let next = fetch_from(view.samples[i], d, depth.q);
        refuted = next.past >= SETTLED;
        if is_better(next, best) {
            best = next;
            source = i;
        }
    }
    // At depth 0 only sky agrees.
    return Found(best, source, depth.q > 0.0 && !refuted && best.agreement >= SETTLED);
}

// The farther of a depth and a cell before gaps were filled.
fn farther(a: Depth, at: i32) -> Depth {
    let b = depth_of_cell(cells[at]);
    let second = b.q > 0.0 && (a.q == 0.0 || b.q < a.q);
    return Depth(select(a.q, b.q, second), select(a.source, b.source, second));
}

fn direction_at(place: vec2u) -> vec3f {
    return direction_of(position_of(vec2f(place) + 0.5));
}

// Index of a pixel's cell.
fn cell_at(place: vec2u) -> i32 {
    let cell = vec2i(floor(position_of(vec2f(place) + 0.5) / view.cell)) - view.cell_origin;
    return i32(view.first_cell) + cell.y * view.cell_columns + cell.x;
}

fn pixel_of(found: Found, place: vec2u) -> Pixel {
    var pixel = surface_pixel(found.fetch, found.source, direction_at(place));
    let is_other = found.source != depth_of(depths[cell_at(place)]).source && pixel.source != UNRESOLVED;
    pixel.source += select(0u, OTHER_SAMPLE, is_other);
    return pixel;
}

// The fetch at depths splatted nearby.
fn near_cell(place: vec2u) -> Found {
    let d = direction_at(place);
    let at = cell_at(place);
    let columns = view.cell_columns;
    // Pieces have a ring of cells around those of their pixels.
    let was = depth_of_cell(cells[at]);
    let across = farther(farther(farther(was, at - 1), at + 1), at - columns);
    let above = farther(farther(farther(across, at + columns), at - columns - 1), at - columns + 1);
    let behind = farther(farther(above, at + columns - 1), at + columns + 1);
    // First the filled depth if it is a guess; otherwise the warp has tried it, and the farthest depth nearby is tried: a
    // cell keeps its nearest texel, but the pixel may lie beside that surface's edge. Then the cell's depth before
    // filling.
    let became = depth_of(depths[at]);
    let trial = became.q < 0.0;
    var found = look_up(d, Depth(select(behind.q, -became.q, trial), select(behind.source, became.source, trial)));
    // Here and below, loops replace branches. Quirk: both-sides.
    for (var k = 0u; k < runtime_bound(1u) && !found.settled && was.q > 0.0 && was.q != became.q && was.q != behind.q; k++) {
        found = look_up(d, was);
    }
    return found;
}

// A sky pixel. Some sample sees past each point of its ray; two may not.
fn clear_pixel(place: vec2u) -> Pixel {
    var pixel = sky_pixel(direction_at(place));
    pixel.confidence = CERTAIN >> 1u;
    return pixel;
}

fn along_ray(place: vec2u) -> Pixel {
    let d = direction_at(place);
    let end = march(d, crossing_of_bounds(view.bounds_min, view.bounds_max, d), STEPS_ALONG);
    let found = look_up(d, Depth(select(0.0, 1.0 / max(end.t, 1e-20), end.found), 0u));
    if found.settled {
        return pixel_of(found, place);
    }
    return unresolved_pixel(found.fetch, d);
}

// Keeps an unsettled pixel for the next loop, in the slot of a pixel that this loop has processed. Returns the number
// kept.
fn keep_unsettled(segment: Segment, left: u32, packed: u32, settled: bool) -> u32 {
    if !settled {
        unsettled[segment.first + left] = packed;
    }
    return left + select(1u, 0u, settled);
}

@compute @workgroup_size(64)
fn look_up_pixels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let segment = segment_of(id.x, groups.x * 64u);
    let count = unsettled[segment.counts];
    var left = 0u;
    for (var i = 0u; i < count; i++) {
        let packed = unsettled[segment.first + i];
        let found = near_cell(place_of(packed));
        left = keep_unsettled(segment, left, packed, found.settled);
        for (var k = 0u; k < runtime_bound(1u) && found.settled; k++) {
            store_pixel(place_of(packed), pixel_of(found, place_of(packed)));
        }
    }
    var open = 0u;
    for (var i = 0u; i < left; i++) {
        let packed = unsettled[segment.first + i];
        let clear = ray_is_sky(direction_at(place_of(packed)));
        open = keep_unsettled(segment, open, packed, clear);
        for (var k = 0u; k < runtime_bound(1u) && clear; k++) {
            store_pixel(place_of(packed), clear_pixel(place_of(packed)));
        }
    }
    for (var i = 0u; i < open; i++) {
        let place = place_of(unsettled[segment.first + i]);
        store_pixel(place, along_ray(place));
    }
}

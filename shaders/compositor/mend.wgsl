// Program of compositor/src/passes/mend.rs: pixels that the warp could not settle with the one sample that it looks
// at are tried in all of them; what none has is sky if they see past everything there, else unresolved.

import package::shared::cells::{Depth, depth_of, depth_of_cell};
import package::shared::fetch::{Fetch, SETTLED, ViewUniform, crossing_of_bounds, fetch_from, is_better, opinion_of, refined};
import package::shared::pixel::{
    Pixel, linear_of, shown, sky_pixel, surface_pixel, unresolved_pixel, with_specular,
};

// One a piece of the chunk.
@group(0) @binding(0) var<storage, read> views: array<ViewUniform>;
@group(0) @binding(9) var<storage, read> depths: array<u32>;
@group(0) @binding(10) var<storage, read> unsettled: array<u32>;
@group(0) @binding(11) var<storage, read> cells: array<vec2u>;
@group(0) @binding(12) var shown_target: texture_storage_2d<rgba8uint, write>;
@group(0) @binding(13) var linear_target: texture_storage_2d<rgba16float, write>;
@group(0) @binding(14) var range_target: texture_storage_2d<r32float, write>;

// Points at which a ray without a surface is checked to be clear.
const CHECKS: u32 = 8u;

// A pixel that is mended, and where it goes.
struct Mended {
    pixel: Pixel,
    place: vec2u,
    view: u32,
}

// The best of all samples at one depth.
struct Found {
    fetch: Fetch,
    source: u32,
    q: f32,
    // No sample sees past the point: it is not in empty space.
    solid: bool,
}

// Looks a surface of some sample up in all of them. One that sees past the point refutes the others, however well
// they agree: near the edge of a surface the point may be beside it and yet within tolerance of what another camera
// sees behind.
fn look_up(view: u32, d: vec3f, depth: Depth, omni: bool) -> Found {
    let s = views[view].samples[depth.source];
    let q = refined(s, views[view].forward, d, depth.q, omni);
    var best = Found(fetch_from(s, d, q, omni), depth.source, q, true);
    best.solid = best.fetch.past < SETTLED;
    for (var i = 0u; i < views[view].sample_count && best.solid; i++) {
        let next = fetch_from(views[view].samples[i], d, q, omni);
        best.solid = next.past < SETTLED;
        if is_better(next, best.fetch) {
            best = Found(next, i, q, best.solid);
        }
    }
    return best;
}

// The farthest surface in and around a cell, as it was before gaps were closed.
fn farthest_around(view: u32, at: i32) -> Depth {
    var farthest = Depth(0.0, 0u);
    for (var i = 0; i < 9; i++) {
        // A piece has cells around all that its pixels are in.
        let depth = depth_of_cell(cells[at + (i / 3 - 1) * views[view].cell_columns + i % 3 - 1]);
        if depth.q > 0.0 && (farthest.q == 0.0 || depth.q < farthest.q) {
            farthest = depth;
        }
    }
    return farthest;
}

// Whether at every point that is checked some sample looks past it.
fn is_clear(view: u32, d: vec3f, omni: bool) -> bool {
    let span = crossing_of_bounds(views[view].bounds_min, views[view].bounds_max, d);
    var clear = true;
    for (var k = 1u; k <= CHECKS && clear; k++) {
        clear = false;
        for (var i = 0u; i < views[view].sample_count && !clear; i++) {
            let t = mix(span.x, span.y, f32(k) / f32(CHECKS));
            clear = opinion_of(views[view].samples[i], d, t, omni).clear;
        }
    }
    return clear;
}

fn mend(slot: u32, omni: bool) -> Mended {
    let index = unsettled[2u * slot + 1u];
    let packed = unsettled[2u * slot + 2u];
    let place = vec2u(packed & 0xffffu, packed >> 16u);
    let position = vec2f(place) + 0.5 - views[index].target_origin + views[index].piece_origin;
    let d = views[index].corner + views[index].right * position.x + views[index].down * position.y;
    let cell = vec2i(floor(position / views[index].cell)) - views[index].cell_origin;
    let at = i32(views[index].first_cell) + cell.y * views[index].cell_columns + cell.x;
    // First what the cell became; then what lies behind, for a cell takes the nearest of its texels although the pixel
    // may be beside that surface's edge; then what it was before its neighbours' surface was drawn over it.
    let became = depth_of(depths[at]);
    let was = depth_of_cell(cells[at]);
    let behind = farthest_around(index, at);
    var found = Found(Fetch(vec2f(0.0), 0u, 0.0, 0.0, false), 0u, 0.0, false);
    var settled = false;
    for (var k = 0u; k < 3u && !settled; k++) {
        let q = select(select(was.q, behind.q, k == 1u), abs(became.q), k == 0u);
        let source = select(select(was.source, behind.source, k == 1u), became.source, k == 0u);
        if q > 0.0 {
            found = look_up(index, d, Depth(q, source), omni);
            settled = found.solid && found.fetch.agreement >= SETTLED;
        }
    }
    if settled {
        return Mended(surface_pixel(found.fetch, found.source, d, found.q), place, index);
    }
    if is_clear(index, d, omni) {
        return Mended(sky_pixel(views[index].lighting, d), place, index);
    }
    for (var i = 0u; i < views[index].sample_count && !found.fetch.inside; i++) {
        found.fetch = fetch_from(views[index].samples[i], d, 0.0, omni);
    }
    return Mended(unresolved_pixel(views[index].lighting, found.fetch, d), place, index);
}

fn glossy(mended: Mended) -> Mended {
    let view = mended.view;
    return Mended(
        with_specular(mended.pixel, views[view].lighting, views[view].first_light), mended.place, view,
    );
}

fn show(mended: Mended) {
    let result = shown(mended.pixel, views[mended.view].lighting.exposure);
    textureStore(shown_target, mended.place, result.color);
    textureStore(range_target, mended.place, vec4f(result.range, 0.0, 0.0, 0.0));
}

fn keep(mended: Mended) {
    let result = linear_of(mended.pixel);
    textureStore(linear_target, mended.place, result.radiance);
    textureStore(range_target, mended.place, vec4f(result.range, 0.0, 0.0, 0.0));
}

// The slots of one invocation: a fixed number of workgroups share the list, however long it became.
fn slots() -> u32 {
    return min(unsettled[0], (arrayLength(&unsettled) - 1u) / 2u);
}

@compute @workgroup_size(64)
fn show_pinhole(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        show(mend(slot, false));
    }
}

@compute @workgroup_size(64)
fn show_pinhole_glossy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        show(glossy(mend(slot, false)));
    }
}

@compute @workgroup_size(64)
fn show_omni(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        show(mend(slot, true));
    }
}

@compute @workgroup_size(64)
fn show_omni_glossy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        show(glossy(mend(slot, true)));
    }
}

@compute @workgroup_size(64)
fn keep_pinhole(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        keep(mend(slot, false));
    }
}

@compute @workgroup_size(64)
fn keep_pinhole_glossy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        keep(glossy(mend(slot, false)));
    }
}

@compute @workgroup_size(64)
fn keep_omni(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        keep(mend(slot, true));
    }
}

@compute @workgroup_size(64)
fn keep_omni_glossy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var slot = id.x; slot < slots(); slot += groups.x * 64u) {
        keep(glossy(mend(slot, true)));
    }
}

// Program of compositor/src/passes/linear.rs: the cluster paper's search (section 4.2). A view ray is followed
// in equal steps through the scene's bounds until it is behind the surface of every camera that looks there;
// bisection then finds where it went in.

import package::shared::fetch::{
    Fetch, Opinions, POINTS, TRACE, crossing_of_bounds, fetch_from, is_better, not_baked, opinions_of, view,
};
import package::shared::pixel::{
    CERTAIN, Linear, Pixel, Shown, corner_of_target, linear_of, shown, sky_pixel, surface_pixel, unresolved_pixel,
};
import package::shared::targets::{place_of_twin, store_linear, store_shown};

// Parts that the last step is divided into: 64 steps place a surface to within 1/512 of the bounds, and the fetch brings it
// closer yet.
const PARTS: f32 = 8.0;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

// Whether any sample looks at, or past, each of POINTS points.
fn opinions_at(d: vec3f, start: f32, step: f32) -> Opinions {
    var all = Opinions(0u, 0u);
    for (var i = 0u; i < not_baked(view.sample_count); i++) {
        let one = opinions_of(view.samples[i], d, start, step);
        all = Opinions(all.seen | one.seen, all.clear | one.clear);
    }
    return all;
}

fn pixel(at: vec2f) -> Pixel {
    let position = at - view.target_origin + view.piece_origin;
    let d = view.corner + view.right * position.x + view.down * position.y;
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let step = (span.y - span.x) / f32(view.steps);
    var outside = span.x;
    var found = false;
    // The sky is seen unless the ray passes a place that no sample looks at.
    var clear = true;
    for (var k = 0u; k < not_baked(view.steps) && !found && span.x < span.y; k += POINTS) {
        let all = opinions_at(d, span.x + step * f32(k), step);
        // Steps beyond the last are not taken.
        let taken = (1u << min(POINTS, view.steps - k)) - 1u;
        let inside = all.seen & ~all.clear & taken;
        found = inside != 0u;
        let free = select(countOneBits(taken), firstTrailingBit(inside), found);
        outside = span.x + step * f32(k + free);
        clear = clear && (~all.seen & ((1u << free) - 1u)) == 0u;
    }
    // The paper halves; eight points at once find the same eighth as three halvings, at the price of two.
    if found {
        let all = opinions_at(d, outside, step / PARTS);
        outside += step / PARTS * f32(min(firstTrailingBit(all.seen & ~all.clear), POINTS - 1u));
    }
    // The side on which all cameras are: the most conservative surface.
    let q = 1.0 / max(outside, 1e-20);
    var best = Fetch(vec2f(0.0), 0u, 0.0, 0.0, 0.0, 1.0, false);
    var source = 0u;
    for (var i = 0u; i < not_baked(view.sample_count); i++) {
        let next = fetch_from(view.samples[i], d, q);
        if is_better(next, best) {
            best = next;
            source = i;
        }
    }
    if found && best.agreement > TRACE {
        return surface_pixel(best, source, d);
    }
    if clear && !found {
        var pixel = sky_pixel(d);
        pixel.confidence = select(CERTAIN, CERTAIN >> 1u, span.x < span.y);
        return pixel;
    }
    return unresolved_pixel(best, d);
}

@fragment
fn show(@builtin(position) at: vec4f) -> Shown {
    return shown(pixel(at.xy));
}

@fragment
fn keep(@builtin(position) at: vec4f) -> Linear {
    return linear_of(pixel(at.xy));
}

@compute @workgroup_size(8, 8)
fn show_twin(@builtin(global_invocation_id) id: vec3u) {
    let place = place_of_twin(id.xy);
    if place.inside {
        store_shown(place.texel, pixel(place.at));
    }
}

@compute @workgroup_size(8, 8)
fn keep_twin(@builtin(global_invocation_id) id: vec3u) {
    let place = place_of_twin(id.xy);
    if place.inside {
        store_linear(place.texel, pixel(place.at));
    }
}

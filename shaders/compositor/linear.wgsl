// Program of compositor/src/passes/linear.rs: the cluster paper's search (section 4.2). A view ray is followed
// in equal steps through the scene's bounds until it is behind the surface of every camera that looks there;
// bisection then finds where it went in.

import package::shared::fetch::{Fetch, TRACE, Opinion, crossing_of_bounds, fetch_from, is_better, not_baked, opinion_of, view};
import package::shared::pixel::{
    Linear, Pixel, Shown, corner_of_target, linear_of, shown, sky_pixel, surface_pixel, unresolved_pixel, with_specular,
};


// Halvings of the last step: 64 steps and 8 halvings place a surface to within 1/16384 of the bounds.
const HALVINGS: u32 = 8u;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

// All samples' opinion of a point: seen by any, clear if any looks past it.
fn opinion_at(d: vec3f, t: f32, omni: bool) -> Opinion {
    var all = Opinion(false, false);
    // Not the bare uniform, see `with_specular`; t is never negative.
    let count = view.sample_count + u32(t < 0.0);
    for (var i = 0u; i < count; i++) {
        let one = opinion_of(view.samples[i], d, t, omni);
        all = Opinion(all.seen || one.seen, all.clear || one.clear);
    }
    return all;
}

fn pixel(at: vec4f, omni: bool) -> Pixel {
    let position = at.xy - view.target_origin + view.piece_origin;
    let d = view.corner + view.right * position.x + view.down * position.y;
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let step = (span.y - span.x) / f32(view.steps);
    var outside = span.x;
    var inside = 0.0;
    // The sky is seen unless the ray passes a place that no sample looks at.
    var clear = true;
    // Not the bare uniforms, see `with_specular`; there is no pixel left of the first.
    let steps = view.steps + u32(at.x < 0.0);
    let count = view.sample_count + u32(at.x < 0.0);
    for (var k = 1u; k <= steps && inside == 0.0 && span.x < span.y; k++) {
        let t = span.x + step * f32(k);
        let opinion = opinion_at(d, t, omni);
        clear = clear && opinion.seen;
        if opinion.seen && !opinion.clear {
            inside = t;
        } else {
            outside = t;
        }
    }
    let found = inside > 0.0;
    for (var k = 0u; k < HALVINGS && found; k++) {
        let t = 0.5 * (outside + inside);
        let opinion = opinion_at(d, t, omni);
        if opinion.seen && !opinion.clear {
            inside = t;
        } else {
            outside = t;
        }
    }
    // The side on which all cameras are: the most conservative surface.
    let q = 1.0 / max(outside, 1e-20);
    var best = Fetch(vec2f(0.0), 0u, 0.0, 0.0, 0.0, false);
    var source = 0u;
    for (var i = 0u; i < count; i++) {
        let next = fetch_from(view.samples[i], d, q, omni);
        if is_better(next, best) {
            best = next;
            source = i;
        }
    }
    if found && best.agreement > TRACE {
        return surface_pixel(best, source, d);
    }
    if clear && !found {
        return sky_pixel(d);
    }
    return unresolved_pixel(best, d);
}

@fragment
fn show_pinhole(@builtin(position) at: vec4f) -> Shown {
    return shown(pixel(at, false));
}

@fragment
fn show_pinhole_glossy(@builtin(position) at: vec4f) -> Shown {
    return shown(with_specular(pixel(at, false)));
}

@fragment
fn show_omni(@builtin(position) at: vec4f) -> Shown {
    return shown(pixel(at, true));
}

@fragment
fn show_omni_glossy(@builtin(position) at: vec4f) -> Shown {
    return shown(with_specular(pixel(at, true)));
}

@fragment
fn keep_pinhole(@builtin(position) at: vec4f) -> Linear {
    return linear_of(pixel(at, false));
}

@fragment
fn keep_pinhole_glossy(@builtin(position) at: vec4f) -> Linear {
    return linear_of(with_specular(pixel(at, false)));
}

@fragment
fn keep_omni(@builtin(position) at: vec4f) -> Linear {
    return linear_of(pixel(at, true));
}

@fragment
fn keep_omni_glossy(@builtin(position) at: vec4f) -> Linear {
    return linear_of(with_specular(pixel(at, true)));
}

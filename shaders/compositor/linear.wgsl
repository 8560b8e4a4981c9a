// Program of compositor/src/passes/linear.rs: the cluster paper's search (section 4.2). A view ray is followed
// in equal steps through the scene's bounds until it is behind the surface of every camera that looks there;
// bisection then finds where it went in.

import package::shared::fetch::{view};
import package::shared::pixel::{
    Linear, Pixel, Shown, corner_of_target, crossing_of_bounds, direction_at, image_position, linear_of, opinion_at, pixel_at, shown, with_specular,
};

// Halvings of the last step: 64 steps and 8 halvings place a surface to within 1/16384 of the bounds.
const HALVINGS: u32 = 8u;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

fn pixel(fragment: vec4f, omni: bool) -> Pixel {
    let d = direction_at(image_position(fragment));
    let span = crossing_of_bounds(d);
    let step = (span.y - span.x) / f32(view.steps);
    var outside = span.x;
    var inside = 0.0;
    // Clear: the sky is seen unless the ray passes a place that no sample looks at.
    var clear = true;
    for (var k = 1u; k <= view.steps && inside == 0.0 && span.x < span.y; k++) {
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
    let q = select(0.0, 1.0 / max(outside, 1e-20), found);
    return pixel_at(d, q, clear && !found, omni);
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

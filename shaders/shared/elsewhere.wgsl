// A pixel that the one sample which was expected to have it has not: where the other samples have it.

import package::shared::fetch::not_baked;
import package::shared::fixed_point::{limits_of, settle_in_any};
import package::shared::march::march;
import package::shared::pixel::{OTHER, Pixel, surface_pixel};
import package::shared::ray_end::{RayEnd, pixel_at_end};

// Steps of the linear search.
const TAIL: u32 = 8u;

// Any sample that so many steps from inverse depth `start` lead to a surface in; then a linear search, and from where it ends
// every sample once more. `source` is the one that was expected to have it.
fn pixel_elsewhere(d: vec3f, span: vec2f, start: f32, source: u32, steps: u32) -> Pixel {
    let limits = limits_of(span);
    var other = settle_in_any(d, start, limits, steps);
    var end = RayEnd(span.y, false, true);
    for (var k = 0u; k < not_baked(1u) && !other.found; k++) {
        end = march(d, span, TAIL);
        if end.found {
            other = settle_in_any(d, 1.0 / max(end.t, 1e-20), limits, steps);
        }
    }
    if other.found && span.x < span.y {
        var pixel = surface_pixel(other.fetch, other.source, d);
        pixel.source += select(0u, OTHER, other.source != source);
        return pixel;
    }
    return pixel_at_end(d, span, end);
}

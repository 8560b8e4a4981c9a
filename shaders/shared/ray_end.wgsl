// What searches that follow a view ray end in: the colour of the surface that they found, from the sample that has it best.

import package::shared::fetch::{MIN_AGREEMENT, fetch_from, is_better, runtime_bound, nothing_at, view};
import package::shared::pixel::{CERTAIN, Pixel, sky_pixel, surface_pixel, unresolved_pixel};

// Where following a ray ended.
struct RayEnd {
    // Depth.
    t: f32,
    // Every camera that looks there is at or behind a surface: the most conservative one, as the cluster paper has it.
    found: bool,
    // Up to there, some camera sees past every point.
    clear: bool,
}

// The pixel in direction d, whose ray was followed between two depths.
fn pixel_at_end(d: vec3f, span: vec2f, end: RayEnd) -> Pixel {
    let q = 1.0 / max(end.t, 1e-20);
    var best = nothing_at(0.0);
    var source = 0u;
    for (var i = 0u; i < runtime_bound(view.sample_count); i++) {
        let next = fetch_from(view.samples[i], d, q);
        if is_better(next, best) {
            best = next;
            source = i;
        }
    }
    if end.found && best.agreement > MIN_AGREEMENT {
        return surface_pixel(best, source, d);
    }
    if end.clear && !end.found {
        // Each point is seen past by some sample, not by two, unless there is none.
        var pixel = sky_pixel(d);
        pixel.confidence = select(CERTAIN, CERTAIN >> 1u, span.x < span.y);
        return pixel;
    }
    return unresolved_pixel(best, d);
}

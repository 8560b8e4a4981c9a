// The end of searches along a view ray: the colour of the surface, from the sample with the best fetch.

import package::shared::fetch::{MIN_AGREEMENT, fetch_from, is_better, runtime_bound, nothing_at, view};
import package::shared::pixel::{CERTAIN, Pixel, sky_pixel, surface_pixel, unresolved_pixel};

// The end of a ray.
struct RayEnd {
    // Depth.
    t: f32,
    // Every camera that looks there sees a surface at or before this depth: the most conservative surface (cluster
    // paper).
    found: bool,
    // Some camera sees past every point up to this depth.
    clear: bool,
}

// The pixel in direction d whose ray was followed between two depths.
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
        // Some sample sees past each point; two may not. A ray that misses the bounds is certain.
        var pixel = sky_pixel(d);
        pixel.confidence = select(CERTAIN, CERTAIN >> 1u, span.x < span.y);
        return pixel;
    }
    return unresolved_pixel(best, d);
}

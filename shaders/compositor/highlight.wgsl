// Program of compositor/src/passes/highlight.rs: glossy pixels that the warp settled, with view-dependent reflection.

import package::shared::cells::depth_of;
import package::shared::fetch::{bilinear, direction_of, fetch_from, position_of, radiance, view};
import package::shared::finite::finite_or_zero;
import package::shared::unsettled::{place_of, segment_of};
import package::shared::pixel::{Pixel, confidence_of, confident, within_face};
import package::shared::targets::store_pixel;

@group(0) @binding(9) var<storage, read> depths: array<u32>;
@group(0) @binding(10) var<storage, read> unsettled: array<u32>;

// The pixel as the warp finds it, with radiance in place of its display colour.
fn highlight(place: vec2u) -> Pixel {
    let position = position_of(vec2f(place) + 0.5);
    let d = direction_of(position);
    let cell = vec2i(floor(position / view.cell)) - view.cell_origin;
    let depth = depth_of(depths[view.first_cell + u32(cell.y * view.cell_columns + cell.x)]);
    let fetched = fetch_from(view.samples[depth.source], d, depth.q);
    let uv = within_face(fetched.uv, fetched.level);
    let texel = textureSampleLevel(radiance, bilinear, uv, fetched.layer, fetched.level).rgb;
    let surface = d / max(fetched.q, 1e-30);
    var confidence = 0u;
    if confident {
        confidence = confidence_of(fetched, depth.source, d);
    }
    let source = depth.source + 1u;
    let range = length(surface);
    return Pixel(finite_or_zero(texel), source, confidence, range, surface, fetched.uv, fetched.layer, false);
}

@compute @workgroup_size(64)
fn add_highlights(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let segment = segment_of(id.x, groups.x * 64u);
    for (var i = 0u; i < unsettled[segment.counts + 1u]; i++) {
        let place = place_of(unsettled[segment.first + segment.length - 1u - i]);
        store_pixel(place, highlight(place));
    }
}

// Program of compositor/src/search_pipelines.rs: a pixel has the depth of its cell, and the colour of the sample that splatted
// it. Pixels that this does not settle are marked for `second_pass.wgsl`.
//
// This program has no loop, no list and no rare case. Quirk: both-sides.

import package::shared::cells::{SKY, depth_of};
import package::shared::fetch::{
    SETTLED, bilinear, direction_of, fetch_from, inverse_range, position_of, radiance, view,
};
import package::shared::finite::finite_or_zero;
import package::shared::pixel::{
    CERTAIN, HIGHLIGHT, UNRESOLVED, UNSETTLED, Pixel, confidence_of, confident, encoded, glossy, linear, within_face,
};
import package::shared::shading::sky_radiance;

// Factor by which the level of the display plane is coarser than that of radiance. Averages in sRGB give dark texels less
// weight, so stripes alias more.
const COARSER: f32 = 1.08;

// Interpolates between two mip levels; otherwise all pixels use the finer one.
override between_levels: bool = false;

// The level of the display plane whose texels are no larger than most of the view's pixels, and the next coarser level.
@group(0) @binding(5) var display: texture_2d_array<f32>;
@group(0) @binding(11) var coarser: texture_2d_array<f32>;
@group(0) @binding(9) var<storage, read> depths: array<u32>;

fn pixel(at: vec2f) -> Pixel {
    let position = position_of(at);
    let d = direction_of(position);
    let cell = vec2i(floor(position / view.cell)) - view.cell_origin;
    let bits = depths[view.first_cell + u32(cell.y * view.cell_columns + cell.x)];
    let depth = depth_of(bits);
    let fetched = fetch_from(view.samples[depth.source], d, depth.q);
    let finer = round(log2(f32(textureDimensions(inverse_range).x) / f32(textureDimensions(display).x)));
    var shown = textureSampleLevel(display, bilinear, within_face(fetched.uv, finer), fetched.layer, 0.0);
    if between_levels {
        // Two textures, because a level that varies by pixel costs three times as much.
        let texel = textureSampleLevel(coarser, bilinear, within_face(fetched.uv, finer + 1.0), fetched.layer, 0.0);
        shown = mix(shown, texel, clamp(fetched.level * COARSER - finer, 0.0, 1.0));
    }
    let sky = sky_radiance(view.lighting, normalize(d));
    let clear = bits == SKY;
    var color = select(shown.rgb, encoded(sky * view.lighting.exposure), clear);
    if linear {
        let uv = within_face(fetched.uv, fetched.level);
        color = select(finite_or_zero(textureSampleLevel(radiance, bilinear, uv, fetched.layer, fetched.level).rgb), sky, clear);
    }
    var confidence = 0u;
    if confident {
        confidence = confidence_of(fetched, depth.source, d);
    }
    // Some sample sees past each point of the ray; two may not.
    confidence = select(confidence, CERTAIN >> 1u, clear);
    let settled = depth.q > 0.0 && fetched.agreement >= SETTLED;
    let lit = select(depth.source + 1u, HIGHLIGHT, glossy && shown.a > 0.0);
    // Further samples are seldom finer, because the first of the plan are the best.
    let seen = select(UNRESOLVED, lit, fetched.fine);
    let source = select(select(UNSETTLED, seen, settled), 0u, clear);
    confidence = select(confidence, 0u, source == UNRESOLVED);
    let surface = d / max(fetched.q, 1e-30);
    let range = select(length(surface), 0.0, clear || source == UNRESOLVED);
    return Pixel(color, source, confidence, range, surface, fetched.uv, fetched.layer, true);
}

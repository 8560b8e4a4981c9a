// Program of compositor/src/passes/warp.rs: each pixel takes the depth that was splatted for its cell, and the
// colour that the sample which splatted it has there. What that does not settle is marked, and left to `mend.wgsl`.
//
// There is no loop, no list and no rare case here on purpose. The software driver runs both sides of every branch, keeps what
// a loop touches in memory and sets all of it to zero for every eight pixels, whether the loop is entered or not: a highlight
// that no pixel had cost 0.95 ms a view of 200x150, a list of what is left over 0.3, of 1.9 in all.

import package::shared::cells::{SKY, depth_of};
import package::shared::fetch::{
    SETTLED, bilinear, direction_of, fetch_from, inverse_range, position_of, radiance, view,
};
import package::shared::finite::finite_or_zero;
import package::shared::pixel::{
    CERTAIN, HIGHLIGHT, UNSETTLED, Pixel, confidence_of, confident, encoded, glossy, linear, within_face,
};
import package::shared::shading::sky_radiance;

// Share of its level by which what is averaged in sRGB is looked up coarser than what is averaged in linear radiance: a dark
// texel beside a bright one weighs less there, so that stripes alias more.
const COARSER: f32 = 1.08;

// Pixels of the view are of a size between two levels' texels; else the finer of them serves all.
override between_levels: bool = false;

// A level of the display plane whose texels are no larger than most of the view's pixels, and the next coarser one.
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
        // A level of the texture would be a number a pixel, at three times the price.
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
    // Each point of the sky is seen past by some sample, not by two.
    confidence = select(confidence, CERTAIN >> 1u, clear);
    let settled = depth.q > 0.0 && fetched.agreement >= SETTLED;
    let lit = select(depth.source + 1u, HIGHLIGHT, glossy && shown.a > 0.0);
    let source = select(select(UNSETTLED, lit, settled), 0u, clear);
    let surface = d / max(fetched.q, 1e-30);
    let range = select(length(surface), 0.0, clear);
    return Pixel(color, source, confidence, range, surface, fetched.uv, fetched.layer, true);
}

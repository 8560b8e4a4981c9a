// What a view's pixel shows, once a search has said where its surface is: shared by both searches.

import package::shared::encode::{srgb_from_linear, unit_from_octahedral};
import package::shared::fetch::{AGREEMENT, bilinear, fetch_at, inverse_range, nearest, radiance, seen_by_sample, view};
import package::shared::finite::finite_or_zero;
import package::shared::shading::{Light, Lighting, Surface, sky_radiance, specular_light, specular_sky};

@group(0) @binding(5) var<uniform> lighting: Lighting;
@group(0) @binding(6) var normal_plane: texture_2d_array<f32>;
@group(0) @binding(7) var specular_plane: texture_2d_array<f32>;
@group(0) @binding(8) var<storage, read> lights: array<Light>;

// A corner-to-corner triangle over the viewport.
fn corner_of_target(index: u32) -> vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// Position in the whole image, in pixels, of a fragment's.
fn image_position(fragment: vec4f) -> vec2f {
    return fragment.xy - view.target_origin + view.piece_origin;
}

// Direction of an image position, at depth 1.
fn direction_at(position: vec2f) -> vec3f {
    return view.corner + view.right * position.x + view.down * position.y;
}

// Depths at which a direction enters and leaves the scene's bounds, the entry at least 0; entry >= exit where it
// misses them.
fn crossing_of_bounds(d: vec3f) -> vec2f {
    // A component of 0 is parallel to its planes: nearly so has the same crossing, without an infinity.
    let steep = select(d, vec3f(1e-20), abs(d) < vec3f(1e-20));
    let a = view.bounds_min / steep;
    let b = view.bounds_max / steep;
    let first = min(a, b);
    let last = max(a, b);
    return vec2f(max(max(first.x, first.y), max(first.z, 0.0)), min(last.x, min(last.y, last.z)));
}

// What the samples say of a point at depth t in direction d.
struct Opinion {
    // Some sample looks there.
    seen: bool,
    // Some sample looks past it.
    clear: bool,
}

fn opinion_at(d: vec3f, t: f32, omni: bool) -> Opinion {
    var result = Opinion(false, false);
    for (var i = 0u; i < view.sample_count; i++) {
        let ray = d * t + view.samples[i].eye_from_center;
        let seen = seen_by_sample(i, ray, omni);
        let stored = textureSampleLevel(inverse_range, nearest, seen.uv, view.samples[i].layer, 0.0).x;
        let expected = inverseSqrt(max(dot(ray, ray), 1e-30));
        result.seen = result.seen || seen.inside;
        result.clear = result.clear || (seen.inside && stored < expected);
    }
    return result;
}

struct Pixel {
    radiance: vec3f,
    // 1 + position of the sample in the plan's list, 0 for the sky, 255 where no sample saw the pixel.
    source: u32,
    // Metres from the eye; 0 where there is nothing.
    range: f32,
    // Where the surface is, relative to the eye, and where its sample has it.
    position: vec3f,
    uv: vec2f,
    layer: u32,
}

const UNRESOLVED: u32 = 255u;

// The pixel in direction d (depth 1) whose search ended at inverse depth q, or with q = 0 at no surface; `clear`
// says that the samples see through to the sky.
//
// A pixel that no sample saw shows what lies farthest where the first sample looks: background goes on behind
// the edge that hid it, so the guess is seldom the wrong side's. It is marked, and has no range.
fn pixel_at(d: vec3f, q: f32, clear: bool, omni: bool) -> Pixel {
    let fetched = fetch_at(d, q, omni);
    let resolved = q > 0.0 && fetched.agreement > 0.0;
    var pixel = Pixel(sky_radiance(lighting, normalize(d)), 0u, 0.0, vec3f(0.0), fetched.uv, fetched.layer);
    if resolved || (!clear && fetched.source < view.sample_count) {
        let texel = textureSampleLevel(radiance, bilinear, fetched.uv, fetched.layer, 0.0).rgb;
        pixel.radiance = finite_or_zero(texel);
    }
    if resolved {
        pixel.source = fetched.source + 1u;
        pixel.position = d / q;
        pixel.range = length(pixel.position);
    } else if !clear {
        pixel.source = UNRESOLVED;
    }
    return pixel;
}

// The pixel with the highlight that its viewer, and not the sample, sees.
fn with_specular(pixel: Pixel) -> Pixel {
    let stored = textureSampleLevel(specular_plane, bilinear, pixel.uv, pixel.layer, 0.0);
    let encoded = textureSampleLevel(normal_plane, nearest, pixel.uv, pixel.layer, 0.0).xy;
    var result = pixel;
    if pixel.range > 0.0 && any(stored.rgb > vec3f(0.0)) {
        let to_eye = -pixel.position / pixel.range;
        let surface = Surface(
            pixel.position, unit_from_octahedral(encoded), vec3f(0.0), vec3f(0.0), stored.rgb, stored.a,
        );
        var sum = specular_sky(surface, to_eye, lighting);
        for (var i = 0u; i < lighting.light_count; i++) {
            sum += specular_light(surface, to_eye, lights[view.first_light + i]);
        }
        result.radiance += finite_or_zero(sum);
    }
    return result;
}

// A pixel as it is shown: sRGB and the source, each a byte.
struct Shown {
    @location(0) color: vec4u,
    @location(1) range: f32,
}

fn shown(pixel: Pixel) -> Shown {
    let color = floor(srgb_from_linear(pixel.radiance * lighting.exposure) * 255.0 + 0.5);
    return Shown(vec4u(vec3u(color), pixel.source), pixel.range);
}

// A pixel that is still to be averaged with others: linear radiance and the source.
struct Linear {
    @location(0) radiance: vec4f,
    @location(1) range: f32,
}

fn linear_of(pixel: Pixel) -> Linear {
    // The target holds halves: beyond their largest a highlight would turn into an infinity.
    return Linear(vec4f(min(pixel.radiance, vec3f(65504.0)), f32(pixel.source)), pixel.range);
}

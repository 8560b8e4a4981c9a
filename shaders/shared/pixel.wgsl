// What a view's pixel shows once its surface is found: shared by all searches.

import package::shared::encode::unit_from_octahedral;
import package::shared::fetch::{Fetch, SETTLED, bilinear, fetch_from, nearest, runtime_bound, omni, radiance, view};
import package::shared::finite::finite_or_zero;
import package::shared::shading::{Light, Surface, sky_radiance, specular_light, specular_sky};
import package::shared::reflection_probes::{probe_in_word, reflected_radiance, transmitted_in_word};

// The samples carry what specular needs. Where they do not, these two planes are any others, and not looked at.
override glossy: bool = false;

// They say which map of surroundings their surfaces look up. Where they do not, the plane is any other.
override reflects: bool = false;

// The view asks for how sure its pixels are. Else no sample is looked up for it.
override confident: bool = false;

// Pixels are wanted as linear radiance: they are still to be averaged.
override linear: bool = false;

@group(0) @binding(6) var normal_plane: texture_2d_array<f32>;
@group(0) @binding(7) var specular_plane: texture_2d_array<f32>;
@group(0) @binding(8) var<storage, read> lights: array<Light>;
@group(2) @binding(4) var reflector_plane: texture_2d_array<u32>;

// A corner-to-corner triangle over the viewport.
fn corner_of_target(index: u32) -> vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

struct Pixel {
    radiance: vec3f,
    // 1 + position of the sample in the plan's list, 0 for the sky, UNRESOLVED where no sample saw the pixel.
    source: u32,
    // As `Output::Confidence` defines it.
    confidence: u32,
    // Metres from the eye; 0 where there is nothing.
    range: f32,
    // Where the surface is, relative to the eye, and where its sample has it.
    position: vec3f,
    uv: vec2f,
    layer: u32,
    // Its radiance is as the target has it: lit, and unless targets are linear exposed and in sRGB, 0..1.
    is_final: bool,
}

const UNRESOLVED: u32 = 255u;

// Marks of pixels that the warp leaves to others, in place of a source: one sample at the splatted depth did not settle it;
// it is settled but for what its viewer alone sees.
const UNSETTLED: u32 = 254u;
const HIGHLIGHT: u32 = 253u;

// Added to the source where another sample serves the pixel than the one whose texel gave it its depth.
const OTHER_SAMPLE: u32 = 64u;

// Of a pixel that is certain: no residual, and a second sample (or the bounds of the scene) says so too.
const CERTAIN: u32 = 255u;

// How sure it is that sample number `index` has the surface of the pixel in direction d.
fn confidence_of(fetched: Fetch, index: u32, d: vec3f) -> u32 {
    // 0 is kept for what no sample saw.
    let match_of_depth = max(u32(127.0 * (1.0 - fetched.residual) + 0.5), 1u);
    var seconded = false;
    for (var i = 0u; i < runtime_bound(view.sample_count) && !seconded; i++) {
        let other = fetch_from(view.samples[i], d, fetched.q);
        seconded = i != index && other.agreement >= SETTLED;
    }
    return match_of_depth | select(0u, 128u, seconded);
}

fn sky_pixel(d: vec3f) -> Pixel {
    return Pixel(sky_radiance(view.lighting, normalize(d)), 0u, CERTAIN, 0.0, vec3f(0.0), vec2f(0.0), 0u, false);
}

// Texture coordinates at which a fetch from a coarser level stays on the face of a cube that it is about: a face's ring is
// one texel of the finest level.
fn within_face(uv: vec2f, level: f32) -> vec2f {
    if !omni {
        return uv;
    }
    let faces = vec2f(3.0, 2.0);
    let face = clamp(floor(uv * faces), vec2f(0.0), faces - 1.0);
    let half_texel = 0.5 * exp2(ceil(level)) * faces / vec2f(textureDimensions(radiance));
    return (face + clamp(uv * faces - face, half_texel, 1.0 - half_texel)) / faces;
}

// The pixel in direction d (depth 1) whose surface was found in sample number `index`.
fn surface_pixel(fetched: Fetch, index: u32, d: vec3f) -> Pixel {
    let uv = within_face(fetched.uv, fetched.level);
    let texel = textureSampleLevel(radiance, bilinear, uv, fetched.layer, fetched.level).rgb;
    let position = d / max(fetched.q, 1e-30);
    var confidence = 0u;
    if confident {
        confidence = confidence_of(fetched, index, d);
    }
    let range = length(position);
    return Pixel(finite_or_zero(texel), index + 1u, confidence, range, position, fetched.uv, fetched.layer, false);
}

// A pixel that no sample saw shows what lies farthest where the first sample looks: background goes on behind
// the edge that hid it, so the guess is seldom the wrong side's. It is marked, and has no range.
fn unresolved_pixel(fetched: Fetch, d: vec3f) -> Pixel {
    var pixel = sky_pixel(d);
    pixel.source = UNRESOLVED;
    pixel.confidence = 0u;
    if fetched.inside {
        let texel = textureSampleLevel(radiance, bilinear, fetched.uv, fetched.layer, 0.0).rgb;
        pixel.radiance = finite_or_zero(texel);
    }
    return pixel;
}

// Roughness is interpolated where it differs by no more from the nearest texel's. One between a lake's and its shore's shines
// where neither does.
const ALIKE: f32 = 0.1;

// The pixel with the highlight that its viewer, and not the sample, sees.
fn with_specular(pixel: Pixel) -> Pixel {
    var stored = textureSampleLevel(specular_plane, bilinear, pixel.uv, pixel.layer, 0.0);
    let texel = textureSampleLevel(specular_plane, nearest, pixel.uv, pixel.layer, 0.0);
    stored.a = select(texel.a, stored.a, abs(stored.a - texel.a) < ALIKE);
    var result = pixel;
    // A loop, since the software driver leaves one that none of its eight pixels needs, where it would run a branch.
    for (var k = 0u; k < 1u && pixel.range > 0.0 && any(stored.rgb > vec3f(0.0)); k++) {
        let to_eye = -pixel.position / pixel.range;
        let normal = unit_from_octahedral(textureSampleLevel(normal_plane, nearest, pixel.uv, pixel.layer, 0.0).xy);
        var word = 0u;
        if reflects {
            let size = vec2f(textureDimensions(reflector_plane));
            word = textureLoad(reflector_plane, vec2i(pixel.uv * size), pixel.layer, 0).x;
        }
        let through = transmitted_in_word(word);
        let surface = Surface(pixel.position, normal, vec3f(0.0), vec3f(0.0), stored.rgb, stored.a, through);
        var sum = vec3f(0.0);
        if reflects {
            sum = reflected_radiance(surface, to_eye, view.lighting, view.probes, probe_in_word(word));
        } else {
            sum = specular_sky(surface, to_eye, view.lighting);
        }
        // Not the bare uniform: Mesa's software driver bakes a uniform that bounds a loop into the machine code, and
        // compiles the shader again (45 ms and more) for each draw that comes with another uniform buffer.
        let count = min(view.lighting.light_count, arrayLength(&lights));
        for (var i = 0u; i < count; i++) {
            sum += specular_light(surface, to_eye, lights[view.first_light + i]);
        }
        result.radiance += finite_or_zero(sum);
    }
    return result;
}

// Linear 0..1 to sRGB-encoded 0..1; clamps, NaN to 0. A quartic in the fourth root, fitted for the least greatest
// error over the curve above its linear foot: within 0.009 of a byte's step of the definition (encode.wgsl), so that one
// byte in a hundred may round the other way. Three pow cost as much as the whole rest of the warp on the software
// driver (0.9 ms a view of 200x150).
fn encoded(linear: vec3f) -> vec3f {
    let x = min(select(vec3f(0.0), linear, linear > vec3f(0.0)), vec3f(1.0));
    let r = sqrt(sqrt(x));
    let curve = -0.06461155 + r * (0.19613595 + r * (1.12268135 + r * (-0.33550121 + r * 0.08132983)));
    return select(curve, 12.92 * x, x <= vec3f(0.0031308));
}

// The pixel as its viewer sees it.
fn with_highlight(pixel: Pixel) -> Pixel {
    if glossy && !pixel.is_final {
        return with_specular(pixel);
    }
    return pixel;
}

// A pixel as it is shown: sRGB and the source, each a byte.
struct SrgbOutput {
    @location(0) color: vec4u,
    @location(1) range: f32,
    @location(2) confidence: u32,
}

fn srgb_output(found: Pixel) -> SrgbOutput {
    let pixel = with_highlight(found);
    let is_shown = pixel.is_final && !linear;
    let color = select(encoded(pixel.radiance * view.lighting.exposure), pixel.radiance, is_shown) * 255.0;
    return SrgbOutput(vec4u(vec3u(floor(color + 0.5)), pixel.source), pixel.range, pixel.confidence);
}

// A pixel that is still to be averaged with others: linear radiance and the source.
struct LinearOutput {
    @location(0) radiance: vec4f,
    @location(1) range: f32,
    @location(2) confidence: u32,
}

fn linear_output(found: Pixel) -> LinearOutput {
    let pixel = with_highlight(found);
    // The target holds halves: beyond their largest a highlight would turn into an infinity.
    return LinearOutput(vec4f(min(pixel.radiance, vec3f(65504.0)), f32(pixel.source)), pixel.range, pixel.confidence);
}

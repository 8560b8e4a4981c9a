// Colour of a pixel once its surface is found. Shared by all searches.

import package::shared::encode::unit_from_octahedral;
import package::shared::fetch::{Fetch, SETTLED, bilinear, fetch_from, nearest, runtime_bound, omni, radiance, view};
import package::shared::finite::finite_or_zero;
import package::shared::shading::{Light, Surface, sky_radiance, specular_light, specular_sky};
import package::shared::reflection_probes::{probe_in_word, reflected_radiance, transmitted_in_word};

// Samples have Normal and Specular planes. Otherwise other textures are bound in their place and not read.
override glossy: bool = false;

// Samples have a Reflector plane. Otherwise another texture is bound in its place and not read.
override reflects: bool = false;

// The view asks for confidence. Otherwise no sample is looked up for it.
override confident: bool = false;

// Pixels are written as linear radiance, which `resolve` averages.
override linear: bool = false;

@group(0) @binding(6) var normal_plane: texture_2d_array<f32>;
@group(0) @binding(7) var specular_plane: texture_2d_array<f32>;
@group(0) @binding(8) var<storage, read> lights: array<Light>;
@group(2) @binding(4) var reflector_plane: texture_2d_array<u32>;
@group(2) @binding(5) var light_visibility_plane: texture_2d_array<f32>;

// A vertex of the triangle that covers the viewport.
fn corner_of_target(index: u32) -> vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

struct Pixel {
    radiance: vec3f,
    // 1 + position of the sample in the plan's list; 0 for sky; UNRESOLVED if no sample saw the surface.
    source: u32,
    // Confidence as `Output::Confidence` defines it.
    confidence: u32,
    // Metres from the eye; 0 without a surface.
    range: f32,
    // Position of the surface relative to the eye, and its texture coordinates and layer in its sample.
    position: vec3f,
    uv: vec2f,
    layer: u32,
    // `radiance` is the target's value: highlights are added and, unless targets are linear, it is exposed sRGB in 0..1.
    is_final: bool,
}

const UNRESOLVED: u32 = 255u;

// Marks that the warp writes in place of a source. UNSETTLED: the sample of the splatted depth did not settle the pixel.
// HIGHLIGHT: the pixel is settled but lacks view-dependent reflection.
const UNSETTLED: u32 = 254u;
const HIGHLIGHT: u32 = 253u;

// Added to the source of a pixel whose colour and depth come from different samples.
const OTHER_SAMPLE: u32 = 64u;

// Confidence without residual and with a second sample (or the scene's bounds) in agreement.
const CERTAIN: u32 = 255u;

// Confidence that sample `index` has the surface of the pixel in direction d.
fn confidence_of(fetched: Fetch, index: u32, d: vec3f) -> u32 {
    // 0 is reserved for pixels that no sample saw.
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

// Texture coordinates clamped so that a fetch from a coarser level stays on its face of a cube. The ring of a face is one
// texel of the finest level.
fn within_face(uv: vec2f, level: f32) -> vec2f {
    if !omni {
        return uv;
    }
    let faces = vec2f(3.0, 2.0);
    let face = clamp(floor(uv * faces), vec2f(0.0), faces - 1.0);
    let half_texel = 0.5 * exp2(ceil(level)) * faces / vec2f(textureDimensions(radiance));
    return (face + clamp(uv * faces - face, half_texel, 1.0 - half_texel)) / faces;
}

// The pixel in direction d (depth 1) whose surface is in sample `index`; unresolved if the sample's texels are too coarse for
// it. It then has the texels' colour.
fn surface_pixel(fetched: Fetch, index: u32, d: vec3f) -> Pixel {
    let uv = within_face(fetched.uv, fetched.level);
    let texel = textureSampleLevel(radiance, bilinear, uv, fetched.layer, fetched.level).rgb;
    let position = d / max(fetched.q, 1e-30);
    var confidence = 0u;
    if confident {
        confidence = confidence_of(fetched, index, d);
    }
    let range = select(0.0, length(position), fetched.fine);
    let source = select(UNRESOLVED, index + 1u, fetched.fine);
    confidence = select(0u, confidence, fetched.fine);
    return Pixel(finite_or_zero(texel), source, confidence, range, position, fetched.uv, fetched.layer, false);
}

// An unresolved pixel. Its colour is the farthest nearby texel of the first sample that looks there: background continues
// behind a foreground edge, so the guess is rarely wrong. It has no range.
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

// Roughness is interpolated only if it differs by less than this from the nearest texel's. A roughness between those of a
// lake and its shore would shine where neither does.
const ALIKE: f32 = 0.1;

// The pixel with view-dependent reflection.
fn with_specular(pixel: Pixel) -> Pixel {
    var stored = textureSampleLevel(specular_plane, bilinear, pixel.uv, pixel.layer, 0.0);
    let texel = textureSampleLevel(specular_plane, nearest, pixel.uv, pixel.layer, 0.0);
    stored.a = select(texel.a, stored.a, abs(stored.a - texel.a) < ALIKE);
    var result = pixel;
    // A loop in place of a branch. Quirk: both-sides.
    for (var k = 0u; k < 1u && pixel.range > 0.0 && any(stored.rgb > vec3f(0.0)); k++) {
        let to_eye = -pixel.position / pixel.range;
        let normal = unit_from_octahedral(textureSampleLevel(normal_plane, nearest, pixel.uv, pixel.layer, 0.0).xy);
        var word = 0u;
        if reflects {
            let size = vec2f(textureDimensions(reflector_plane));
            word = textureLoad(reflector_plane, vec2i(pixel.uv * size), pixel.layer, 0).x;
        }
        let through = transmitted_in_word(word);
        let black = vec3f(0.0);
        let surface = Surface(pixel.position, normal, black, black, stored.rgb, stored.a, through, normal, 0.0);
        let seen = textureSampleLevel(light_visibility_plane, bilinear, pixel.uv, pixel.layer, 0.0);
        var sum = vec3f(0.0);
        if reflects {
            let map = probe_in_word(word);
            sum = reflected_radiance(surface, to_eye, view.lighting, view.probes, map) * select(seen.a, 1.0, map != 0u);
        } else {
            sum = specular_sky(surface, to_eye, view.lighting) * seen.a;
        }
        // Quirk: uniform-bound.
        let count = min(view.lighting.light_count, arrayLength(&lights));
        for (var i = 0u; i < count; i++) {
            let light = lights[view.first_light + i];
            sum += specular_light(surface, to_eye, light) * seen[min(light.visibility_byte, 3u)];
        }
        result.radiance += finite_or_zero(sum);
    }
    return result;
}

// Linear 0..1 to sRGB-encoded 0..1; clamps, NaN to 0. A quartic in the fourth root, fitted for the least greatest
// error over the curve above its linear foot: within 0.009 of a byte's step of the definition (encode.wgsl), so that one
// byte in a hundred may round the other way. Quirk: slow-pow.
fn encoded(linear: vec3f) -> vec3f {
    let x = min(select(vec3f(0.0), linear, linear > vec3f(0.0)), vec3f(1.0));
    let r = sqrt(sqrt(x));
    let curve = -0.06461155 + r * (0.19613595 + r * (1.12268135 + r * (-0.33550121 + r * 0.08132983)));
    return select(curve, 12.92 * x, x <= vec3f(0.0031308));
}

// The pixel with reflection, where it is still missing.
fn with_highlight(pixel: Pixel) -> Pixel {
    if glossy && !pixel.is_final {
        return with_specular(pixel);
    }
    return pixel;
}

// A pixel of the sRGB target: colour and source, a byte each.
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

// A sub-pixel of the linear target: radiance and source.
struct LinearOutput {
    @location(0) radiance: vec4f,
    @location(1) range: f32,
    @location(2) confidence: u32,
}

fn linear_output(found: Pixel) -> LinearOutput {
    let pixel = with_highlight(found);
    // Clamped to the largest half float, because the target would store an infinity.
    return LinearOutput(vec4f(min(pixel.radiance, vec3f(65504.0)), f32(pixel.source)), pixel.range, pixel.confidence);
}

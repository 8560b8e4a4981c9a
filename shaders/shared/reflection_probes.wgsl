// Reflection probes (`scene/src/reflection.rs`): an omnidirectional map around each reflector. Glossy and transparent
// surfaces look it up in the directions of reflection and refraction.
//
// A probe is an octahedral map. Coarser levels are below the finest, prefiltered for roughness 0 to 1. Each level has a
// ring of one texel, so that a bilinear fetch never leaves it.

import package::shared::encode::octahedral_from_unit;
import package::shared::shading::{Lighting, Surface, reflected_direction, specular_of, specular_sky};

@group(2) @binding(0) var probe_radiance: texture_2d_array<f32>;
@group(2) @binding(1) var probe_range: texture_2d_array<f32>;
@group(2) @binding(2) var probe_sampler: sampler;
// xyz: viewpoint of each probe relative to the scene's centre; w: radius of its reflector. Metres.
@group(2) @binding(3) var<storage, read> probe_spheres: array<vec4f>;

// Centre of the scene relative to the eye, metres; texels on a side of the finest level.
struct ProbeUniform {
    middle: vec3f,
    side: f32,
}

// Texels on a side of the coarsest level.
const COARSEST: f32 = 4.0;

// Steps of the parallax correction. Each intersects the ray with a sphere around the probe's centre. The sphere's radius is
// the range that the probe stores in the last step's direction (Szirmay-Kalos et al., "Approximate Ray-Tracing on the GPU
// with Distance Impostors", 2005). In rooms the third step changes the result by less than a texel.
const STEPS: u32 = 3u;

// Position of a direction in a level, in texels of the probe.
fn texel_in_level(direction: vec3f, side: f32, level: f32) -> vec2f {
    let level_side = side * exp2(-level);
    // Rows of the levels above, with their rings.
    let row = 2.0 * (side - level_side) + 2.0 * level;
    return vec2f(1.0, row + 1.0) + (octahedral_from_unit(direction) * 0.5 + 0.5) * level_side;
}

fn filtered_radiance(probe: u32, direction: vec3f, roughness: f32, side: f32) -> vec3f {
    let size = vec2f(textureDimensions(probe_radiance));
    let coarsest = log2(side / COARSEST);
    let at = saturate(roughness) * coarsest;
    let level = floor(at);
    let coarser = min(level + 1.0, coarsest);
    let one = textureSampleLevel(probe_radiance, probe_sampler, texel_in_level(direction, side, level) / size, probe, 0.0);
    let other =
        textureSampleLevel(probe_radiance, probe_sampler, texel_in_level(direction, side, coarser) / size, probe, 0.0);
    return mix(one.rgb, other.rgb, at - level);
}

// Direction from the probe's centre to the hit of a ray from `position` (relative to that centre) in a unit direction.
fn parallax_corrected(probe: u32, position: vec3f, direction: vec3f, side: f32) -> vec3f {
    let along = dot(position, direction);
    let squared = dot(position, position);
    var met = direction;
    for (var i = 0u; i < STEPS; i++) {
        let texel = vec2i(texel_in_level(met, side, 0.0));
        let inverse_range = textureLoad(probe_range, texel, probe, 0).x;
        let range = 1.0 / max(inverse_range, 1e-18);
        let length_ = sqrt(max(along * along - squared + range * range, 0.0)) - along;
        let point = position + direction * max(length_, 0.0);
        let found = dot(point, point);
        // Sky has no parallax.
        let is_met = inverse_range > 0.0 && found > 1e-30 && found < 1e30;
        met = select(direction, point * inverseSqrt(clamp(found, 1e-30, 1e30)), is_met);
    }
    return met;
}

// Radiance that arrives at `position` (relative to the eye) from a unit direction.
fn look_up_probe(probes: ProbeUniform, probe: u32, position: vec3f, direction: vec3f, roughness: f32) -> vec3f {
    let last = arrayLength(&probe_spheres) - 1u;
    let in_probe = position - (probes.middle + probe_spheres[min(probe, last)].xyz);
    return filtered_radiance(probe, parallax_corrected(probe, in_probe, direction, probes.side), roughness, probes.side);
}

// Reflected and transmitted radiance of a surface towards the eye: from its probe (`probe` is 1 + the index), or from the
// sky if `probe` is 0.
fn reflected_radiance(surface: Surface, to_eye: vec3f, lighting: Lighting, probes: ProbeUniform, probe: u32) -> vec3f {
    if probe == 0u {
        return specular_sky(surface, to_eye, lighting);
    }
    let mirrored = reflected_direction(surface, to_eye);
    let reflected = look_up_probe(probes, probe - 1u, surface.position, mirrored, surface.roughness);
    var sent = specular_of(surface, to_eye, reflected);
    if any(surface.transmitted > vec3f(0.0)) {
        // Refracted once, at the entry. The exit of the object is ignored.
        let root = sqrt(clamp(surface.f0.x, 0.0, 0.5));
        let inward = refract(-to_eye, surface.normal, (1.0 - root) / (1.0 + root));
        let through = look_up_probe(probes, probe - 1u, surface.position, inward, surface.roughness);
        sent += surface.transmitted * through * (1.0 - specular_of(surface, to_eye, vec3f(1.0)));
    }
    return sent;
}

// Word of a Reflector plane: 1 + probe index in the lowest eleven bits, then seven bits each of transmitted red, green
// and blue.
fn reflector_word(probe: u32, transmitted: vec3f) -> u32 {
    let shares = vec3u(floor(saturate(transmitted) * 127.0 + 0.5));
    return min(probe, 2047u) | (shares.r << 11u) | (shares.g << 18u) | (shares.b << 25u);
}

fn probe_in_word(word: u32) -> u32 {
    return word & 2047u;
}

fn transmitted_in_word(word: u32) -> vec3f {
    return vec3f((vec3u(word) >> vec3u(11u, 18u, 25u)) & vec3u(127u)) / 127.0;
}

// What is around reflectors (`scene/src/reflection.rs`): a map of all directions for each, which glossy and transparent
// surfaces look up along the directions in which they reflect and refract.
//
// A map is an octahedron unfolded, with coarser levels below the finest, each blurred as a surface of its roughness blurs,
// from 0 to 1, and each within a ring of one texel, so that a bilinear fetch never leaves it.

import package::shared::encode::octahedral_from_unit;
import package::shared::shading::{Lighting, Surface, reflected_direction, specular_of, specular_sky};

@group(2) @binding(0) var probe_radiance: texture_2d_array<f32>;
@group(2) @binding(1) var probe_range: texture_2d_array<f32>;
@group(2) @binding(2) var probe_sampler: sampler;
// Where each map is seen from, metres from the middle of the scene, and how far from there its reflector reaches.
@group(2) @binding(3) var<storage, read> probe_places: array<vec4f>;

// The middle of the scene about the eye, metres; texels on a side of the finest level.
struct ProbeUniform {
    middle: vec3f,
    side: f32,
}

// Texels on a side of the coarsest level.
const COARSEST: f32 = 4.0;

// Steps by which the point is found that a ray meets: each takes the surroundings for a ball about the map's place, as
// wide as the map says they are where the last step arrived (Szirmay-Kalos et al., "Approximate Ray-Tracing on the GPU
// with Distance Impostors", 2005). A third step moves what is seen by less than a texel in rooms.
const STEPS: u32 = 3u;

// Where a level has a direction, in texels of the map.
fn place_in_level(direction: vec3f, side: f32, level: f32) -> vec2f {
    let level_side = side * exp2(-level);
    // Rows of the levels above, with their rings.
    let row = 2.0 * (side - level_side) + 2.0 * level;
    return vec2f(1.0, row + 1.0) + (octahedral_from_unit(direction) * 0.5 + 0.5) * level_side;
}

fn filtered_radiance(map: u32, direction: vec3f, roughness: f32, side: f32) -> vec3f {
    let size = vec2f(textureDimensions(probe_radiance));
    let coarsest = log2(side / COARSEST);
    let at = saturate(roughness) * coarsest;
    let level = floor(at);
    let coarser = min(level + 1.0, coarsest);
    let one = textureSampleLevel(probe_radiance, probe_sampler, place_in_level(direction, side, level) / size, map, 0.0);
    let other =
        textureSampleLevel(probe_radiance, probe_sampler, place_in_level(direction, side, coarser) / size, map, 0.0);
    return mix(one.rgb, other.rgb, at - level);
}

// The direction from a map's place to what the ray from `position`, about that place, meets in a unit direction.
fn parallax_corrected(map: u32, position: vec3f, direction: vec3f, side: f32) -> vec3f {
    let along = dot(position, direction);
    let squared = dot(position, position);
    var met = direction;
    for (var i = 0u; i < STEPS; i++) {
        let texel = vec2i(place_in_level(met, side, 0.0));
        let inverse_range = textureLoad(probe_range, texel, map, 0).x;
        let range = 1.0 / max(inverse_range, 1e-18);
        let length_ = sqrt(max(along * along - squared + range * range, 0.0)) - along;
        let point = position + direction * max(length_, 0.0);
        let found = dot(point, point);
        // The sky is seen alike from everywhere.
        let is_met = inverse_range > 0.0 && found > 1e-30 && found < 1e30;
        met = select(direction, point * inverseSqrt(clamp(found, 1e-30, 1e30)), is_met);
    }
    return met;
}

// Radiance that arrives at `position`, about the eye, from a unit direction.
fn look_up_probe(probes: ProbeUniform, map: u32, position: vec3f, direction: vec3f, roughness: f32) -> vec3f {
    let last = arrayLength(&probe_places) - 1u;
    let about_place = position - (probes.middle + probe_places[min(map, last)].xyz);
    return filtered_radiance(map, parallax_corrected(map, about_place, direction, probes.side), roughness, probes.side);
}

// What a surface sends towards the eye of what is around it: the sky's reflection, or where it looks a map up (`map` is 1
// + its number), the scene's, and what passes through it.
fn reflected_radiance(surface: Surface, to_eye: vec3f, lighting: Lighting, probes: ProbeUniform, map: u32) -> vec3f {
    if map == 0u {
        return specular_sky(surface, to_eye, lighting);
    }
    let reflected = look_up_probe(probes, map - 1u, surface.position, reflected_direction(surface, to_eye), surface.roughness);
    var sent = specular_of(surface, to_eye, reflected);
    if any(surface.transmitted > vec3f(0.0)) {
        // Refracted once, where it enters: what lies behind the far side of the thing is seen as from within it.
        let root = sqrt(clamp(surface.f0.x, 0.0, 0.5));
        let inward = refract(-to_eye, surface.normal, (1.0 - root) / (1.0 + root));
        let through = look_up_probe(probes, map - 1u, surface.position, inward, surface.roughness);
        sent += surface.transmitted * through * (1.0 - specular_of(surface, to_eye, vec3f(1.0)));
    }
    return sent;
}

// A word of a reflector plane: 1 + the map's number in its lowest eleven bits, and seven bits each of red, green and blue
// that pass through.
fn reflector_word(map: u32, transmitted: vec3f) -> u32 {
    let shares = vec3u(floor(saturate(transmitted) * 127.0 + 0.5));
    return min(map, 2047u) | (shares.r << 11u) | (shares.g << 18u) | (shares.b << 25u);
}

fn probe_in_word(word: u32) -> u32 {
    return word & 2047u;
}

fn transmitted_in_word(word: u32) -> vec3f {
    return vec3f((vec3u(word) >> vec3u(11u, 18u, 25u)) & vec3u(127u)) / 127.0;
}

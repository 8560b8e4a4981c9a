// Program of `sampler/src/passes/resample_probes.rs`: makes reflection probes (`shared/reflection_probes.wgsl`): the
// finest level from a map of octree nodes, the coarser levels from the finest.

import package::shared::encode::{octahedral_from_unit, rgb9e5_from_radiance, unit_from_octahedral};
import package::shared::finite::{finite_or_zero};
import package::shared::lit_maps::{seen_in_map, lookup};

struct ResampleProbes {
    // Texels on a side of the finest level; columns and rows of a probe.
    side: u32,
    columns: u32,
    rows: u32,
    // Texels on a side of this level, and its first row in the probe.
    level_side: u32,
    level_row: u32,
    // Roughness of the level.
    roughness: f32,
}

var<immediate> step: ResampleProbes;

// Finest levels of all probes, (side + 2)² texels each: radiance, and inverse range in w.
@group(3) @binding(0) var<storage, read_write> finest: array<vec4f>;
@group(3) @binding(1) var<storage, read_write> radiance_plane: array<u32>;
@group(3) @binding(2) var<storage, read_write> inverse_range_plane: array<u32>;

// Rays along a side of a texel of the finest level.
const SUB: u32 = 2u;
// Directions that a texel of a coarser level averages.
const TAPS: u32 = 48u;
const TAU: f32 = 6.283185307179586;

// Direction of a point of the octahedral square; beyond its border, of the adjoining face.
fn direction_of_place(place: vec2f) -> vec3f {
    var e = place;
    // Beyond a side, the square continues mirrored about the side's centre.
    if abs(e.x) > 1.0 {
        e = vec2f(sign(e.x) * 2.0 - e.x, -e.y);
    }
    if abs(e.y) > 1.0 {
        e = vec2f(-e.x, sign(e.y) * 2.0 - e.y);
    }
    return unit_from_octahedral(e);
}

// Position of a texel of the level (ring included) in the octahedral square.
fn place_of(texel: vec2f) -> vec2f {
    return (texel - 1.0) / f32(step.level_side) * 2.0 - 1.0;
}

fn keep(texel: vec2u, map: u32, radiance: vec3f, inverse_range: f32) {
    let at = (map * step.rows + step.level_row + texel.y) * step.columns + texel.x;
    radiance_plane[at] = rgb9e5_from_radiance(radiance);
    // Lower bits are invisible; zeros compress better.
    inverse_range_plane[at] = bitcast<u32>(inverse_range) & 0xffffff80u;
}

@compute @workgroup_size(8, 8)
fn resample(@builtin(global_invocation_id) id: vec3u) {
    let width = step.side + 2u;
    if id.x >= width || id.y >= width {
        return;
    }
    let central = direction_of_place(place_of(vec2f(id.xy) + 0.5));
    var radiance = vec3f(0.0);
    for (var i = 0u; i < SUB * SUB; i++) {
        let within = (vec2f(f32(i % SUB), f32(i / SUB)) + 0.5) / f32(SUB);
        let ray = direction_of_place(place_of(vec2f(id.xy) + within));
        radiance += seen_in_map(lookup.view + id.z, ray, ray).rgb / f32(SUB * SUB);
    }
    let inverse_range = seen_in_map(lookup.view + id.z, central, central).w;
    finest[(id.z * width + id.y) * width + id.x] = vec4f(radiance, inverse_range);
    keep(id.xy, id.z, radiance, inverse_range);
}

// The finest level's texel in a direction.
fn finest_in(map: u32, direction: vec3f) -> vec3f {
    let width = step.side + 2u;
    let texel = vec2u((octahedral_from_unit(direction) * 0.5 + 0.5) * (f32(step.side) - 1e-3)) + 1u;
    return finest[(map * width + texel.y) * width + texel.x].rgb;
}

// Point i of TAPS Hammersley points.
fn even_point(i: u32) -> vec2f {
    return vec2f((f32(i) + 0.5) / f32(TAPS), f32(reverseBits(i)) / 4294967296.0);
}

// Prefiltered radiance for the level's roughness, viewed along the normal (Karis, "Real Shading in Unreal Engine 4",
// 2013).
@compute @workgroup_size(8, 8)
fn blur(@builtin(global_invocation_id) id: vec3u) {
    let width = step.level_side + 2u;
    if id.x >= width || id.y >= width {
        return;
    }
    let normal = direction_of_place(place_of(vec2f(id.xy) + 0.5));
    // Any two orthogonal directions.
    let other = select(vec3f(0.0, 0.0, 1.0), vec3f(1.0, 0.0, 0.0), abs(normal.z) > 0.7);
    let tangent = normalize(cross(other, normal));
    let bitangent = cross(normal, tangent);
    let alpha = step.roughness * step.roughness;
    var sum = vec4f(0.0);
    for (var i = 0u; i < TAPS; i++) {
        let point = even_point(i);
        // Half vectors with the GGX distribution.
        let cosine = sqrt((1.0 - point.x) / (1.0 + (alpha * alpha - 1.0) * point.x));
        let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
        let angle = TAU * point.y;
        let half_vector = tangent * (sine * cos(angle)) + bitangent * (sine * sin(angle)) + normal * cosine;
        let direction = 2.0 * cosine * half_vector - normal;
        let weight = max(dot(direction, normal), 0.0);
        sum += vec4f(finest_in(id.z, direction), 1.0) * weight;
    }
    keep(id.xy, id.z, finite_or_zero(sum.rgb / max(sum.w, 1e-6)), 0.0);
}

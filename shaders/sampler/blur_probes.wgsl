// Program of `sampler/src/passes/blur_probes.rs`: makes the coarser levels of reflection probes from the finest.

import package::shared::encode::{octahedral_from_unit};
import package::shared::finite::{finite_or_zero};
import package::shared::probe_planes::{direction_of_place, finest, keep, place_of, step};

// Directions that a texel of a coarser level averages.
const TAPS: u32 = 48u;
const TAU: f32 = 6.283185307179586;

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

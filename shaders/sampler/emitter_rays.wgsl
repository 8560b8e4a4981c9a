// Program of `sampler/src/passes/emitter_rays.rs`: rays from the texels of a tile to points of emitting triangles, and what
// arrives. `sampler/src/light/emitters.rs` is the same on the CPU.

import package::shared::lit_texel::{LitTexel, index_of, may_leave, slot_of, texel_at, texel_count};
import package::shared::scattered::ray::ScatteredRay;

// A point of an emitting triangle, relative to the eye.
struct EmitterPoint {
    position: vec3f,
    // 1 if both sides of the triangle emit.
    both_sides: u32,
    // Front normal times the area.
    area: vec3f,
    // Radiance / pi, divided by the probability of the triangle and the number of rays of a texel.
    radiance: vec3f,
}

// Which rays of the texels are traced.
struct EmitterQuery {
    // Number of the ray of each texel.
    ray: u32,
}

@group(0) @binding(3) var<uniform> emitter_query: EmitterQuery;
// A point for each slot for the first ray, then for the second.
@group(0) @binding(4) var<storage, read> emitter_points: array<EmitterPoint>;
@group(0) @binding(5) var<storage, read_write> emitter_rays: array<ScatteredRay>;
@group(0) @binding(6) var<storage, read> passed: array<f32>;
// Irradiance / pi.
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4f>;
// The texel itself where it shows a surface.
@group(0) @binding(8) var<storage, read_write> members: array<u32>;

const SLOTS: u32 = 64;
const NO_MEMBER: u32 = 0xffffffffu;
// Share of the way to an emitter that is looked at: it does not block itself.
const ALMOST: f32 = 0.9999;

// How much of a point's radiance arrives if nothing blocks it.
fn weight_of(texel: LitTexel, point: EmitterPoint) -> f32 {
    let to_light = point.position - texel.start;
    let squared = dot(to_light, to_light);
    let cosine = dot(texel.normal, to_light);
    let towards = -dot(point.area, to_light);
    let facing = select(towards, abs(towards), point.both_sides == 1u);
    let weight = cosine * facing / (squared * squared);
    let is_finite = (bitcast<u32>(weight) & 0x7f800000u) != 0x7f800000u;
    return select(0.0, weight, texel.exists && cosine > 0.0 && facing > 0.0 && is_finite);
}

@compute @workgroup_size(64)
fn cast_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let texel = texel_at(at);
    let point = emitter_points[emitter_query.ray * SLOTS + slot_of(at)];
    let direction = point.position - texel.start;
    let goes = weight_of(texel, point) > 0.0 && may_leave(texel, direction);
    emitter_rays[at] = ScatteredRay(texel.start, select(0.0, ALMOST, goes), direction, 0u);
    members[at] = select(NO_MEMBER, at, texel.exists);
}

@compute @workgroup_size(64)
fn sum_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() || !(emitter_rays[at].most > 0.0) {
        return;
    }
    let point = emitter_points[emitter_query.ray * SLOTS + slot_of(at)];
    emitted[at] += vec4f(point.radiance * (weight_of(texel_at(at), point) * passed[at]), 0.0);
}

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
    // Square of the distance from the triangle's middle below which a ray stands for all of it.
    near: f32,
    // Radiance / pi, divided by the probability of the triangle and the number of rays of a texel.
    radiance: vec3f,
    // Corners, relative to the eye.
    first: vec3f,
    second: vec3f,
    third: vec3f,
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

// What a ray to a point of an emitter stands for: how much of the radiance arrives if nothing blocks it, and where the ray goes.
struct Towards {
    weight: f32,
    direction: vec3f,
}

// Of a triangle seen from a point with that normal at the origin: `lambert` of the same on the CPU.
fn lambert(first: vec3f, second: vec3f, third: vec3f, normal: vec3f) -> Towards {
    let corners = array<vec3f, 3>(first, second, third);
    // The triangle above the horizon has four corners at most.
    var above: array<vec3f, 4>;
    var count = 0u;
    for (var at = 0u; at < 3u; at++) {
        let here = corners[at];
        let next = corners[(at + 1u) % 3u];
        let height = dot(here, normal);
        let next_height = dot(next, normal);
        if height > 0.0 && count < 4u {
            above[count] = here;
            count += 1u;
        }
        if (height > 0.0) != (next_height > 0.0) && count < 4u {
            above[count] = here + (next - here) * (height / (height - next_height));
            count += 1u;
        }
    }
    var turns = 0.0;
    var sum = vec3f(0.0);
    for (var at = 0u; at < count; at++) {
        let here = above[at];
        let next = above[select(at + 1u, 0u, at + 1u == count)];
        let across = cross(here, next);
        let length = length(across);
        // The angle of the edge, about the axis across it. An edge through the point has none.
        if length > 0.0 {
            turns += atan2(length, dot(here, next)) * dot(across, normal) / length;
        }
        sum += here;
    }
    return Towards(0.5 * abs(turns), sum / f32(max(count, 1u)));
}

// From afar a ray stands for its point. From close by points differ too much, and it stands for the whole triangle, which is then as
// visible as the point.
fn towards(texel: LitTexel, point: EmitterPoint) -> Towards {
    let to_point = point.position - texel.start;
    let cosine = dot(texel.normal, to_point);
    let front = -dot(point.area, to_point);
    let facing = select(front, abs(front), point.both_sides == 1u);
    let first = point.first - texel.start;
    let second = point.second - texel.start;
    let third = point.third - texel.start;
    let middle = (first + second + third) / 3.0;
    let squared = dot(to_point, to_point);
    var found = Towards(cosine * facing / (squared * squared), to_point);
    if dot(middle, middle) < point.near {
        found = lambert(first, second, third, texel.normal);
        found.direction = select(found.direction, to_point, cosine > 0.0);
    }
    let is_finite = (bitcast<u32>(found.weight) & 0x7f800000u) != 0x7f800000u;
    let arrives = texel.exists && facing > 0.0 && found.weight > 0.0 && is_finite;
    found.weight = select(0.0, found.weight, arrives);
    return found;
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
    let found = towards(texel, point);
    let goes = found.weight > 0.0 && may_leave(texel, found.direction);
    emitter_rays[at] = ScatteredRay(texel.start, select(0.0, ALMOST, goes), found.direction, 0u);
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
    emitted[at] += vec4f(point.radiance * (towards(texel_at(at), point).weight * passed[at]), 0.0);
}

// Program of `sampler/src/passes/gather_rays.rs`: texels gather what lit leaves reflect. `sampler/src/light/paths/gather.rs` is the
// same on the CPU.

import package::shared::lit_leaves::radiance_along;
import package::shared::lit_texel::{
    LitTexel, above, agrees, index_of, may_leave, slot_of, slot_of_place, texel_at, texel_count, tile,
};
import package::shared::scattered::hit::ScatteredHit;
import package::shared::scattered::ray::ScatteredRay;

// Images of half the size, whose points cast rays.
struct GatherQuery {
    // Columns and rows, and coordinates of the first block in the whole image.
    size: vec2u,
    first: vec2u,
    // Slot by which the image's points are ahead, and the number of the ray of each.
    slot: u32,
    ray: u32,
    // By which what a ray brings is multiplied.
    share: f32,
}

@group(0) @binding(3) var<uniform> gather_query: GatherQuery;
// Points of the unit disc: those of each slot for the first ray, then for the second.
@group(0) @binding(4) var<storage, read> disc_points: array<vec2f>;
@group(0) @binding(5) var<storage, read_write> gather_rays: array<ScatteredRay>;
@group(0) @binding(6) var<storage, read> hits: array<ScatteredHit>;
// For each block of 2x2 its first texel that exists, and its first that shows another surface than that one; or NO_MEMBER.
@group(0) @binding(7) var<storage, read_write> members: array<u32>;
@group(0) @binding(8) var<storage, read_write> other_members: array<u32>;
// Irradiance / pi of those.
@group(0) @binding(9) var<storage, read_write> found: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> other_found: array<vec4f>;
// Number of texels around which no block shows their surface, and which.
@group(0) @binding(11) var<storage, read_write> list_count: atomic<u32>;
@group(0) @binding(12) var<storage, read_write> list: array<u32>;
// Irradiance / pi of all texels.
@group(0) @binding(13) var<storage, read_write> indirect: array<vec4f>;

const SLOTS: u32 = 64;
const NO_MEMBER: u32 = 0xffffffffu;
const NO_END: f32 = 3.4e38;
// Blocks on each side of a texel's own whose light it takes; and if none of them shows its surface.
const REACH: i32 = 1;
const FAR_REACH: i32 = 3;

fn point_count() -> u32 {
    return min(gather_query.size.x * gather_query.size.y, arrayLength(&members));
}

@compute @workgroup_size(64)
fn halve(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= point_count() {
        return;
    }
    let block = gather_query.first + vec2u(at % gather_query.size.x, at / gather_query.size.x);
    var one = NO_MEMBER;
    var other = NO_MEMBER;
    var shown: LitTexel;
    // The bound is no constant. Quirk: unrolled-loops.
    for (var corner = 0u; corner < min(4u, arrayLength(&members) + 4u); corner++) {
        let place = 2u * block + vec2u(corner % 2u, corner / 2u) - tile.first;
        // Wraps around before the first.
        if all(place < tile.size) {
            let index = place.y * tile.size.x + place.x;
            let texel = texel_at(index);
            if texel.exists && one == NO_MEMBER {
                one = index;
                shown = texel;
            } else if texel.exists && other == NO_MEMBER && !agrees(shown, texel) {
                other = index;
            }
        }
    }
    members[at] = one;
    other_members[at] = other;
}

fn ray_of(texel: LitTexel, slot: u32) -> ScatteredRay {
    let direction = above(texel.normal, disc_points[gather_query.ray * SLOTS + slot % SLOTS]);
    return ScatteredRay(texel.start, select(0.0, NO_END, may_leave(texel, direction)), direction, 0u);
}

// What a ray brings.
fn brought(index: u32) -> vec3f {
    let ray = gather_rays[index];
    if !(ray.most > 0.0) {
        return vec3f(0.0);
    }
    return radiance_along(ray.origin, ray.direction, hits[index]) * gather_query.share;
}

// Casts a ray of each point of an image.
@compute @workgroup_size(64)
fn cast_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= point_count() {
        return;
    }
    let member = members[at];
    if member == NO_MEMBER {
        gather_rays[at].most = 0.0;
        return;
    }
    let block = gather_query.first + vec2u(at % gather_query.size.x, at / gather_query.size.x);
    gather_rays[at] = ray_of(texel_at(member), slot_of_place(block) + gather_query.slot);
}

@compute @workgroup_size(64)
fn sum_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= point_count() {
        return;
    }
    found[at] += vec4f(brought(at), 0.0);
}

struct Around {
    sum: vec4f,
    weights: f32,
}

// What blocks within a reach found on a texel's surface, weighted by nearness.
fn around(at: u32, texel: LitTexel, reach: i32) -> Around {
    let place = tile.first + vec2u(at % tile.size.x, at / tile.size.x);
    let own = vec2i(place / 2u) - vec2i(gather_query.first);
    // A block's middle is between its texels.
    let aside = select(vec2f(0.25), vec2f(-0.25), place % 2u == vec2u(0u));
    var sum = Around(vec4f(0.0), 0.0);
    // Bounds are no constants. Quirk: unrolled-loops.
    let side = min(2 * reach + 1, i32(arrayLength(&members)) + 9);
    for (var number = 0; number < side * side; number++) {
        let by = vec2i(number % side, number / side) - reach;
        let there = own + by;
        if all(there >= vec2i(0)) && all(there < vec2i(gather_query.size)) {
            let index = u32(there.y) * gather_query.size.x + u32(there.x);
            let near = max(vec2f(f32(reach) + 0.5) - abs(vec2f(by) - aside), vec2f(0.0));
            let weight = near.x * near.y;
            let one = members[index];
            if one != NO_MEMBER && agrees(texel, texel_at(one)) {
                sum.sum += found[index] * weight;
                sum.weights += weight;
            }
            let other = other_members[index];
            if other != NO_MEMBER && agrees(texel, texel_at(other)) {
                sum.sum += other_found[index] * weight;
                sum.weights += weight;
            }
        }
    }
    return sum;
}

// Gives each texel the mean of what those around it found on its surface. Lists those around which there are none.
@compute @workgroup_size(64)
fn spread(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    indirect[at] = vec4f(0.0);
    let texel = texel_at(at);
    if !texel.exists {
        return;
    }
    var mean = around(at, texel, REACH);
    if !(mean.weights > 0.0) {
        mean = around(at, texel, FAR_REACH);
    }
    if mean.weights > 0.0 {
        indirect[at] = mean.sum / mean.weights;
    } else {
        list[atomicAdd(&list_count, 1u)] = at;
    }
}

// Casts a ray of each listed texel, in the place of its entry.
@compute @workgroup_size(64)
fn cast_listed(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let entry = index_of(group, groups, lane);
    if entry >= arrayLength(&gather_rays) {
        return;
    }
    if entry >= atomicLoad(&list_count) {
        gather_rays[entry].most = 0.0;
        return;
    }
    let at = list[entry];
    gather_rays[entry] = ray_of(texel_at(at), slot_of(at) + gather_query.slot);
}

@compute @workgroup_size(64)
fn sum_listed(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let entry = index_of(group, groups, lane);
    if entry >= arrayLength(&gather_rays) || entry >= atomicLoad(&list_count) {
        return;
    }
    indirect[list[entry]] += vec4f(brought(entry), 0.0);
}

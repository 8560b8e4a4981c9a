// Program of `sampler/src/passes/scattered_rays.rs`: traces scattered rays, one an invocation at a time.

import package::shared::scattered::hit::{FRONT, ScatteredHit};
import package::shared::scattered::ray::{exponent_of, is_ray, query, rays, unit_of};
import package::shared::scattered::stack::Stack;
import package::shared::scattered::trees::triangles;
import package::shared::scattered::walk::{
    Found, NO_TRIANGLE, Walk, begin_walk, go_on, instance_of, nothing_found,
};

@group(0) @binding(2) var<storage, read_write> hits: array<ScatteredHit>;
// The share of light that passes each ray.
@group(0) @binding(3) var<storage, read_write> passed: array<f32>;
// Set if a walk was cut off. Quirk: loop-limit.
@group(0) @binding(4) var<storage, read_write> unfinished: atomic<u32>;

// Rays that an invocation traces one after another, so that those of a subgroup wait less for the longest walk.
override rays_each: u32 = 1;

// Writes what a ray found. `ends`: any hit ended its walk.
fn write_result(index: u32, found: Found, ends: bool) {
    if ends {
        passed[index] = found.passed;
        return;
    }
    var hit: ScatteredHit;
    if found.triangle != NO_TRIANGLE {
        hit.instance = 1u + instance_of(triangles[3u * found.triangle].w, found.object);
        hit.primitive = triangles[3u * found.triangle + 1u].w | select(0u, FRONT, found.front);
        hit.t = found.limit / unit_of(exponent_of(rays[index].direction));
        hit.weights = found.weights;
    }
    hits[index] = hit;
}

// Traces an invocation's rays: the first and each `stride` behind it. Rays follow one another in one loop, so that an
// invocation whose ray has ended begins the next while its neighbours are still on their way.
fn trace(first: u32, stride: u32, ends: bool) {
    let end = min(query.end, arrayLength(&rays));
    var index = query.first + first;
    if index >= end {
        return;
    }
    var stack: Stack;
    var walk = begin_walk(index);
    var found = nothing_found(index);
    var flags = rays[index].flags;
    var goes_on = is_ray(rays[index]);
    var traced = 0u;
    loop {
        if goes_on {
            goes_on = go_on(&walk, index, flags, ends, &stack, &found);
        }
        if !goes_on {
            write_result(index, found, ends);
            index += stride;
            traced += 1u;
            if traced >= rays_each || index >= end {
                break;
            }
            stack.height = 0u;
            walk = begin_walk(index);
            found = nothing_found(index);
            flags = rays[index].flags;
            goes_on = is_ray(rays[index]);
        }
    }
    if goes_on {
        write_result(index, found, ends);
        atomicMax(&unfinished, 1u);
    }
}

// Invocations of a workgroup.
const LANES: u32 = 128;

// The index of an invocation's first ray, and the number of invocations.
fn place_of(group: vec3u, groups: vec3u, lane: u32) -> vec2u {
    return vec2u((group.y * groups.x + group.x) * LANES + lane, groups.x * groups.y * LANES);
}

@compute @workgroup_size(128)
fn nearest(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let place = place_of(group, groups, lane);
    trace(place.x, place.y, false);
}

@compute @workgroup_size(128)
fn passing(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let place = place_of(group, groups, lane);
    trace(place.x, place.y, true);
}

// Program of `papers/virtual-lights/src/passes/filter_indirect.rs`: a cross-bilateral filter of gathered light, rows then columns,
// guided by normals and planes (Petschnigg et al., "Digital Photography with Flash and No-Flash Image Pairs", 2004). The
// second pass adds the light to radiance.

import package::shared::receiver::{Receiver, albedo_of, receiver_of};
import package::virtual_lights::shared::vpl::{Gathering};

@group(0) @binding(0) var<uniform> gathering: Gathering;
@group(0) @binding(1) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(2) var<storage, read> gathered: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> filtered: array<vec4f>;
@group(0) @binding(4) var<storage, read> g_materials: array<vec4u>;
@group(0) @binding(5) var<storage, read_write> shaded: array<vec4f>;

// Distance from the plane, as a share of the range, at which a neighbour's weight is 1/e.
const PLANE: f32 = 0.01;

fn agreement(a: Receiver, b: Receiver) -> f32 {
    let off = dot(a.normal, b.position - a.position) / (PLANE * length(a.position));
    let facing = saturate(dot(a.normal, b.normal));
    let squared = facing * facing;
    let fourth = squared * squared;
    return select(0.0, fourth * fourth * exp(-off * off), b.exists);
}

// Weighted mean of neighbours along a direction. Both ends have half weight, so that a reach of 4 covers each interleaved
// offset of the gathering equally often.
fn smoothed(at: vec2u, along: vec2i) -> vec3f {
    let own = at.y * gathering.size.x + at.x;
    let center = receiver_of(g_surfaces[own]);
    let reach = i32(gathering.reach);
    var sum = vec3f(0.0);
    var weights = 0.0;
    var i = -reach;
    loop {
        let there = vec2i(at) + along * i;
        let inside = all(there >= vec2i(0)) & all(there < vec2i(gathering.size));
        let clamped = vec2u(clamp(there, vec2i(0), vec2i(gathering.size) - 1));
        let index = clamped.y * gathering.size.x + clamped.x;
        let edge = select(1.0, 0.5, (abs(i) == reach) & (reach > 0));
        let weight = select(0.0, edge * agreement(center, receiver_of(g_surfaces[index])), inside);
        sum += gathered[index].rgb * weight;
        weights += weight;
        i += 1;
        // The bound is no bare uniform: see resolve_view.wgsl.
        if i > min(reach, i32(arrayLength(&gathered))) {
            break;
        }
    }
    // The sub-sample itself always agrees, except for rounding.
    return select(gathered[own].rgb, sum / max(weights, 1e-20), weights > 1e-3);
}

@compute @workgroup_size(8, 8)
fn filter_rows(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= gathering.size.x || id.y >= gathering.size.y {
        return;
    }
    filtered[id.y * gathering.size.x + id.x] = vec4f(smoothed(id.xy, vec2i(1, 0)), 0.0);
}

@compute @workgroup_size(8, 8)
fn add_filtered_columns(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= gathering.size.x || id.y >= gathering.size.y {
        return;
    }
    let at = id.y * gathering.size.x + id.x;
    let albedo = albedo_of(g_materials[at].x);
    let light = smoothed(id.xy, vec2i(0, 1));
    let exists = any(g_surfaces[at].xyz != vec3u(0u));
    shaded[at] += vec4f(select(vec3f(0.0), albedo * light, exists), 0.0);
}

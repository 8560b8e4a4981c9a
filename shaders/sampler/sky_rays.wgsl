// Program of `sampler/src/passes/sky_rays.rs`: rays from the texels of a tile to the sky, and the share of it that they see.
// `sampler/src/light/sky.rs` is the same on the CPU.

import package::shared::lit_texel::{
    LitTexel, SkySums, above, agrees, index_of, may_leave, slot_of, texel_at, texel_count, tile,
};
import package::shared::scattered::ray::ScatteredRay;
import package::shared::shading::{Lighting, sky_radiance};

// Which rays of the texels are traced.
struct SkyQuery {
    // Number of the ray of each texel.
    ray: u32,
    // Metres at which rays end.
    reach: f32,
}

@group(0) @binding(3) var<uniform> sky_query: SkyQuery;
@group(0) @binding(4) var<uniform> lighting: Lighting;
// Points of the unit disc: those of each slot for the first ray, then for the second.
@group(0) @binding(5) var<storage, read> sky_points: array<vec2f>;
@group(0) @binding(6) var<storage, read_write> sky_rays: array<ScatteredRay>;
@group(0) @binding(7) var<storage, read> passed: array<f32>;
@group(0) @binding(8) var<storage, read_write> sums: array<SkySums>;
@group(0) @binding(9) var<storage, read> unfiltered: array<SkySums>;

// Reach of the filter, texels; whether it goes along columns.
override filter_reach: i32 = 4;
override along_columns: bool = false;

const SLOTS: u32 = 64;

fn direction_of(texel: LitTexel, at: u32) -> vec3f {
    return above(texel.normal, sky_points[sky_query.ray * SLOTS + slot_of(at)]);
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
    let direction = direction_of(texel, at);
    let goes = may_leave(texel, direction);
    sky_rays[at] = ScatteredRay(texel.start, select(0.0, sky_query.reach, goes), direction, 0u);
}

@compute @workgroup_size(64)
fn sum_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let ray = sky_rays[at];
    let radiance = vec4f(sky_radiance(lighting, ray.direction), 0.0);
    if !texel_at(at).exists {
        return;
    }
    sums[at].whole += radiance;
    sums[at].seen += radiance * select(0.0, passed[at], ray.most > 0.0);
}

// Means over the texels along a row or column that show the same surface; the outermost have half weight.
@compute @workgroup_size(64)
fn smooth_sums(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let texel = texel_at(at);
    var mean = SkySums(vec4f(0.0), vec4f(0.0));
    var weights = 0.0;
    let place = i32(select(at % tile.size.x, at / tile.size.x, along_columns));
    let places = i32(select(tile.size.x, tile.size.y, along_columns));
    let step = i32(select(1u, tile.size.x, along_columns));
    // The bound is no constant. Quirk: unrolled-loops.
    for (var by = -filter_reach; by <= min(filter_reach, i32(arrayLength(&unfiltered))); by++) {
        let there = place + by;
        if texel.exists && there >= 0 && there < places {
            let other = u32(i32(at) + by * step);
            if by == 0 || agrees(texel, texel_at(other)) {
                let weight = select(1.0, 0.5, abs(by) == filter_reach);
                mean.seen += unfiltered[other].seen * weight;
                mean.whole += unfiltered[other].whole * weight;
                weights += weight;
            }
        }
    }
    let scale = select(0.0, 1.0 / weights, weights > 0.0);
    sums[at] = SkySums(mean.seen * scale, mean.whole * scale);
}

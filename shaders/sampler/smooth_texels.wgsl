// Program of `sampler/src/passes/smooth_texels.rs`: means over the texels along a row or column that show the same surface.
// `sampler/src/light/filter.rs` is the same on the CPU.

import package::shared::lit_texel::{agrees, index_of, texel_at, texel_count};

// An image whose points are texels of a tile.
struct SmoothQuery {
    // Columns and rows.
    size: vec2u,
}

@group(0) @binding(3) var<uniform> smooth_query: SmoothQuery;
// The texel of each point, or NO_MEMBER.
@group(0) @binding(4) var<storage, read> members: array<u32>;
@group(0) @binding(5) var<storage, read> unsmoothed: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> smoothed: array<vec4f>;

const NO_MEMBER: u32 = 0xffffffffu;

// Reach of the filter, points; whether it goes along columns.
override filter_reach: i32 = 4;
override along_columns: bool = false;
// Whether the points are all texels of the tile. Then only those with a 1 in w are replaced.
override every_texel: bool = false;

fn member_of(at: u32) -> u32 {
    let listed = members[min(at, arrayLength(&members) - 1u)];
    return select(listed, select(NO_MEMBER, at, texel_at(min(at, texel_count())).exists), every_texel);
}

@compute @workgroup_size(64)
fn smooth_texels(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= smooth_query.size.x * smooth_query.size.y || at >= arrayLength(&smoothed) {
        return;
    }
    // Columns are written to where the values were before rows.
    if every_texel && along_columns && smoothed[at].w != 1.0 {
        return;
    }
    let member = member_of(at);
    if member == NO_MEMBER {
        smoothed[at] = vec4f(0.0);
        return;
    }
    let texel = texel_at(min(member, texel_count()));
    var sum = vec4f(0.0);
    var weights = 0.0;
    let place = i32(select(at % smooth_query.size.x, at / smooth_query.size.x, along_columns));
    let places = i32(select(smooth_query.size.x, smooth_query.size.y, along_columns));
    let step = i32(select(1u, smooth_query.size.x, along_columns));
    // The bound is no constant. Quirk: unrolled-loops.
    for (var by = -filter_reach; by <= min(filter_reach, i32(arrayLength(&unsmoothed))); by++) {
        let there = place + by;
        if there >= 0 && there < places {
            let other = u32(i32(at) + by * step);
            let theirs = member_of(other);
            if by == 0 || (theirs != NO_MEMBER && agrees(texel, texel_at(theirs))) {
                // The outermost have half weight.
                let weight = select(1.0, 0.5, abs(by) == filter_reach);
                sum += unsmoothed[other] * weight;
                weights += weight;
            }
        }
    }
    smoothed[at] = sum / weights;
}

// Program of papers/megaviews/src/many_views/fuse.rs: merges the map of each view node into the maps of its descendants, from the root
// down. Or looks up single texels without such a merge.

import package::shared::linear::linear_index;
import package::megaviews::shared::map_fusion::{fusion, map_texel, maps, nearer, nodes, seen_from};
import package::megaviews::shared::map_texels::{MapTexel, put_texel, texel_place};

// For each level, its first map and its number of maps.
@group(0) @binding(2) var<storage, read> map_levels: array<vec2u>;
// Map and texel of each query.
@group(0) @binding(3) var<storage, read> queries: array<vec2u>;
// Inverse range (f32 bits) and node of each query.
@group(0) @binding(4) var<storage, read_write> answers: array<vec2u>;

// Merges the parent's map into each map of a level. A workgroup takes 64 texels of one map.
@compute @workgroup_size(64)
fn fuse(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let texels = fusion.side * fusion.side * 2u;
    let parts = (texels + 63u) / 64u;
    let part = group.y * groups.x + group.x;
    let range = map_levels[fusion.level];
    let index = part / parts;
    let map = range.x + index;
    let texel = (part - index * parts) * 64u + local;
    if index >= range.y || texel >= texels {
        return;
    }
    let above = maps[map].w;
    if above == map {
        return;
    }
    let value = map_texel(above, texel);
    if value.inverse_range > 0.0 {
        put_texel(texel_place(map, fusion.map_shift, fusion.side, texel), seen_from(value, above, map, texel));
    }
}

// Answers queries: merges one texel of all maps from the root's to the asked one.
@compute @workgroup_size(64)
fn query(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= fusion.level {
        return;
    }
    let asked = queries[at];
    // The maps from the asked one up to the root's.
    var path: array<u32, 12>;
    var length_ = 1u;
    path[0] = asked.x;
    for (; length_ < 12u; length_++) {
        let above = maps[path[length_ - 1u]].w;
        if above == path[length_ - 1u] {
            break;
        }
        path[length_] = above;
    }
    var value = map_texel(path[length_ - 1u], asked.y);
    for (var i = length_ - 1u; i > 0u; i--) {
        let map = path[i - 1u];
        let own = map_texel(map, asked.y);
        if value.inverse_range > 0.0 {
            value = nearer(own, seen_from(value, path[i], map, asked.y));
        } else {
            value = own;
        }
    }
    answers[at] = vec2u(bitcast<u32>(value.inverse_range), value.node);
}

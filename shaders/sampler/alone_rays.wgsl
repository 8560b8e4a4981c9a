// Program of `sampler/src/passes/alone_rays.rs`: rays of texels that no light cells describe, to the sky and to lit leaves.
// `sampler/src/light/cells/alone.rs` is the same on the CPU.

import package::shared::lit_leaves::radiance_along;
import package::shared::lit_texel::{above, index_of, may_leave, slot_of, texel_at, texel_count};
import package::shared::scattered::hit::ScatteredHit;
import package::shared::scattered::ray::ScatteredRay;
import package::shared::shading::{Lighting, sky_radiance};

// Which rays of the texels are traced.
struct AloneQuery {
    // Number of the ray of each texel.
    ray: u32,
    // Metres beyond which a ray reaches the sky.
    reach: f32,
}

@group(0) @binding(3) var<uniform> alone_query: AloneQuery;
@group(0) @binding(4) var<uniform> lighting: Lighting;
// Points of the unit disc: those of each slot for the first ray, then for the second.
@group(0) @binding(5) var<storage, read> disc_points: array<vec2f>;
@group(0) @binding(6) var<storage, read_write> alone_rays: array<ScatteredRay>;
@group(0) @binding(7) var<storage, read> hits: array<ScatteredHit>;
// The texel itself where it casts rays.
@group(0) @binding(8) var<storage, read> members: array<u32>;
// Sums over a texel's rays: radiance of the sky that they reach, with their number; of the sky in all of their directions; and of
// surfaces.
@group(0) @binding(9) var<storage, read_write> seen_sums: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> whole_sums: array<vec4f>;
@group(0) @binding(11) var<storage, read_write> reflected_sums: array<vec4f>;
@group(0) @binding(12) var<storage, read_write> sky_share: array<vec4f>;
@group(0) @binding(13) var<storage, read_write> indirect: array<vec4f>;

const SLOTS: u32 = 64;
const NO_END: f32 = 3.4e38;

@compute @workgroup_size(64)
fn cast_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    if members[at] != at {
        alone_rays[at].most = 0.0;
        return;
    }
    let texel = texel_at(at);
    let direction = above(texel.normal, disc_points[alone_query.ray * SLOTS + slot_of(at)]);
    alone_rays[at] = ScatteredRay(texel.start, select(0.0, NO_END, may_leave(texel, direction)), direction, 0u);
}

@compute @workgroup_size(64)
fn sum_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() || members[at] != at {
        return;
    }
    let ray = alone_rays[at];
    let radiance = sky_radiance(lighting, ray.direction);
    whole_sums[at] += vec4f(radiance, 0.0);
    let hit = hits[at];
    let goes = ray.most > 0.0;
    let reaches = goes && (hit.instance == 0u || hit.t > alone_query.reach);
    seen_sums[at] += vec4f(select(vec3f(0.0), radiance, reaches), 1.0);
    if goes {
        reflected_sums[at] += vec4f(radiance_along(ray.origin, ray.direction, hit), 0.0);
    }
}

// Makes light of the sums, which neighbours share.
@compute @workgroup_size(64)
fn keep_light(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() || members[at] != at {
        return;
    }
    let seen = seen_sums[at];
    let whole = whole_sums[at].rgb;
    let share = select(vec3f(0.0), seen.rgb / whole, whole > vec3f(0.0));
    // In w 1: the texel is joined with those around it.
    sky_share[at] = vec4f(share, 1.0);
    indirect[at] = vec4f(select(vec3f(0.0), reflected_sums[at].rgb / seen.w, seen.w > 0.0), 1.0);
}

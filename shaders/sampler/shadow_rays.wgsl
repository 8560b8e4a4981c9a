// Program of `sampler/src/passes/shadow_rays.rs`: rays from the texels of a tile to one light, and what arrives from it.
// `sampler/src/light/shadows.rs` is the same on the CPU.

import package::shared::lit_texel::{
    LitTexel, agrees, index_of, may_leave, orthonormal_pair, slot_of, texel_at, texel_count, tile,
};
import package::shared::scattered::ray::ScatteredRay;
import package::shared::shading::{Light, PI, incident};

// The light that rays go to.
struct ShadowLight {
    // Its index in `lights`.
    light: u32,
    // Radius of a point or spot light; tangent of the angular radius of a directional light.
    radius: f32,
    // SOFT, UNBLOCKED.
    flags: u32,
    // First texel in a penumbra of a dispatch.
    first: u32,
}

@group(0) @binding(3) var<uniform> shadow: ShadowLight;
@group(0) @binding(4) var<storage, read> lights: array<Light>;
// Points of the unit disc at which texels in a penumbra look.
@group(0) @binding(5) var<storage, read> discs: array<vec2f>;
@group(0) @binding(6) var<storage, read_write> shadow_rays: array<ScatteredRay>;
@group(0) @binding(7) var<storage, read> passed: array<f32>;
// The share of the light that each texel sees; UNLIT where its light does not arrive.
@group(0) @binding(8) var<storage, read_write> shares: array<f32>;
// Number of texels in a penumbra, and which.
@group(0) @binding(9) var<storage, read_write> penumbra_count: atomic<u32>;
@group(0) @binding(10) var<storage, read_write> penumbra: array<u32>;
// Irradiance / pi of all lights so far.
@group(0) @binding(11) var<storage, read_write> lit: array<vec4f>;
// Shares of the two lights that have bytes of their own; seen and whole brightness of the others.
@group(0) @binding(12) var<storage, read_write> seen: array<vec4f>;

// Texels look at points of the light's disc, and not at its centre.
const SOFT: u32 = 1;
// Nothing blocks the light.
const UNBLOCKED: u32 = 2;

const UNLIT: f32 = -1.0;
// Points of a light that a texel in a penumbra looks at.
const POINTS: u32 = 16;
// Reach of the comparison with neighbours, texels, and the side of their square.
const REACH: i32 = 2;
const SQUARE: u32 = 5;
const NO_END: f32 = 3.4e38;

// Irradiance / pi of the light if nothing blocked it.
fn unblocked(texel: LitTexel) -> vec3f {
    let arriving = incident(lights[shadow.light], texel.position);
    let by_pi = arriving.irradiance * (max(dot(texel.normal, arriving.to_light), 0.0) / PI);
    return select(vec3f(0.0), by_pi, texel.exists);
}

// The ray to a point of the light; none where its light does not arrive or the surface turns away.
fn ray_to(texel: LitTexel, disc: vec2f, is_lit: bool) -> ScatteredRay {
    let light = lights[shadow.light];
    var center = -light.direction;
    var radius = shadow.radius;
    var most = NO_END;
    if light.kind != 0u {
        center = light.position - texel.start;
        radius = min(radius, length(center) * 0.99);
        most = 1.0;
    }
    var direction = center;
    let length = length(center);
    if radius > 0.0 && any(disc != vec2f(0.0)) {
        let pair = orthonormal_pair(select(vec3f(0.0, 1.0, 0.0), center / length, length > 0.0));
        direction += (pair.first * disc.x + pair.second * disc.y) * radius;
    }
    let goes = is_lit && may_leave(texel, direction);
    return ScatteredRay(texel.start, select(0.0, most, goes), direction, 0u);
}

@compute @workgroup_size(64)
fn first_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let texel = texel_at(at);
    let is_lit = any(unblocked(texel) != vec3f(0.0));
    let disc = select(vec2f(0.0), discs[slot_of(at) * POINTS / 64u], (shadow.flags & SOFT) != 0u);
    shadow_rays[at] = ray_to(texel, disc, is_lit);
    shares[at] = select(UNLIT, f32((shadow.flags & UNBLOCKED) >> 1u), is_lit);
}

@compute @workgroup_size(64)
fn first_shares(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    if shadow_rays[at].most > 0.0 {
        shares[at] = passed[at];
    }
}

// Lists the texels that see other things than lit texels around them on the same surface.
@compute @workgroup_size(64)
fn find_penumbras(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let share = shares[at];
    if share == UNLIT {
        return;
    }
    let texel = texel_at(at);
    let place = vec2i(i32(at % tile.size.x), i32(at / tile.size.x));
    var is_mixed = false;
    // The bound is no constant. Quirk: unrolled-loops.
    for (var i = 0u; i < min(SQUARE * SQUARE, arrayLength(&shares)); i++) {
        let there = place + vec2i(i32(i % SQUARE), i32(i / SQUARE)) - REACH;
        if all(there >= vec2i(0)) && all(there < vec2i(tile.size)) {
            let other = u32(there.y) * tile.size.x + u32(there.x);
            let theirs = shares[other];
            if theirs != UNLIT && theirs != share && !is_mixed {
                is_mixed = agrees(texel, texel_at(other));
            }
        }
    }
    if is_mixed {
        penumbra[atomicAdd(&penumbra_count, 1u)] = at;
    }
}

// Rays of the texels in a penumbra, all points of the light for each.
@compute @workgroup_size(64)
fn penumbra_rays(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let ray = index_of(group, groups, lane);
    if ray >= arrayLength(&shadow_rays) {
        return;
    }
    let entry = shadow.first + ray / POINTS;
    if entry >= atomicLoad(&penumbra_count) {
        shadow_rays[ray].most = 0.0;
        return;
    }
    shadow_rays[ray] = ray_to(texel_at(penumbra[entry]), discs[ray % POINTS], true);
}

@compute @workgroup_size(64)
fn penumbra_shares(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    let entry = shadow.first + at;
    let first = at * POINTS;
    if first + POINTS > arrayLength(&shadow_rays) || entry >= atomicLoad(&penumbra_count) {
        return;
    }
    var sum = 0.0;
    for (var point = 0u; point < POINTS; point++) {
        sum += select(0.0, passed[first + point], shadow_rays[first + point].most > 0.0);
    }
    shares[penumbra[entry]] = sum / f32(POINTS);
}

// Adds the light's irradiance, as far as it is seen.
@compute @workgroup_size(64)
fn add_light(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let whole = unblocked(texel_at(at));
    let share = max(shares[at], 0.0);
    lit[at] += vec4f(whole * share, 0.0);
    let byte = lights[shadow.light].visibility_byte;
    let brightness = whole.r + whole.g + whole.b;
    var sums = seen[at];
    if byte == 0u {
        sums.x = share;
    } else if byte == 1u {
        sums.y = share;
    } else {
        sums.z += brightness * share;
        sums.w += brightness;
    }
    seen[at] = sums;
}

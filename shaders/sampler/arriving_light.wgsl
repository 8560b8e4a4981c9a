// Program of `sampler/src/passes/arriving_light.rs`: all light that arrives at the texels of a tile, as `add_direct.wgsl` and
// `resolve_sample.wgsl` read it.

import package::shared::lit_texel::{LitTexel, SkySums, index_of, texel_at, texel_count};
import package::shared::shading::{Lighting, PI, sky_ambient};

// Where the sky's light comes from.
struct ArrivingQuery {
    // Columns of `sky_table`: directions around.
    columns: u32,
}

@group(0) @binding(3) var<uniform> arriving_query: ArrivingQuery;
@group(0) @binding(4) var<uniform> lighting: Lighting;
@group(0) @binding(5) var<storage, read> lit: array<vec4f>;
@group(0) @binding(6) var<storage, read> seen: array<vec4f>;
@group(0) @binding(7) var<storage, read> sky_sums: array<SkySums>;
// Irradiance / pi of the open sky for normals from straight down to straight up: rows of so many directions around.
@group(0) @binding(8) var<storage, read> sky_table: array<vec4f>;
// The share of the sky that texels see by light cells; irradiance / pi of emitters, and of other surfaces.
@group(0) @binding(9) var<storage, read> sky_share: array<vec4f>;
@group(0) @binding(10) var<storage, read> emitted: array<vec4f>;
@group(0) @binding(11) var<storage, read> indirect: array<vec4f>;
@group(0) @binding(12) var<storage, read_write> arriving: array<vec4u>;

// Whether rays were cast to the sky, or its share looked up; whether there are emitters, and light of other surfaces; whether w is
// asked for.
override has_sky_rays: bool = false;
override has_sky_share: bool = false;
override has_emitted: bool = false;
override has_indirect: bool = false;
override is_glossy: bool = false;

const INTERVALS: u32 = 64;

// Irradiance / pi of the open sky: `SkyIrradiance` of `sampler/src/light/sky.rs`.
fn open_sky(normal: vec3f) -> vec3f {
    let height = (clamp(normal.y, -1.0, 1.0) + 1.0) * 0.5 * f32(INTERVALS);
    let row = min(u32(height), INTERVALS - 1u);
    let columns = arriving_query.columns;
    let turn = atan2(normal.x, -normal.z) / (2.0 * PI);
    let across = select((turn - floor(turn)) * f32(columns), 0.0, columns == 1u);
    let left = min(u32(across), columns - 1u);
    let right = (left + 1u) % columns;
    let share = across - f32(left);
    let lower = mix(sky_table[row * columns + left], sky_table[row * columns + right], share);
    let upper = mix(sky_table[(row + 1u) * columns + left], sky_table[(row + 1u) * columns + right], share);
    return mix(lower, upper, height - f32(row)).rgb;
}

fn ratio(seen_sky: vec3f, whole: vec3f) -> vec3f {
    return select(vec3f(0.0), seen_sky / whole, whole > vec3f(0.0));
}

@compute @workgroup_size(64)
fn sum_light(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let texel = texel_at(at);
    if !texel.exists {
        arriving[at] = vec4u(0u);
        return;
    }
    var sum = lit[at].rgb;
    var share = vec3f(1.0);
    if has_sky_rays {
        share = ratio(sky_sums[at].seen.rgb, sky_sums[at].whole.rgb);
        sum += open_sky(texel.normal) * share;
    } else if has_sky_share {
        share = sky_share[at].rgb;
        sum += open_sky(texel.normal) * share;
    } else {
        sum += sky_ambient(lighting, texel.normal);
    }
    if has_emitted {
        sum += emitted[at].rgb;
    }
    if has_indirect {
        sum += indirect[at].rgb;
    }
    var word = 0xffffffffu;
    let sky_byte = u32(saturate((share.r + share.g + share.b) / 3.0) * 255.0 + 0.5);
    if is_glossy {
        let sums = seen[at];
        let others = select(1.0, sums.z / sums.w, sums.w > 0.0);
        let bytes = vec3u(saturate(vec3f(sums.xy, others)) * 255.0 + 0.5);
        word = bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | (sky_byte << 24u);
    }
    arriving[at] = vec4u(bitcast<vec3u>(sum), word);
}

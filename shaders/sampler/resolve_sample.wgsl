// Program of `sampler/src/passes/resolve_sample.rs`: quantises texels. Where sub-samples were shaded, those of the
// dominant surface are averaged first.

import package::shared::dominant::{MOST_SUB_SAMPLES, dominant, same_surface};
import package::shared::encode::{octahedral_from_unit, rgb9e5_from_radiance, unit_from_octahedral};

struct ResolveSample {
    // Texels of the tile.
    size: vec2u,
    // Position of the tile's first texel in the planes.
    offset: vec2u,
    // Texels from one row of the planes to the next.
    stride: u32,
    // Mantissa bits of a stored inverse range, 1 to 23.
    range_bits: u32,
    // 0: Rgb9e5Ufloat, one word a texel; 1: Rgba16Float, two.
    half_float: u32,
    // Elements of `shaded` from one row to the next.
    shaded_stride: u32,
}

// Shaded sub-samples along a texel's side, at most four; 1 if texels were shaded. Constant, so that they stay in
// registers.
override side: u32 = 2u;
// Samples have a Reflector plane.
override reflects: bool = false;
// Samples have a LightVisibility plane; they were shaded once a texel.
override light_seen: bool = false;

@group(0) @binding(0) var<uniform> resolve: ResolveSample;
@group(0) @binding(1) var<storage, read> shaded: array<vec4f>;
@group(0) @binding(2) var<storage, read> gloss: array<vec2u>;
@group(0) @binding(3) var<storage, read_write> radiance_plane: array<u32>;
@group(0) @binding(4) var<storage, read_write> inverse_range_plane: array<u32>;
@group(0) @binding(5) var<storage, read_write> normal_plane: array<u32>;
@group(0) @binding(6) var<storage, read_write> specular_plane: array<u32>;
@group(0) @binding(7) var<storage, read> reflectors: array<u32>;
@group(0) @binding(8) var<storage, read_write> reflector_plane: array<u32>;
// Light that reaches each texel; w has the bits of a LightVisibility texel.
@group(0) @binding(9) var<storage, read> arriving: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> light_visibility_plane: array<u32>;

// Index of a texel's sub-sample in `shaded`.
fn address(texel: vec2u, i: u32) -> u32 {
    let at = texel * side + vec2u(i % side, i / side);
    return at.y * resolve.shaded_stride + at.x;
}

// Inverse range of the texel's dominant surface.
fn winner(texel: vec2u) -> f32 {
    if side == 1u {
        return shaded[address(texel, 0u)].w;
    }
    var inverse: array<f32, MOST_SUB_SAMPLES>;
    for (var i = 0u; i < side * side; i++) {
        inverse[i] = shaded[address(texel, i)].w;
    }
    return dominant(&inverse, side * side);
}

// Largest difference of roughness between averaged lobes; beyond it the rougher ones are taken. A mean roughness of lake
// and shore would shine where neither does.
const ALIKE: f32 = 0.25;

// Rounds to nearest and clears the lower mantissa bits, so that the wire compresses better.
fn rounded(inverse_range: f32) -> u32 {
    let drop = 23u - resolve.range_bits;
    let half = select(0u, 1u << (max(drop, 1u) - 1u), drop > 0u);
    return ((bitcast<u32>(inverse_range) + half) >> drop) << drop;
}

fn write_texel(texel: vec2u, radiance: vec3f, inverse_range: f32) -> u32 {
    let at = (resolve.offset.y + texel.y) * resolve.stride + resolve.offset.x + texel.x;
    if resolve.half_float == 0u {
        radiance_plane[at] = rgb9e5_from_radiance(radiance);
    } else {
        let held = clamp(radiance, vec3f(0.0), vec3f(65504.0));
        radiance_plane[2u * at] = pack2x16float(held.rg);
        radiance_plane[2u * at + 1u] = pack2x16float(vec2f(held.b, 1.0));
    }
    inverse_range_plane[at] = rounded(inverse_range);
    return at;
}

@compute @workgroup_size(8, 8)
fn resolve_matt(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= resolve.size) {
        return;
    }
    let chosen = winner(id.xy);
    var sum = vec4f(0.0);
    var members = 0.0;
    for (var i = 0u; i < side * side; i++) {
        let sub_sample = shaded[address(id.xy, i)];
        if same_surface(chosen, sub_sample.w) {
            sum += sub_sample;
            members += 1.0;
        }
    }
    let mean = sum / max(members, 1.0);
    _ = write_texel(id.xy, mean.rgb, mean.w);
}

@compute @workgroup_size(8, 8)
fn resolve_glossy(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= resolve.size) {
        return;
    }
    let chosen = winner(id.xy);
    var roughest = 0.0;
    for (var i = 0u; i < side * side; i++) {
        let at = address(id.xy, i);
        let roughness = unpack4x8unorm(gloss[at].y).a;
        roughest = max(roughest, select(0.0, roughness, same_surface(chosen, shaded[at].w)));
    }
    var sum = vec4f(0.0);
    var normal = vec3f(0.0);
    var specular = vec4f(0.0);
    // A surface has one probe; at edges of objects the greatest word is taken.
    var reflector = 0u;
    var members = 0.0;
    var alike = 0.0;
    for (var i = 0u; i < side * side; i++) {
        let at = address(id.xy, i);
        let sub_sample = shaded[at];
        if same_surface(chosen, sub_sample.w) {
            sum += sub_sample;
            members += 1.0;
            let lobe = gloss[at];
            let stored = unpack4x8unorm(lobe.y);
            if stored.a >= roughest - ALIKE {
                normal += unit_from_octahedral(unpack2x16snorm(lobe.x));
                specular += stored;
                alike += 1.0;
            }
            if reflects {
                reflector = max(reflector, reflectors[at]);
            }
        }
    }
    let mean = sum / max(members, 1.0);
    let at = write_texel(id.xy, mean.rgb, mean.w);
    let sky = !(mean.w > 0.0);
    let octahedral = pack2x16snorm(octahedral_from_unit(normal / max(length(normal), 1e-12)));
    normal_plane[at] = select(octahedral, 0u, sky);
    specular_plane[at] = select(pack4x8unorm(specular / max(alike, 1.0)), 0u, sky);
    if reflects {
        reflector_plane[at] = select(reflector, 0u, sky);
    }
    if light_seen {
        light_visibility_plane[at] = bitcast<u32>(arriving[address(id.xy, 0u)].w);
    }
}

// Texture sampling by the rule of `scene/src/texture.rs`, from texels in one linear address space.
//
// Each level of each texture is a run of texels. The address space is folded into the rows and layers of one texture array.
// So no texture is resized, and any number of textures of any size fit. Filtering in the shader is exact; a filtering unit
// would round weights to 8 bits.

// Base-2 logarithms of the texels of a row and of a layer.
const TEXEL_ROW_BITS: u32 = 11;
const TEXEL_LAYER_BITS: u32 = 22;

const WRAP_REPEAT: u32 = 0;
const WRAP_CLAMP: u32 = 1;

// A material's reference to a texture. The fields are vectors of four. Quirk: slow-scalars.
struct TextureSlot {
    // Rows of the linear part of the transform from a mesh's uv to the texture's.
    texture_from_uv: vec4f,
    // Translation of that transform; z and w are unused.
    offset: vec4f,
    // Width and height of level 0, texels; index of level 0 in `texel_levels`; number of levels.
    extent: vec4u,
    // Addressing of u and v: 0 repeat, 1 clamp, 2 mirror; role in the material: one of the ROLE constants below; bits of the
    // READS constants below.
    usage: vec4u,
}

const ROLE_BASE_COLOR: u32 = 0;
const ROLE_EMISSIVE: u32 = 1;
const ROLE_METALLIC_ROUGHNESS: u32 = 2;
const ROLE_NORMAL: u32 = 3;
const ROLE_TRANSMISSION: u32 = 4;
const ROLE_SPECULAR: u32 = 5;
const ROLE_SPECULAR_COLOR: u32 = 6;
const ROLE_NONE: u32 = 7;

// Level 0 shows the texel that a point lies in.
const READS_NEAREST: u32 = 1;
// The mesh's second set of texture coordinates is transformed.
const READS_SECOND_UVS: u32 = 2;

// Features of the scene's textures, constants for the reason that `shared/surface.wgsl` gives.
override has_nearest_textures: bool = true;
override has_second_uvs: bool = true;

// References of all materials. Those of one material are adjacent.
@group(1) @binding(6) var<storage, read> slots: array<TextureSlot>;
// Address of the first texel of each level of each texture.
@group(1) @binding(7) var<storage, read> texel_levels: array<u32>;
// The stored texels.
@group(1) @binding(8) var texels: texture_2d_array<f32>;
// A view of the stored texels that decodes sRGB colours.
@group(1) @binding(9) var texels_srgb: texture_2d_array<f32>;

// Transforms a difference of a mesh's uv to the texture's.
fn transform_duv(slot: TextureSlot, duv: vec2f) -> vec2f {
    return vec2f(dot(slot.texture_from_uv.xy, duv), dot(slot.texture_from_uv.zw, duv));
}

// Transforms a mesh's uv to the texture's.
fn transform_uv(slot: TextureSlot, uv: vec2f) -> vec2f {
    return transform_duv(slot, uv) + slot.offset.xy;
}

// The mip level of a pixel, by the differences of transformed uv across it.
fn texture_level(slot: TextureSlot, duv_dx: vec2f, duv_dy: vec2f) -> f32 {
    let size = vec2f(slot.extent.xy);
    let texels_squared = max(dot(duv_dx * size, duv_dx * size), dot(duv_dy * size, duv_dy * size));
    if !(texels_squared > 1.0) {
        return 0.0;
    }
    // Bounded, so that infinite differences give the last level.
    return min(0.5 * log2(min(texels_squared, 1e38)), f32(slot.extent.w - 1));
}

// Two texels of a row or column, and the weight of the second.
struct Taps {
    first: u32,
    second: u32,
    fraction: f32,
}

// The two texels of a row or column around a coordinate.
fn taps(coordinate: f32, side: u32, wrap: u32) -> Taps {
    // A coordinate that is not finite counts as 0.
    var c = select(0.0, coordinate, abs(coordinate) < 1e38);
    if wrap == WRAP_REPEAT {
        c -= floor(c);
    } else if wrap == WRAP_CLAMP {
        c = saturate(c);
    } else {
        c -= 2.0 * floor(c * 0.5);
        c = select(c, 2.0 - c, c > 1.0);
    }
    let x = c * f32(side) - 0.5;
    let floored = floor(x);
    let last = i32(side) - 1;
    let i = i32(floored);
    if wrap == WRAP_REPEAT {
        let first = select(i, last, i < 0);
        let second = select(i + 1, 0, i >= last);
        return Taps(u32(min(first, last)), u32(second), x - floored);
    }
    return Taps(u32(clamp(i, 0, last)), u32(clamp(i + 1, 0, last)), x - floored);
}

// Column, row and layer of an address.
fn texel_place(address: u32) -> vec3u {
    let column = address & ((1u << TEXEL_ROW_BITS) - 1u);
    let row = (address >> TEXEL_ROW_BITS) & ((1u << (TEXEL_LAYER_BITS - TEXEL_ROW_BITS)) - 1u);
    return vec3u(column, row, address >> TEXEL_LAYER_BITS);
}

fn texel(source: texture_2d_array<f32>, address: u32) -> vec4f {
    let place = texel_place(address);
    return textureLoad(source, place.xy, place.z, 0);
}

fn bilinear(source: texture_2d_array<f32>, slot: TextureSlot, uv: vec2f, level: u32) -> vec4f {
    let size = max(slot.extent.xy >> vec2u(level), vec2u(1u));
    var x = taps(uv.x, size.x, slot.usage.x);
    var y = taps(uv.y, size.y, slot.usage.y);
    if has_nearest_textures {
        let nearest = (slot.usage.w & READS_NEAREST) != 0u && level == 0u;
        x.fraction = select(x.fraction, step(0.5, x.fraction), nearest);
        y.fraction = select(y.fraction, step(0.5, y.fraction), nearest);
    }
    let base = texel_levels[slot.extent.z + level];
    let upper = base + y.first * size.x;
    let lower = base + y.second * size.x;
    let above = mix(texel(source, upper + x.first), texel(source, upper + x.second), x.fraction);
    let below = mix(texel(source, lower + x.first), texel(source, lower + x.second), x.fraction);
    return mix(above, below, y.fraction);
}

// Trilinear value at a mesh's uv, from either view of the texels.
fn sample_texture(
    source: texture_2d_array<f32>, slot: TextureSlot, uv: vec2f, duv_dx: vec2f, duv_dy: vec2f,
) -> vec4f {
    let at = transform_uv(slot, uv);
    let level = texture_level(slot, transform_duv(slot, duv_dx), transform_duv(slot, duv_dy));
    let fine = u32(level);
    let coarse = min(fine + 1u, slot.extent.w - 1u);
    return mix(bilinear(source, slot, at, fine), bilinear(source, slot, at, coarse), level - f32(fine));
}

// Alpha at a mesh's uv for an alpha test: always from level 0.
fn sample_alpha(slot: TextureSlot, uv: vec2f) -> f32 {
    return bilinear(texels, slot, transform_uv(slot, uv), 0u).a;
}

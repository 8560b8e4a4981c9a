// Alpha and transmission where rays meet triangles: `sampler/src/packets/cutouts.rs`, from its own texels.

import package::shared::texture::{Taps, taps};

// How much a surface hides, by its texture.
struct SurfaceMask {
    // Rows of the linear part of the transform from a mesh's uv to the texture's.
    texture_from_uv: vec4f,
    // Translation of that transform.
    offset: vec2f,
    // Factor of the texture, and the alpha below which the surface does not hide all.
    factor: f32,
    cutoff: f32,
    // Width and height of the texture; no texture if they are 0.
    size: vec2u,
    // Its first byte in `mask_texels`.
    first: u32,
    // Addressing of u and v (0 repeat, 1 clamp, 2 mirror; bits 0 to 1 and 2 to 3) and the bits below.
    kind: u32,
}

// The texel in which a point lies is read.
const MASK_NEAREST: u32 = 16;
// Below the cutoff the surface hides as much as its alpha says; otherwise nothing.
const MASK_BLENDS: u32 = 32;
// The texture says how much light passes; light passes where that is half or more.
const MASK_OF_LIGHT: u32 = 64;

// The corners of a triangle whose surface has a mask.
struct MaskTriangle {
    uv_a: vec2f,
    uv_b: vec2f,
    uv_c: vec2f,
    // Index in `masks`.
    mask: u32,
    // 1 if the next record is of the same triangle.
    has_more: u32,
    // Alpha of the corners.
    alpha: vec3f,
    // 1 if the corners have an alpha.
    has_alpha: u32,
}

@group(1) @binding(4) var<storage, read> masks: array<SurfaceMask>;
@group(1) @binding(5) var<storage, read> mask_triangles: array<MaskTriangle>;
// A byte a texel.
@group(1) @binding(6) var<storage, read> mask_texels: array<u32>;

fn mask_texel(address: u32) -> f32 {
    return f32((mask_texels[address >> 2u] >> ((address & 3u) * 8u)) & 255u) / 255.0;
}

// The value of a mask's texture at a mesh's uv, bilinear.
fn mask_value(mask: SurfaceMask, uv: vec2f) -> f32 {
    if mask.size.x == 0u {
        return 1.0;
    }
    let at = vec2f(dot(mask.texture_from_uv.xy, uv), dot(mask.texture_from_uv.zw, uv)) + mask.offset;
    var x = taps(at.x, mask.size.x, mask.kind & 3u);
    var y = taps(at.y, mask.size.y, (mask.kind >> 2u) & 3u);
    let nearest = (mask.kind & MASK_NEAREST) != 0u;
    x.fraction = select(x.fraction, step(0.5, x.fraction), nearest);
    y.fraction = select(y.fraction, step(0.5, y.fraction), nearest);
    let upper = mask.first + y.first * mask.size.x;
    let lower = mask.first + y.second * mask.size.x;
    let above = mix(mask_texel(upper + x.first), mask_texel(upper + x.second), x.fraction);
    let below = mix(mask_texel(lower + x.first), mask_texel(lower + x.second), x.fraction);
    return mix(above, below, y.fraction);
}

// The share of what is behind it that a record's triangle hides at the weights of its mesh's second and third corner.
fn hidden_by(record: MaskTriangle, weights: vec2f, of_light: bool) -> f32 {
    let mask = masks[record.mask];
    let w = vec3f(1.0 - weights.x - weights.y, weights);
    let value = mask_value(mask, record.uv_a * w.x + record.uv_b * w.y + record.uv_c * w.z);
    if (mask.kind & MASK_OF_LIGHT) != 0u {
        return select(1.0, 0.0, of_light && mask.factor * value >= 0.5);
    }
    let alpha = mask.factor * select(1.0, dot(record.alpha, w), record.has_alpha == 1u) * value;
    let share = select(0.0, alpha, (mask.kind & MASK_BLENDS) != 0u && alpha > 0.0);
    return select(share, 1.0, alpha >= mask.cutoff);
}

// The share of what is behind it that a triangle hides. `first`: its first record.
fn hidden_share(first: u32, weights: vec2f, of_light: bool) -> f32 {
    let record = mask_triangles[first];
    var hidden = hidden_by(record, weights, of_light);
    if record.has_more == 1u {
        hidden *= hidden_by(mask_triangles[first + 1u], weights, of_light);
    }
    return hidden;
}

// A number from 0 to below 1 for a place on a surface: `threshold` of `scene/src/transparency.rs`.
fn threshold(instance: u32, primitive: u32, weights: vec2f) -> f32 {
    let words = array<u32, 4>(instance, primitive, bitcast<u32>(weights.x), bitcast<u32>(weights.y));
    var hash = 0u;
    for (var i = 0u; i < 4u; i++) {
        let state = (hash ^ words[i]) * 747796405u + 2891336453u;
        let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
        hash = (word >> 22u) ^ word;
    }
    return f32(hash >> 8u) / 16777216.0;
}

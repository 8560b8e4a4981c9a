// Program of compositor/src/passes/mips.rs: a mip level of a sample's radiance from the next finer one. A texel averages
// those of four finer texels that belong to one surface. An average across a silhouette would smear the foreground onto
// the background.
//
// Each level of radiance has a level of the display plane: the exposed sRGB colour, a byte a channel, and whether the
// surface is glossy. Most pixels need nothing else. Quirk: slow-shared-exponents.

import package::shared::encode::{display_from_radiance, rgb9e5_from_radiance};

struct Mips {
    // Sizes of this level and of the finer one, texels.
    size: vec2u,
    finer: vec2u,
    layer: u32,
    // 1 if the finer level's inverse ranges are the sample's plane; 0 if they are in `ranges`.
    from_sample: u32,
    // Index of the first inverse range of the finer level, and of this level.
    finer_range: u32,
    range: u32,
    // First word of this level's texels, and words from one row to the next.
    word: u32,
    pitch: u32,
    exposure: f32,
    // 1 if the samples have a Specular plane.
    glossy: u32,
    // First row of the dispatch.
    first_row: u32,
}

var<immediate> mips: Mips;

// Texels are two words (half floats) rather than one (shared exponent).
override wide: bool = false;

@group(0) @binding(0) var inverse_range: texture_2d_array<f32>;
// The finer level.
@group(0) @binding(1) var radiance: texture_2d_array<f32>;
@group(0) @binding(2) var<storage, read_write> ranges: array<f32>;
@group(0) @binding(3) var<storage, read_write> words: array<u32>;
// Another plane if samples have no Specular plane; then it is not read.
@group(0) @binding(5) var specular: texture_2d_array<f32>;
// This level of the display plane.
@group(0) @binding(4) var display: texture_storage_2d_array<rgba8unorm, write>;

// Relative difference of inverse range within which two texels belong to one surface. Steep ground changes by less from
// texel to texel, most silhouettes by more.
const ONE_SURFACE: f32 = 0.05;

fn range_at(texel: vec2u) -> f32 {
    if mips.from_sample != 0u {
        return textureLoad(inverse_range, texel, mips.layer, 0).x;
    }
    return ranges[mips.finer_range + texel.y * mips.finer.x + texel.x];
}

// 1 for each of four inverse ranges that belongs to the surface of `one`, otherwise 0.
fn like(four: vec4f, one: f32) -> vec4f {
    return select(vec4f(0.0), vec4f(1.0), abs(four - one) <= vec4f(ONE_SURFACE * one));
}

// Stores a texel of the display plane.
fn store_display(texel: vec2u, mean: vec3f) {
    // One of the finest texels inside this texel.
    let size = vec2f(textureDimensions(specular));
    let place = vec2u((vec2f(texel) + 0.5) / vec2f(mips.size) * size);
    let lobe = textureLoad(specular, select(vec2u(0u), place, mips.glossy != 0u), mips.layer, 0).rgb;
    let is_glossy = mips.glossy != 0u && any(lobe > vec3f(0.0));
    let shown = unpack4x8unorm(display_from_radiance(mean, mips.exposure)).rgb;
    textureStore(display, texel, mips.layer, vec4f(shown, select(0.0, 1.0, is_glossy)));
}

// Makes the finest level of the display plane.
@compute @workgroup_size(8, 8)
fn display_rows(@builtin(global_invocation_id) id: vec3u) {
    let texel = id.xy + vec2u(0u, mips.first_row);
    if all(texel < mips.size) {
        store_display(texel, textureLoad(radiance, texel, mips.layer, 0).rgb);
    }
}

@compute @workgroup_size(8, 8)
fn coarsen(@builtin(global_invocation_id) id: vec3u) {
    let texel = id.xy + vec2u(0u, mips.first_row);
    if any(texel >= mips.size) {
        return;
    }
    // The four texels around this texel's centre. Levels of odd sides do not nest.
    let center = (vec2f(texel) + 0.5) * vec2f(mips.finer) / vec2f(mips.size);
    let first = min(vec2u(max(center - 0.5, vec2f(0.0)) + 1e-3), mips.finer - 1u);
    let last = min(first + 1u, mips.finer - 1u);
    let a = first;
    let b = vec2u(last.x, first.y);
    let c = vec2u(first.x, last.y);
    let d = last;
    let four = vec4f(range_at(a), range_at(b), range_at(c), range_at(d));
    // The surface of most texels; of equals, the nearer one.
    var mask = like(four, four.x);
    var range = four.x;
    for (var i = 1u; i < 4u; i++) {
        let other = like(four, four[i]);
        let more = dot(other, vec4f(1.0)) - dot(mask, vec4f(1.0));
        if more > 0.0 || (more == 0.0 && four[i] > range) {
            mask = other;
            range = four[i];
        }
    }
    let count = max(dot(mask, vec4f(1.0)), 1.0);
    // A NaN is unlike all inverse ranges, itself included, so its texel stays black.
    var sum = mask.x * textureLoad(radiance, a, mips.layer, 0).rgb;
    sum += mask.y * textureLoad(radiance, b, mips.layer, 0).rgb;
    sum += mask.z * textureLoad(radiance, c, mips.layer, 0).rgb;
    sum += mask.w * textureLoad(radiance, d, mips.layer, 0).rgb;
    let mean = sum / count;
    ranges[mips.range + texel.y * mips.size.x + texel.x] = dot(mask, select(vec4f(0.0), four, mask > vec4f(0.0))) / count;
    store_display(texel, mean);
    if wide {
        let at = mips.word + texel.y * mips.pitch + 2u * texel.x;
        words[at] = pack2x16float(mean.rg);
        words[at + 1u] = pack2x16float(vec2f(mean.b, 1.0));
    } else {
        words[mips.word + texel.y * mips.pitch + texel.x] = rgb9e5_from_radiance(mean);
    }
}

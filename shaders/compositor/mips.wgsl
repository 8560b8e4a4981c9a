// Program of compositor/src/passes/mips.rs: a coarser level of a sample's radiance from the next finer one. Each texel
// averages those of four that are of one surface, as the sampler's texels do (one surface a texel): radiance averaged
// across a silhouette would smear the foreground onto what is behind it.
//
// Beside each level of radiance lies one of the display plane: what a view shows of the texel, exposed and in sRGB, a byte
// each, and whether it reflects what depends on the viewer. Software filters bytes at a quarter of what shared exponents
// cost, and most pixels of a view need nothing else.

import package::shared::encode::{display_from_radiance, rgb9e5_from_radiance};

struct Mips {
    // Texels of this level and of the finer one.
    size: vec2u,
    finer: vec2u,
    layer: u32,
    // The inverse ranges of the finer level are the sample's own; else they are in `ranges`.
    from_sample: u32,
    // First of the finer level's inverse ranges and of this level's.
    finer_range: u32,
    range: u32,
    // First word of this level's texels, and words from row to row.
    word: u32,
    pitch: u32,
    exposure: f32,
    // The samples carry what specular needs.
    glossy: u32,
    // Where a dispatch begins.
    first_row: u32,
}

var<immediate> mips: Mips;

// Texels are two words, halves, rather than one, shared exponent.
override wide: bool = false;

@group(0) @binding(0) var inverse_range: texture_2d_array<f32>;
// The finer level alone.
@group(0) @binding(1) var radiance: texture_2d_array<f32>;
@group(0) @binding(2) var<storage, read_write> ranges: array<f32>;
@group(0) @binding(3) var<storage, read_write> words: array<u32>;
// This level alone.
// Any other where samples have none, and not looked at.
@group(0) @binding(5) var specular: texture_2d_array<f32>;
@group(0) @binding(4) var display: texture_storage_2d_array<rgba8unorm, write>;

// Relative difference of inverse range within which two texels are of one surface: more than the steepest ground that is
// worth averaging changes from texel to texel, less than most silhouettes.
const ONE_SURFACE: f32 = 0.05;

fn range_at(texel: vec2u) -> f32 {
    if mips.from_sample != 0u {
        return textureLoad(inverse_range, texel, mips.layer, 0).x;
    }
    return ranges[mips.finer_range + texel.y * mips.finer.x + texel.x];
}

// Which of four inverse ranges are of the surface of one of them, a bit each.
fn like(four: vec4f, one: f32) -> vec4f {
    return select(vec4f(0.0), vec4f(1.0), abs(four - one) <= vec4f(ONE_SURFACE * one));
}

// What a view shows of a texel of this level.
fn store_display(texel: vec2u, mean: vec3f) {
    // One of the finest texels within.
    let size = vec2f(textureDimensions(specular));
    let place = vec2u((vec2f(texel) + 0.5) / vec2f(mips.size) * size);
    let lobe = textureLoad(specular, select(vec2u(0u), place, mips.glossy != 0u), mips.layer, 0).rgb;
    let is_glossy = mips.glossy != 0u && any(lobe > vec3f(0.0));
    let shown = unpack4x8unorm(display_from_radiance(mean, mips.exposure)).rgb;
    textureStore(display, texel, mips.layer, vec4f(shown, select(0.0, 1.0, is_glossy)));
}

// The finest level of the display plane.
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
    // The four around this texel's centre: where a side is odd, levels do not nest.
    let center = (vec2f(texel) + 0.5) * vec2f(mips.finer) / vec2f(mips.size);
    let first = min(vec2u(max(center - 0.5, vec2f(0.0)) + 1e-3), mips.finer - 1u);
    let last = min(first + 1u, mips.finer - 1u);
    let a = first;
    let b = vec2u(last.x, first.y);
    let c = vec2u(first.x, last.y);
    let d = last;
    let four = vec4f(range_at(a), range_at(b), range_at(c), range_at(d));
    // The surface that covers most of them; of two that cover as much, the nearer.
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
    // An inverse range that is no number is like none, not even itself: its texel stays black.
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

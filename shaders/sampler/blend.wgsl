// Program of `sampler/src/passes/blend.rs`: blends shaded layers over what is behind them. A layer hides the share alpha of it.

struct Blend {
    // Columns and rows of the layer's image.
    size: vec2u,
    // Its first element in the image that it is blended over.
    offset: vec2u,
    // Columns of that image.
    stride: u32,
}

// Samples have a Reflector plane.
override reflects: bool = false;
// Samples have a LightVisibility plane.
override light_seen: bool = false;

@group(0) @binding(0) var<uniform> blend: Blend;
// 0 without a layer, negative for the layer that the ray shows.
@group(0) @binding(1) var<storage, read> alphas: array<f32>;
// Radiance, and inverse range in w.
@group(0) @binding(2) var<storage, read> layer: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> shaded: array<vec4f>;

// Only of glossy samples, as in resolve_sample.wgsl.
@group(0) @binding(4) var<storage, read> layer_gloss: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> gloss: array<vec2u>;
@group(0) @binding(6) var<storage, read> layer_reflectors: array<u32>;
@group(0) @binding(7) var<storage, read_write> reflectors: array<u32>;
@group(0) @binding(8) var<storage, read> layer_arriving: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> arriving: array<vec4f>;

// Where an element of the layer's image lies behind it.
fn behind(place: vec2u) -> u32 {
    return (blend.offset.y + place.y) * blend.stride + blend.offset.x + place.x;
}

// Blends radiance. The inverse range becomes that of the layer, if the ray shows it.
fn blend_radiance(source: u32, target_at: u32, alpha: f32) {
    let below = shaded[target_at];
    let above = layer[source];
    let radiance = mix(below.rgb, above.rgb, abs(alpha));
    shaded[target_at] = vec4f(radiance, select(below.w, above.w, alpha < 0.0));
}

@compute @workgroup_size(8, 8)
fn blend_matt(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= blend.size) {
        return;
    }
    let source = id.y * blend.size.x + id.x;
    let alpha = alphas[source];
    if alpha != 0.0 {
        blend_radiance(source, behind(id.xy), alpha);
    }
}

// Blends texels of a sample with gloss. What the viewer adds is that of the surface that the ray shows, at its share.
@compute @workgroup_size(8, 8)
fn blend_glossy(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= blend.size) {
        return;
    }
    let source = id.y * blend.size.x + id.x;
    let target_at = behind(id.xy);
    let alpha = alphas[source];
    if alpha == 0.0 {
        return;
    }
    blend_radiance(source, target_at, alpha);
    let is_shown = alpha < 0.0;
    let lobe = select(gloss[target_at], layer_gloss[source], is_shown);
    let share = select(1.0 - alpha, -alpha, is_shown);
    gloss[target_at] = vec2u(lobe.x, pack4x8unorm(unpack4x8unorm(lobe.y) * vec4f(vec3f(share), 1.0)));
    if is_shown && reflects {
        reflectors[target_at] = layer_reflectors[source];
    }
    if is_shown && light_seen {
        arriving[target_at].w = layer_arriving[source].w;
    }
}

// The depth-corrected fetch that both searches end in: a view's pixel, at the depth a search found for it, is
// looked up in every sample of the plan; a sample serves the pixel where the range it stores agrees.

import package::shared::camera::{Pinhole, Seen, seen_by_cube, seen_by_pinhole};

// A sample as the pixels of one view look it up.
struct ViewSample {
    u_from_world: vec3f,
    // Layer of the texture arrays.
    layer: u32,
    v_from_world: vec3f,
    w_from_world: vec3f,
    // The view's eye as seen from the sample's centre, metres, world axes.
    eye_from_center: vec3f,
}

// One view, or a piece of a large one. Directions are in world axes, at depth 1 along the view's axis;
// positions are relative to the eye.
struct ViewUniform {
    // Direction of the image's top left corner, then its change per pixel.
    corner: vec3f,
    sample_count: u32,
    right: vec3f,
    // Linear steps.
    steps: u32,
    down: vec3f,
    // First of this view's lights in `lights`.
    first_light: u32,
    bounds_min: vec3f,
    // Pixels on an edge of a splat cell.
    cell: f32,
    bounds_max: vec3f,
    // First of this piece's cells.
    first_cell: u32,
    // Image position of the piece's first pixel, in pixels.
    piece_origin: vec2f,
    // Where the piece lies in the target.
    target_origin: vec2f,
    // Cell column and row at which this piece's cells begin, in cells of the whole view.
    cell_origin: vec2i,
    // Columns of this piece's cells.
    cell_columns: i32,
    samples: array<ViewSample, 8>,
}

@group(0) @binding(0) var<uniform> view: ViewUniform;
@group(0) @binding(1) var inverse_range: texture_2d_array<f32>;
@group(0) @binding(2) var radiance: texture_2d_array<f32>;
@group(0) @binding(3) var nearest: sampler;
@group(0) @binding(4) var bilinear: sampler;

// Relative difference of range up to which a texel is taken for the surface that is looked for.
const AGREEMENT: f32 = 0.03;

// What the samples know of one point of a view ray.
struct Fetch {
    // Texture coordinates that fetch bilinearly from agreeing texels only.
    uv: vec2f,
    // Position in the plan's list.
    source: u32,
    layer: u32,
    // Share of the bilinear weights that agrees; 0 if no sample has the point. Texture coordinates, source
    // and layer are then a guess: the farthest texel that the first sample which looks there has around it.
    agreement: f32,
}

// Where sample i has the direction d.
fn seen_by_sample(i: u32, d: vec3f, omni: bool) -> Seen {
    if omni {
        return seen_by_cube(f32(textureDimensions(inverse_range).y) * 0.5, d);
    }
    let s = view.samples[i];
    return seen_by_pinhole(Pinhole(s.u_from_world, s.v_from_world, s.w_from_world), d);
}

// Finds the sample that serves the point at inverse depth q (1/metres, along the view's axis) in direction d.
//
// The first sample of the list with half of its weights in agreement is taken, else the one with most: the
// list's order is by nearness, and the nearest camera's texels are distorted least.
fn fetch_at(d: vec3f, q: f32, omni: bool) -> Fetch {
    var best = Fetch(vec2f(0.0), view.sample_count, 0u, 0.0);
    let size = vec2f(textureDimensions(inverse_range));
    for (var i = 0u; i < view.sample_count; i++) {
        let ray = d + view.samples[i].eye_from_center * q;
        let seen = seen_by_sample(i, ray, omni);
        // Inverse range that the sample has if it sees the point; 0, as for sky, at infinity.
        let expected = q * inverseSqrt(max(dot(ray, ray), 1e-30));
        let position = seen.uv * size - 0.5;
        let base = floor(position);
        let f = position - base;
        // In the middle of the four texels, so that no device's rounding of coordinates picks others.
        let four = textureGather(0, inverse_range, nearest, (base + 1.0) / size, view.samples[i].layer);
        let agrees = abs(four - expected) <= vec4f(AGREEMENT * expected);
        let bilinear_weights = vec4f((1.0 - f.x) * f.y, f.x * f.y, f.x * (1.0 - f.y), (1.0 - f.x) * (1.0 - f.y));
        let weights = select(vec4f(0.0), bilinear_weights, agrees);
        let agreement = dot(weights, vec4f(1.0));
        let better = agreement > best.agreement && best.agreement < 0.5;
        if seen.inside && (better || best.source == view.sample_count) {
            let offset = select(farthest_offset(four), agreeing_offset(weights, agreement), agreement > 0.0);
            best = Fetch((base + 0.5 + offset) / size, i, view.samples[i].layer, agreement);
        }
    }
    return best;
}

// Offset, in texels from the first of four, at which a bilinear fetch takes from those that have a weight
// (in the order of textureGather) and no other: their centre where they form a row, a column or all four,
// else the one with most.
fn agreeing_offset(weights: vec4f, sum: f32) -> vec2f {
    let center = vec2f(weights.y + weights.z, weights.x + weights.y) / max(sum, 1e-30);
    let implied = vec4f(
        (1.0 - center.x) * center.y, center.x * center.y, center.x * (1.0 - center.y),
        (1.0 - center.x) * (1.0 - center.y),
    );
    let leaked = dot(select(vec4f(0.0), implied, weights == vec4f(0.0)), vec4f(1.0));
    if leaked < 1e-3 {
        return center;
    }
    var most = weights.x;
    var at = vec2f(0.0, 1.0);
    if weights.y > most {
        most = weights.y;
        at = vec2f(1.0, 1.0);
    }
    if weights.z > most {
        most = weights.z;
        at = vec2f(1.0, 0.0);
    }
    if weights.w > most {
        at = vec2f(0.0, 0.0);
    }
    return at;
}

// Offset of the texel with the greatest range (in the order of textureGather).
fn farthest_offset(four: vec4f) -> vec2f {
    let least = min(min(four.x, four.y), min(four.z, four.w));
    let right = select(four.y, four.z, four.z < four.y) <= least;
    let below = select(four.x, four.y, four.y < four.x) <= least;
    return vec2f(select(0.0, 1.0, right), select(0.0, 1.0, below));
}

// The depth-corrected fetch that all searches end in: a view's pixel, at the depth a search found for it, is
// looked up in a sample, and taken from those of its texels whose range agrees.

import package::shared::camera::{Pinhole, Seen, in_pinhole, seen_by_cube, seen_by_pinhole};
import package::shared::shading::Lighting;
import package::shared::reflection_probes::ProbeUniform;

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
    // The view's axis, unit.
    forward: vec3f,
    // Relative difference of range up to which a texel is taken for the surface that is looked for.
    tolerance: f32,
    // Image position of the piece's first pixel, in pixels.
    piece_origin: vec2f,
    // Where the piece lies in the target.
    target_origin: vec2f,
    // Cell column and row at which this piece's cells begin, in cells of the whole view.
    cell_origin: vec2i,
    // Columns of this piece's cells.
    cell_columns: i32,
    // First of this piece's places in the list of pixels that are not settled.
    first_unsettled: u32,
    // Index of this piece among the chunk's.
    piece: u32,
    // Texels of a sample on the edge of a pixel, at equal distance from both.
    footprint: f32,
    // Columns and rows of the piece's pixels.
    piece_size: vec2u,
    lighting: Lighting,
    // Where maps of surroundings lie about the eye.
    probes: ProbeUniform,
    // So much that an array's elements lie at multiples of 256 bytes, as uniforms must.
    @size(560) samples: array<ViewSample, 8>,
}

// The samples are cubes rather than pinhole images. An override, not a uniform: the software driver runs both sides
// of a branch on a uniform.
override omni: bool = false;

@group(0) @binding(0) var<uniform> view: ViewUniform;
@group(0) @binding(1) var inverse_range: texture_2d_array<f32>;
@group(0) @binding(2) var radiance: texture_2d_array<f32>;
@group(0) @binding(3) var nearest: sampler;
@group(0) @binding(4) var bilinear: sampler;

// Where a pixel of the target lies in its view, in sub-pixels.
fn position_of(at: vec2f) -> vec2f {
    return at - view.target_origin + view.piece_origin;
}

// The direction of a position in the view, at depth 1.
fn direction_of(position: vec2f) -> vec3f {
    return view.corner + view.right * position.x + view.down * position.y;
}

// A loop's bound, unchanged. Mesa's software driver bakes a uniform that bounds a loop into the machine code, and compiles
// the shader again, tens of milliseconds, for each draw that comes with another; what depends on a texture, it does not.
fn runtime_bound(bound: u32) -> u32 {
    return min(bound, textureNumLayers(inverse_range) * 0x10000u);
}

// Share of the bilinear weights that decides: with less, the nearest texel is of another surface.
const SETTLED: f32 = 0.5;

// Less than this is rounding: a texel that the pixel does not touch.
const MIN_AGREEMENT: f32 = 0.02;

// What one sample has at a point of a view ray.
struct Fetch {
    // Texture coordinates that fetch bilinearly from agreeing texels only.
    uv: vec2f,
    layer: u32,
    // Level of the radiance whose texels are as large as the pixel.
    level: f32,
    // The inverse depth that was looked up, brought closer to the sample's surface.
    q: f32,
    // Shares of the bilinear weights. That agrees; 0 if the sample does not have the point.
    agreement: f32,
    // Share that looks past the point.
    past: f32,
    // Difference between the range that was looked for and that of the agreeing texels, as a share of the tolerance.
    residual: f32,
    // Whether it looks there at all; without agreement, uv is the farthest texel around the place.
    inside: bool,
}

// What is found before any sample was asked, for a surface at inverse depth q.
fn nothing_at(q: f32) -> Fetch {
    return Fetch(vec2f(0.0), 0u, 0.0, q, 0.0, 0.0, 1.0, false);
}

fn pinhole_of(s: ViewSample) -> Pinhole {
    return Pinhole(s.u_from_world, s.v_from_world, s.w_from_world);
}

// Where a sample has the direction d.
fn seen_by_sample(s: ViewSample, d: vec3f) -> Seen {
    if omni {
        return seen_by_cube(f32(textureDimensions(inverse_range).y) * 0.5, d);
    }
    return seen_by_pinhole(in_pinhole(pinhole_of(s), d));
}

// Looks the point at inverse depth q (1/metres, along the view's axis) in direction d up in a sample.
//
// Where all four texels agree, the depth is brought closer to the surface that they are of, by one step of the
// fixed-point iteration: to that of the point where the sample's ray meets it. A splatted depth is of a place up to half
// a cell beside the pixel.
fn fetch_from(s: ViewSample, d: vec3f, q: f32) -> Fetch {
    let ray = d + s.eye_from_center * q;
    let seen = seen_by_sample(s, ray);
    let unit = inverseSqrt(max(dot(ray, ray), 1e-30));
    // Inverse range that the sample has if it sees the point.
    let expected = q * unit;
    let size = vec2f(textureDimensions(inverse_range));
    let position = seen.uv * size - 0.5;
    let base = floor(position);
    let f = position - base;
    // In the middle of the four texels, so that no device's rounding of coordinates picks others.
    let four = textureGather(0, inverse_range, nearest, (base + 1.0) / size, s.layer);
    let shares = vec4f((1.0 - f.x) * f.y, f.x * f.y, f.x * (1.0 - f.y), (1.0 - f.x) * (1.0 - f.y));
    let tolerance = view.tolerance * expected;
    let weights = select(vec4f(0.0), shares, abs(four - expected) <= vec4f(tolerance));
    let beyond = select(vec4f(0.0), shares, four < vec4f(expected - tolerance));
    let agreement = select(0.0, dot(weights, vec4f(1.0)), seen.inside);
    let past = select(0.0, dot(beyond, vec4f(1.0)), seen.inside);
    let stored = dot(weights, four) / max(dot(weights, vec4f(1.0)), 1e-30);
    let residual = min(abs(stored - expected) / max(tolerance, 1e-30), 1.0);
    // Half a level finer than the pixel: a bilinear fetch averages somewhat by itself, and blur is an error too (terrain,
    // 800x600 texels for 200x150 pixels: FLIP 0.0384 without, 0.0374 with a whole level).
    let level = log2(max(0.707 * view.footprint * expected / max(q, 1e-30), 1.0));
    if agreement > 0.999 {
        let depth = dot(view.forward, ray * (unit / dot(shares, four)) - s.eye_from_center);
        // Where the ray grazes, the step may lead anywhere.
        let closer = clamp(1.0 / max(depth, 1e-30), 0.9 * q, 1.1 * q);
        let again = seen_by_sample(s, d + s.eye_from_center * closer);
        return Fetch(again.uv, s.layer, level, closer, agreement, past, residual, true);
    }
    let offset = select(farthest_offset(four), agreeing_offset(weights, agreement), agreement > 0.0);
    return Fetch((base + 0.5 + offset) / size, s.layer, level, q, agreement, past, residual, seen.inside);
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
    let upper = select(vec2f(0.0, 0.0), vec2f(1.0, 0.0), weights.z > weights.w);
    let lower = select(vec2f(0.0, 1.0), vec2f(1.0, 1.0), weights.y > weights.x);
    return select(upper, lower, max(weights.x, weights.y) > max(weights.z, weights.w));
}

// Offset of the texel with the greatest range (in the order of textureGather).
fn farthest_offset(four: vec4f) -> vec2f {
    let upper = select(vec2f(0.0, 0.0), vec2f(1.0, 0.0), four.z < four.w);
    let lower = select(vec2f(0.0, 1.0), vec2f(1.0, 1.0), four.y < four.x);
    return select(upper, lower, min(four.x, four.y) < min(four.z, four.w));
}

// The better of two fetches for one pixel, the first of them from a sample that is earlier in the plan's list,
// which is ordered by nearness: the nearest camera's texels are distorted least, so it need not have all of its
// weights in agreement. Without agreement, the first that looks there.
fn is_better(next: Fetch, so_far: Fetch) -> bool {
    return (next.inside && !so_far.inside) || (next.agreement > so_far.agreement && so_far.agreement < SETTLED);
}

// What a sample says of points on a view ray: a bit for each.
struct PointTests {
    // It looks there.
    seen: u32,
    // It looks past it.
    clear: u32,
}

const POINTS: u32 = 8u;

// A sample's opinions of the POINTS points at depths start + step, start + 2 step, ... in direction d. So many at once that
// what depends on the sample alone is worked out once for them.
fn test_points(s: ViewSample, d: vec3f, start: f32, step: f32) -> PointTests {
    let first = in_pinhole(pinhole_of(s), s.eye_from_center);
    let along = in_pinhole(pinhole_of(s), d);
    var all = PointTests(0u, 0u);
    for (var k = 0u; k < POINTS; k++) {
        let t = start + step * f32(k + 1u);
        let ray = d * t + s.eye_from_center;
        var seen = seen_by_pinhole(first + along * t);
        if omni {
            seen = seen_by_sample(s, ray);
        }
        let stored = textureSampleLevel(inverse_range, nearest, seen.uv, s.layer, 0.0).x;
        // In squares: no root. Sky, stored as 0, is beyond every point.
        let clear = stored * stored * dot(ray, ray) < 1.0;
        all.seen |= select(0u, 1u << k, seen.inside);
        all.clear |= select(0u, 1u << k, seen.inside && clear);
    }
    return all;
}

// Whether at every point that is checked, eight of them up to where the ray leaves the scene's bounds, some sample looks
// past it.
fn ray_is_sky(d: vec3f) -> bool {
    let all = (1u << POINTS) - 1u;
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let step = (span.y - span.x) / f32(POINTS);
    // Nothing is outside of the bounds.
    var clear = select(0u, all, span.x >= span.y);
    for (var i = 0u; i < runtime_bound(view.sample_count) && clear != all; i++) {
        clear |= test_points(view.samples[i], d, span.x, step).clear;
    }
    return clear == all;
}

// Depths at which a direction enters and leaves the scene's bounds, the entry at least 0; entry >= exit where it
// misses them.
fn crossing_of_bounds(bounds_min: vec3f, bounds_max: vec3f, d: vec3f) -> vec2f {
    // A component of 0 is parallel to its planes: nearly so has the same crossing, without an infinity.
    let steep = select(d, vec3f(1e-20), abs(d) < vec3f(1e-20));
    let a = bounds_min / steep;
    let b = bounds_max / steep;
    let first = min(a, b);
    let last = max(a, b);
    return vec2f(max(max(first.x, first.y), max(first.z, 0.0)), min(last.x, min(last.y, last.z)));
}

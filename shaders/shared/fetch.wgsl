// The depth-corrected fetch of all searches: a pixel at the depth that a search found is looked up in a sample, and
// fetched from texels whose range agrees.

import package::shared::camera::{Pinhole, Seen, cube_face_at, in_pinhole, seen_by_cube, seen_by_pinhole};
import package::shared::shading::Lighting;
import package::shared::reflection_probes::ProbeUniform;

// A sample as one view looks it up.
struct ViewSample {
    u_from_world: vec3f,
    // Layer of the texture arrays.
    layer: u32,
    v_from_world: vec3f,
    // Faces of a cube that the plan uses, one bit each. Directions in other faces are not seen.
    faces: u32,
    w_from_world: vec3f,
    // The view's eye relative to the sample's centre, metres, world axes.
    eye_from_center: vec3f,
}

// A piece of a view. Directions are in world axes, at depth 1 along the view's axis. Positions are relative to the eye.
// "Pixels" are sub-pixels where the view is supersampled.
struct ViewUniform {
    // Direction of the image's top left corner, then its change per pixel.
    corner: vec3f,
    sample_count: u32,
    right: vec3f,
    // Steps of the linear search.
    steps: u32,
    down: vec3f,
    // Index of this view's first light in `lights`.
    first_light: u32,
    bounds_min: vec3f,
    // Pixels along the edge of a cell.
    cell: f32,
    bounds_max: vec3f,
    // Index of this piece's first cell.
    first_cell: u32,
    // Unit axis of the view.
    forward: vec3f,
    // Relative difference of range up to which a texel belongs to the surface at a depth.
    tolerance: f32,
    // Position of the piece's first pixel in the view, pixels.
    piece_origin: vec2f,
    // Position of the piece's first pixel in the target, pixels.
    target_origin: vec2f,
    // First cell of this piece, in cells of the view.
    cell_origin: vec2i,
    // Columns of this piece's cells.
    cell_columns: i32,
    // Index of this piece's first word in `unsettled`.
    first_unsettled: u32,
    // Index of this piece in the chunk.
    piece: u32,
    // Texels of the nearest sample along the edge of a pixel, at equal distance from both.
    footprint: f32,
    // Columns and rows of the piece's pixels.
    piece_size: vec2u,
    extent_min: vec3f,
    // Pixels along the edge of a texel that is too coarse where surfaces end.
    coarse_edge: f32,
    extent_max: vec3f,
    // Pixels along the edge of a texel that is too coarse anywhere.
    coarse: f32,
    lighting: Lighting,
    // Reflection probes relative to the eye.
    probes: ProbeUniform,
    // Padded so that the struct is a multiple of 256 bytes, the alignment of uniforms.
    @size(640) samples: array<ViewSample, 8>,
}

// Samples are cubes; otherwise pinhole images. Quirk: both-sides.
override omni: bool = false;

@group(0) @binding(0) var<uniform> view: ViewUniform;
@group(0) @binding(1) var inverse_range: texture_2d_array<f32>;
@group(0) @binding(2) var radiance: texture_2d_array<f32>;
@group(0) @binding(3) var nearest: sampler;
@group(0) @binding(4) var bilinear: sampler;

// Position in the view of a position in the target, pixels.
fn position_of(at: vec2f) -> vec2f {
    return at - view.target_origin + view.piece_origin;
}

// Direction of a position in the view, at depth 1.
fn direction_of(position: vec2f) -> vec3f {
    return view.corner + view.right * position.x + view.down * position.y;
}

// Returns `bound` unchanged. Quirk: uniform-bound.
fn runtime_bound(bound: u32) -> u32 {
    return min(bound, textureNumLayers(inverse_range) * 0x10000u);
}

// Share of agreeing bilinear weights from which a fetch is settled. With less, the nearest texel belongs to another
// surface.
const SETTLED: f32 = 0.5;

// Smallest share that counts. Less is rounding.
const MIN_AGREEMENT: f32 = 0.02;

// Texels between two points of a plane from which one is extrapolated to the other.
const MOST_APART: f32 = 2.0;

// Steps of the fixed-point iteration that are taken at once.
const MOST_STEPS: f32 = 8.0;

// A point of a view ray looked up in one sample.
struct Fetch {
    // Texture coordinates at which a bilinear fetch reads only agreeing texels. Without agreement, those of the farthest
    // of the four texels.
    uv: vec2f,
    layer: u32,
    // Mip level of radiance whose texels are as large as the pixel.
    level: f32,
    // Inverse depth, refined towards the sample's surface.
    q: f32,
    // Share of the bilinear weights whose texels agree; 0 if the point is outside the image.
    agreement: f32,
    // Share of the bilinear weights whose texels lie beyond the point.
    past: f32,
    // Difference between the point's range and that of the agreeing texels, as a share of the tolerance.
    residual: f32,
    // Whether the point is inside the image.
    inside: bool,
    // Whether the sample's texels are fine enough for the pixel: see `is_seen`.
    fine: bool,
}

// Whether a sample saw the pixel's surface at the pixel's range: the one rule by which pixels are resolved.
// - The texel nearest to the pixel has the pixel's range, within the view's tolerance.
// - The texel covers at most `coarse` pixels to a side, and at most `coarse_edge` where not all four texels around the
//   pixel have its range: there the surface's edge is known to a texel only, and what is smaller may be missing.
fn is_seen(fetched: Fetch) -> bool {
    return fetched.agreement >= SETTLED && fetched.fine;
}

// The fetch before any sample is looked up, for inverse depth q.
fn nothing_at(q: f32) -> Fetch {
    return Fetch(vec2f(0.0), 0u, 0.0, q, 0.0, 0.0, 1.0, false, false);
}

fn pinhole_of(s: ViewSample) -> Pinhole {
    return Pinhole(s.u_from_world, s.v_from_world, s.w_from_world);
}

// Texture coordinates of direction d in a sample, and whether the plan uses the face there.
fn seen_by_sample(s: ViewSample, d: vec3f) -> Seen {
    if omni {
        let seen = seen_by_cube(f32(textureDimensions(inverse_range).y) * 0.5, d);
        return Seen(seen.uv, seen.inside && has_face(s, cube_face_at(seen.uv)));
    }
    return seen_by_pinhole(in_pinhole(pinhole_of(s), d));
}

// Whether the plan uses a face of a sample.
fn has_face(s: ViewSample, face: u32) -> bool {
    return ((s.faces >> face) & 1u) == 1u;
}

// Looks up in a sample the point at inverse depth q (1/metres, along the view's axis) in direction d.
//
// If all four texels agree, the depth is refined: to the depth at which the view's ray meets the plane through them.
// Splatted depths need it, because they belong to a point up to half a cell beside the pixel. One step of fixed-point
// iteration and one of the secant method find it; the former alone is off by some per cent where the surface is seen at a
// grazing angle.
fn fetch_from(s: ViewSample, d: vec3f, q: f32) -> Fetch {
    let ray = d + s.eye_from_center * q;
    let seen = seen_by_sample(s, ray);
    let unit = inverseSqrt(max(dot(ray, ray), 1e-30));
    // Inverse range that the sample stores if it sees the point.
    let expected = q * unit;
    let size = vec2f(textureDimensions(inverse_range));
    let position = seen.uv * size - 0.5;
    let base = floor(position);
    let f = position - base;
    // At the corner of the four texels, so that rounding on no device selects others.
    let four = textureGather(0, inverse_range, nearest, (base + 1.0) / size, s.layer);
    let shares = vec4f((1.0 - f.x) * f.y, f.x * f.y, f.x * (1.0 - f.y), (1.0 - f.x) * (1.0 - f.y));
    let tolerance = view.tolerance * expected;
    let weights = select(vec4f(0.0), shares, abs(four - expected) <= vec4f(tolerance));
    let beyond = select(vec4f(0.0), shares, four < vec4f(expected - tolerance));
    let agreement = select(0.0, dot(weights, vec4f(1.0)), seen.inside);
    let past = select(0.0, dot(beyond, vec4f(1.0)), seen.inside);
    let stored = dot(weights, four) / max(dot(weights, vec4f(1.0)), 1e-30);
    let residual = min(abs(stored - expected) / max(tolerance, 1e-30), 1.0);
    // Half a level finer than the pixel, because a bilinear fetch averages by itself and blur is an error too (terrain,
    // 800x600 texels for 200x150 pixels: FLIP 0.0384 without the factor, 0.0374 with a whole level).
    let level = log2(max(0.707 * view.footprint * expected / max(q, 1e-30), 1.0));
    // Pixels along the edge of a texel, both facing the surface.
    let pixels = q / max(view.footprint * expected, 1e-30);
    let fine = pixels <= select(view.coarse_edge, view.coarse, agreement > 0.999);
    if agreement > 0.999 {
        let depth = dot(view.forward, ray * (unit / dot(shares, four)) - s.eye_from_center);
        // At grazing angles the step is unreliable, so it is limited.
        let closer = clamp(1.0 / max(depth, 1e-30), 0.9 * q, 1.1 * q);
        let ray_again = d + s.eye_from_center * closer;
        let again = seen_by_sample(s, ray_again);
        // The plane's inverse range there: it is nearly affine over the image.
        let g = again.uv * size - 0.5 - base;
        let shares_again = vec4f((1.0 - g.x) * g.y, g.x * g.y, g.x * (1.0 - g.y), (1.0 - g.x) * (1.0 - g.y));
        let first = dot(shares, four) - expected;
        let second = dot(shares_again, four) - closer * inverseSqrt(max(dot(ray_again, ray_again), 1e-30));
        // The root of the line through both residuals, in steps of the iteration. Texels farther away say nothing of the plane,
        // and in another face of a cube they are elsewhere in the image.
        let near = all(abs(g - f) < vec2f(MOST_APART)) && abs(first - second) > 1e-6 * expected;
        let steps = select(1.0, clamp(first / (first - second), 0.0, MOST_STEPS), near);
        let faces = vec2f(3.0, 2.0);
        let extrapolated = mix(seen.uv, again.uv, steps);
        let leaves_face = omni && any(floor(extrapolated * faces) != floor(again.uv * faces));
        let there = select(extrapolated, again.uv, leaves_face);
        // Past the border of a face that is not used there is nothing to fetch.
        let uv = select(seen.uv, there, again.inside || !omni);
        return Fetch(uv, s.layer, level, clamp(mix(q, closer, steps), 0.9 * q, 1.1 * q), agreement, past, residual, true, fine);
    }
    let offset = select(farthest_offset(four), agreeing_offset(weights, agreement), agreement > 0.0);
    return Fetch((base + 0.5 + offset) / size, s.layer, level, q, agreement, past, residual, seen.inside, fine);
}

// Offset, in texels from the first of four, at which a bilinear fetch reads only texels with a weight (in the order of
// textureGather). That is their weighted centre if they form a row, a column or all four; otherwise the texel of greatest
// weight.
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

// Offset of the texel of greatest range (in the order of textureGather).
fn farthest_offset(four: vec4f) -> vec2f {
    let upper = select(vec2f(0.0, 0.0), vec2f(1.0, 0.0), four.z < four.w);
    let lower = select(vec2f(0.0, 1.0), vec2f(1.0, 1.0), four.y < four.x);
    return select(upper, lower, min(four.x, four.y) < min(four.z, four.w));
}

// Whether `next` is the better of two fetches for one pixel; `so_far` is from an earlier sample in the plan's list. The
// list is ordered by distance, and the nearest camera's texels are distorted least, so a settled fetch is kept unless its
// texels are too coarse. Without agreement the first sample that looks there is kept.
fn is_better(next: Fetch, so_far: Fetch) -> bool {
    let agrees_more = next.agreement > so_far.agreement && so_far.agreement < SETTLED;
    return (next.inside && !so_far.inside) || agrees_more || (is_seen(next) && !is_seen(so_far));
}

// Tests of points on a view ray against a sample, one bit a point.
struct PointTests {
    // The sample looks there.
    seen: u32,
    // The sample sees past the point.
    clear: u32,
}

const POINTS: u32 = 8u;

// Tests the POINTS points at depths start + step, start + 2 step, … in direction d against a sample. Several points at
// once share the terms that depend on the sample alone.
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
        // Squared, to save a root. Sky is stored as 0, which is beyond every point.
        let clear = stored * stored * dot(ray, ray) < 1.0;
        all.seen |= select(0u, 1u << k, seen.inside);
        all.clear |= select(0u, 1u << k, seen.inside && clear);
    }
    return all;
}

// Whether some sample sees past each of eight points of the ray within the scene's extent, and past each of eight within
// its bounds where these are larger: surfaces within the extent would be missed between points as far apart.
fn ray_is_sky(d: vec3f) -> bool {
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let near = crossing_of_extent(span, d);
    var clear = samples_see_past(d, near);
    // A loop in place of a branch. Quirk: both-sides.
    for (var k = 0u; k < runtime_bound(1u) && clear && any(near != span); k++) {
        clear = samples_see_past(d, span);
    }
    return clear;
}

// Whether some sample sees past each of eight points between two depths. True if there is nothing between.
fn samples_see_past(d: vec3f, span: vec2f) -> bool {
    let all = (1u << POINTS) - 1u;
    let step = (span.y - span.x) / f32(POINTS);
    var clear = select(0u, all, span.x >= span.y);
    for (var i = 0u; i < runtime_bound(view.sample_count) && clear != all; i++) {
        clear |= test_points(view.samples[i], d, span.x, step).clear;
    }
    return clear == all;
}

// The part of a ray between two depths that lies within the scene's extent; empty (first >= second) if none does.
fn crossing_of_extent(span: vec2f, d: vec3f) -> vec2f {
    let near = crossing_of_bounds(view.extent_min, view.extent_max, d);
    return vec2f(max(near.x, span.x), min(near.y, span.y));
}

// Depths at which a ray enters and leaves the scene's bounds; the entry is at least 0. entry >= exit if it misses them.
fn crossing_of_bounds(bounds_min: vec3f, bounds_max: vec3f, d: vec3f) -> vec2f {
    // Replaces 0 by a tiny component, which avoids an infinity and has the same crossing.
    let steep = select(d, vec3f(1e-20), abs(d) < vec3f(1e-20));
    let a = bounds_min / steep;
    let b = bounds_max / steep;
    let first = min(a, b);
    let last = max(a, b);
    return vec2f(max(max(first.x, first.y), max(first.z, 0.0)), min(last.x, min(last.y, last.z)));
}

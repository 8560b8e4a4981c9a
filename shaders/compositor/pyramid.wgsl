// Program of compositor/src/search_pipelines.rs: exact ray marching, from texel to texel of each sample in turn. It ends
// where no camera that looks there sees past the point (the most conservative surface, cluster paper, section 4.2). A
// pyramid of nearest surfaces skips empty space in large steps.

import package::shared::fetch::{ViewSample, crossing_of_bounds, direction_of, runtime_bound, omni, position_of, view};
import package::shared::levels::{LEVELS, place_of_level};
import package::shared::image_line::{AHEAD, leaves_cell, line_in_image, texel_at};
import package::shared::pixel::Pixel;
import package::shared::ray_end::{RayEnd, pixel_at_end};

// Greatest inverse range in cells of 1, 2, 4, … texels on a side; 0 without surfaces. Layout: shared/levels.wgsl.
@group(0) @binding(16) var nearest_surfaces: texture_2d_array<f32>;

// Share of its range by which a camera must see past a point to overrule another camera. Two cameras' texels of one
// surface differ by up to half a texel's slope; without a margin a ray would pass between them.
const MARGIN: f32 = 0.003;

// A position on a cell's border may round to either side, so it counts as this many texels inside.
const INSIDE: f32 = 0.015625;

// Most cells that a ray visits in one sample before the next sample's turn, and most turns. They bound the work of a
// pixel; a ray that has not ended by then is unresolved.
const CELLS: u32 = 192u;
const TURNS: u32 = 96u;

const LEVEL_AT_FIRST: u32 = 2u;

// How far a ray is free in one sample.
struct Stop {
    // Depth up to which the sample sees past the ray.
    t: f32,
    // A surface is at that depth or in front of it.
    behind: bool,
    // The sample does not look there. `begins` is the depth from which it does, or a depth beyond the end.
    blind: bool,
    begins: f32,
}

fn follow(s: ViewSample, d: vec3f, near: f32, far: f32) -> Stop {
    let size = textureDimensions(nearest_surfaces);
    let dd = dot(d, d);
    var t = near;
    var behind = false;
    var blind = false;
    var begins = far * 2.0;
    // Lines in successive faces: at most six, and one that rounding repeats.
    for (var face = 0u; face < runtime_bound(select(1u, 8u, omni)) && !behind && !blind && t < far; face++) {
        let line = line_in_image(s, d, t, far);
        blind = !(line.begin <= t && t < line.end);
        begins = select(begins, line.begin, line.begin > t && line.begin < line.end);
        var level = LEVEL_AT_FIRST;
        for (var k = 0u; k < runtime_bound(CELLS) && !blind && !behind && t < line.end; k++) {
            let side = f32(1u << level);
            let cell = floor((texel_at(line, t) + line.sense * INSIDE) / side);
            let exit = leaves_cell(line, cell, side, t);
            let last = (vec2u(size.x, size.y / 3u * 2u) >> vec2u(level)) - 1u;
            let place = place_of_level(size, level) + min(vec2u(max(cell, vec2f(0.0))), last);
            let surface = textureLoad(nearest_surfaces, place, s.layer, 0).x / (1.0 - MARGIN);
            let here = s.eye_from_center + d * t;
            let there = s.eye_from_center + d * exit;
            // Range is convex along a ray, so its maximum is at one of the ends.
            let s2 = surface * surface;
            let hidden = s2 * max(dot(here, here), dot(there, there)) >= 1.0;
            if !hidden {
                t = max(exit, t * (1.0 + 1e-6));
                level = min(level + 1u, LEVELS - 1u);
            } else if level > 0u {
                level -= 1u;
            } else {
                // The ray ends here, or where its range equals the surface's: |here + d x| = 1 / surface.
                behind = true;
                let left = 1.0 / s2 - dot(here, here);
                let b = dot(d, here);
                let root = sqrt(max(b * b + dd * left, 0.0));
                let x = select((root - b) / dd, left / max(root + b, 1e-30), b > 0.0);
                t += select(0.0, clamp(x, 0.0, exit - t), left > 0.0);
            }
        }
    }
    return Stop(min(t, far), behind, blind, begins);
}

fn follow_in_all(d: vec3f, span: vec2f) -> RayEnd {
    // A sample at the eye has no image of the ray's origin.
    var t = max(span.x, 1e-6 * span.y);
    var agreed = 0u;
    var seen = false;
    var clear = true;
    var next = 2.0 * span.y;
    let count = runtime_bound(view.sample_count);
    var i = 0u;
    for (var turn = 0u; turn < runtime_bound(TURNS) && t < span.y && !(agreed == count && seen); turn++) {
        let stop = follow(view.samples[i], d, t, span.y);
        // Moved by more than rounding.
        let moved = stop.t > t * (1.0 + AHEAD);
        agreed = select(agreed, 0u, moved) + select(0u, 1u, stop.behind || stop.blind);
        seen = (seen && !moved) || stop.behind;
        next = min(select(next, 2.0 * span.y, moved), stop.begins);
        t = stop.t;
        // No sample looks here: continue where one does.
        if agreed == count && !seen {
            clear = false;
            t = next;
            agreed = 0u;
            next = 2.0 * span.y;
        }
        i = select(i + 1u, 0u, i + 1u == count);
    }
    return RayEnd(t, agreed == count && seen, clear && t >= span.y);
}

fn pixel(at: vec2f) -> Pixel {
    let d = direction_of(position_of(at));
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let ended = follow_in_all(d, span);
    return pixel_at_end(d, span, ended);
}

// Program of compositor/src/passes/warp.rs: each pixel takes the depth that was splatted for its cell, and the
// colour that the sample which splatted it has there. What that does not settle is left to `mend.wgsl`.
//
// There is no loop and no second sample here on purpose: on the software driver both sides of a branch are run
// and loops keep their variables in memory, so that a loop over the plan's samples, left at the first that
// agrees, made the pass 2.7 times as long (1.75 ms a view of 200x150, against 0.65) although it ran once for
// nearly every pixel.

import package::shared::cells::{Depth, depth_of};
import package::shared::fetch::{SETTLED, crossing_of_bounds, direction_of, fetch_from, position_of, view};
import package::shared::pixel::{Pixel, sky_pixel, surface_pixel};

@group(0) @binding(9) var<storage, read> depths: array<u32>;
// Pixels that are left over: their number for each piece of the chunk, then their places in the target, 16 bits each of
// x and y.
@group(0) @binding(10) var<storage, read_write> unsettled: array<atomic<u32>>;

fn pixel(at: vec2f) -> Pixel {
    let position = position_of(at);
    let d = direction_of(position);
    let cell = vec2i(floor(position / view.cell)) - view.cell_origin;
    let depth = depth_of(depths[view.first_cell + u32(cell.y * view.cell_columns + cell.x)]);
    let fetched = fetch_from(view.samples[depth.source], d, depth.q);
    let settled = depth.q > 0.0 && fetched.agreement >= SETTLED;
    var pixel = surface_pixel(fetched, depth.source, d);
    // A loop, since the software driver leaves one that none of its eight pixels needs, where it would run a branch.
    for (var k = 0u; k < 1u && !settled; k++) {
        pixel = sky_pixel(d);
        let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
        // Nothing is outside of the scene's bounds.
        if span.x < span.y {
            let slot = view.first_unsettled + atomicAdd(&unsettled[view.piece], 1u);
            atomicStore(&unsettled[slot], u32(at.x) | (u32(at.y) << 16u));
        }
    }
    return pixel;
}

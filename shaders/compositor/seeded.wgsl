// Program of compositor/src/passes/seeded.rs: a coarse splat says where to begin, a few fixed-point steps lead to the surface;
// where they do not, a short linear search.

import package::shared::cells::{Depth, depth_of};
import package::shared::elsewhere::pixel_elsewhere;
import package::shared::fetch::{
    SETTLED, crossing_of_bounds, direction_of, fetch_from, not_baked, position_of, view,
};
import package::shared::fixed_point::{limits_of, settle};
import package::shared::pixel::{Pixel, surface_pixel};

@group(0) @binding(9) var<storage, read> depths: array<u32>;

fn pixel(at: vec2f) -> Pixel {
    let position = position_of(at);
    let d = direction_of(position);
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let cell = vec2i(floor(position / view.cell)) - view.cell_origin;
    let seed = depth_of(depths[view.first_cell + u32(cell.y * view.cell_columns + cell.x)]);
    let q = settle(view.samples[seed.source], d, abs(seed.q), limits_of(span), view.steps);
    let fetched = fetch_from(view.samples[seed.source], d, q);
    let settled = span.x < span.y && fetched.agreement >= SETTLED;
    var result = surface_pixel(fetched, seed.source, d);
    // A loop that runs once or not at all: a branch's two sides are both run by the software driver.
    for (var k = 0u; k < not_baked(1u) && !settled; k++) {
        result = pixel_elsewhere(d, span, abs(seed.q), seed.source, view.steps);
    }
    return result;
}

// Program of compositor/src/search_pipelines.rs: the linear search of the cluster paper (section 4.2), and the fetch.

import package::shared::fetch::{crossing_of_bounds, direction_of, position_of, view};
import package::shared::march::march;
import package::shared::pixel::Pixel;
import package::shared::ray_end::pixel_at_end;

fn pixel(at: vec2f) -> Pixel {
    let d = direction_of(position_of(at));
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    return pixel_at_end(d, span, march(d, span, view.steps));
}

// Program of `papers/megaviews/src/passes/map_lookup.rs`: looks up each sub-sample of an omni sample in its camera's map of octree
// nodes.

import package::megaviews::shared::lit_maps::{seen_in_map, lookup};
import package::shared::rays::{Rays, central_ray, ray_through};

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(4) var<storage, read_write> shaded: array<vec4f>;

@compute @workgroup_size(8, 8)
fn look_up(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    // The range is that on the texel's central ray.
    let ray = normalize(ray_through(rays, vec2f(id.xy) + 0.5));
    shaded[id.y * rays.width + id.x] = seen_in_map(lookup.view, ray, normalize(central_ray(rays, id.xy)));
}

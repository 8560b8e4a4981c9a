// Program of `papers/megaviews/src/passes/resample_probes.rs`: makes the finest level of reflection probes from maps of octree nodes.

import package::megaviews::shared::lit_maps::{seen_in_map, lookup};
import package::shared::probe_planes::{SUB, direction_of_place, finest, keep, place_of, step};

@compute @workgroup_size(8, 8)
fn resample(@builtin(global_invocation_id) id: vec3u) {
    let width = step.side + 2u;
    if id.x >= width || id.y >= width {
        return;
    }
    let central = direction_of_place(place_of(vec2f(id.xy) + 0.5));
    var radiance = vec3f(0.0);
    for (var i = 0u; i < SUB * SUB; i++) {
        let within = (vec2f(f32(i % SUB), f32(i / SUB)) + 0.5) / f32(SUB);
        let ray = direction_of_place(place_of(vec2f(id.xy) + within));
        radiance += seen_in_map(lookup.view + id.z, ray, ray).rgb / f32(SUB * SUB);
    }
    let inverse_range = seen_in_map(lookup.view + id.z, central, central).w;
    finest[(id.z * width + id.y) * width + id.x] = vec4f(radiance, inverse_range);
    keep(id.xy, id.z, radiance, inverse_range);
}

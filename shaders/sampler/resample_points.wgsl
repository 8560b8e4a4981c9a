// Program of `sampler/src/passes/resample_points.rs`: makes the finest level of reflection probes from cube maps of points
// (`sampler/src/index_maps/mod.rs`).

import package::shared::cube_faces::{face_of, in_face};
import package::shared::encode::{radiance_from_rgb9e5};
import package::shared::finite::{finite_or_zero};
import package::shared::probe_planes::{SUB, direction_of_place, finest, keep, place_of, step};
import package::shared::shading::{sky_radiance};
import package::shared::surface::{lighting};

// Texels of all maps: 1 + the index of the point that a texel sees, or 0 for sky; and the inverse of its range, 1/metres,
// f32 bits. Six faces a map, of `cube_side` rows each.
@group(0) @binding(3) var<storage, read> texels: array<vec2u>;
// Radiance of all points, rgb9e5.
@group(0) @binding(4) var<storage, read> points: array<u32>;

// Texels on an edge of a cube map.
override cube_side: u32 = 64u;

// The texel of a direction, as `Maps::texel_of`.
fn texel_along(map: u32, direction: vec3f) -> vec2u {
    let face = face_of(direction);
    let at = in_face(face, direction);
    let side = cube_side;
    let place = (at.xy / max(at.z, 1e-30) + 1.0) * 0.5 * f32(side);
    let texel = min(vec2u(max(place, vec2f(0.0))), vec2u(side - 1u));
    let index = ((map * 6u + face) * side + texel.y) * side + texel.x;
    return texels[min(index, arrayLength(&texels) - 1u)];
}

fn radiance_along(map: u32, ray: vec3f) -> vec3f {
    let point = texel_along(map, ray).x;
    if point == 0u {
        return finite_or_zero(sky_radiance(lighting, ray));
    }
    return radiance_from_rgb9e5(points[min(point, arrayLength(&points)) - 1u]);
}

@compute @workgroup_size(8, 8)
fn resample_points(@builtin(global_invocation_id) id: vec3u) {
    let width = step.side + 2u;
    if id.x >= width || id.y >= width {
        return;
    }
    var radiance = vec3f(0.0);
    for (var i = 0u; i < SUB * SUB; i++) {
        let within = (vec2f(f32(i % SUB), f32(i / SUB)) + 0.5) / f32(SUB);
        let ray = direction_of_place(place_of(vec2f(id.xy) + within));
        radiance += radiance_along(id.z, ray) / f32(SUB * SUB);
    }
    let central = direction_of_place(place_of(vec2f(id.xy) + 0.5));
    let inverse_range = bitcast<f32>(texel_along(id.z, central).y);
    finest[(id.z * width + id.y) * width + id.x] = vec4f(radiance, inverse_range);
    keep(id.xy, id.z, radiance, inverse_range);
}

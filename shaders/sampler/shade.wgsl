// Program of `sampler/src/passes/shade.rs`: the radiance that each sub-sample sees, where triangles are known.

import package::shared::encode::{octahedral_from_unit};
import package::shared::finite::{finite_or_zero};
import package::shared::geometry::{attributes, instances, mesh_from_world, meshes, triangle_about_eye};
import package::shared::guide::{keep_guide};
import package::shared::ray_triangle::{cross_triangle};
import package::shared::rays::{Rays, central_ray, list_index, listed_sub_sample, ray_through};
import package::shared::shading::{Surface, sky_radiance};
import package::shared::surface::{Hit, has_specular, lighting, radiance, reflects, surface_at};
import package::shared::surroundings::{Around, reflector_word, sent_of_around};

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(3) var visibility: texture_2d<u32>;
// Radiance; in w the inverse range of a sample's surface on its texel's central ray, 0 for sky.
@group(0) @binding(4) var<storage, read_write> shaded: array<vec4f>;
// Octahedral normal (2x16snorm), F0 and roughness (4x8unorm).
@group(0) @binding(5) var<storage, read_write> gloss: array<vec2u>;
// Of each instance, 1 + the number of the map that it looks up; 0 for none.
@group(2) @binding(4) var<storage, read> map_of_instance: array<u32>;
@group(2) @binding(5) var<uniform> around: Around;
// As `PlaneKind::Reflector` has it.
@group(2) @binding(6) var<storage, read_write> reflectors: array<u32>;
// Of a list of pixels, where each lies in the tile.
@group(0) @binding(6) var<storage, read> places: array<u32>;

fn hit_at(ids: vec2u, sub_sample: vec2u) -> Hit {
    let instance = instances[ids.x - 1u];
    let mesh = meshes[instance.mesh];
    let along = ray_through(rays, vec2f(sub_sample) + 0.5);
    let scale = 1.0 / length(along);
    let in_mesh = mesh_from_world(instance, along * scale);
    let triangle = triangle_about_eye(instance, mesh, ids.y);
    let crossing = cross_triangle(in_mesh, triangle.a, triangle.e1, triangle.e2);
    let records = mesh.first.z + triangle.corners * mesh.first.w;
    let weights = vec3f(1.0 - crossing.barycentric.x - crossing.barycentric.y, crossing.barycentric);
    // The range is bounded so that its inverse is finite, and so is everything that follows.
    let range = clamp(crossing.t, 1e-18, 1e18);
    return Hit(
        instance, mesh, triangle, records, attributes[records.x], attributes[records.y], attributes[records.z],
        weights, cross(triangle.e1, triangle.e2), in_mesh, along * scale, scale, range, crossing.front,
        rays.right, rays.down,
    );
}

// 1/metres on the central ray of the hit's texel, as far as the triangle's plane tells. A plane seen edge-on may
// leave the texel anywhere; nothing is farther off than a few texels' slope.
fn central_inverse_range(hit: Hit, sub_sample: vec2u) -> f32 {
    let central = normalize(central_ray(rays, sub_sample));
    let slope = dot(hit.geometric, mesh_from_world(hit.instance, central)) / dot(hit.geometric, hit.in_mesh);
    return select(1.0, clamp(slope, 0.75, 1.25), abs(slope) < 1e9) / hit.range;
}

fn sky_along(sub_sample: vec2u) -> vec3f {
    return finite_or_zero(sky_radiance(lighting, normalize(ray_through(rays, vec2f(sub_sample) + 0.5))));
}

// Everything that reaches the eye along a sub-sample's ray.
fn seen_along(ids: vec2u, sub_sample: vec2u, at: u32) -> vec4f {
    if ids.x == 0u {
        return vec4f(sky_along(sub_sample), 0.0);
    }
    let hit = hit_at(ids, sub_sample);
    let map = map_of(ids.x);
    let surface = surface_of(hit, map);
    keep_guide(at, surface);
    var seen = radiance(surface, true);
    if has_specular && any(surface.f0 != vec3f(0.0)) {
        seen += sent_of_around(surface, -normalize(surface.position), lighting, around, map);
    }
    return vec4f(finite_or_zero(seen), 1.0 / hit.range);
}

// The surface at a hit; what would pass through it is not seen where it looks no map up.
fn surface_of(hit: Hit, map: u32) -> Surface {
    var surface = surface_at(hit);
    if reflects && map == 0u {
        surface.albedo += surface.transmitted;
        surface.transmitted = vec3f(0.0);
    }
    return surface;
}

// 1 + the number of the map that a visible instance looks up, 0 for none.
fn map_of(instance: u32) -> u32 {
    if !reflects {
        return 0u;
    }
    return map_of_instance[min(instance - 1u, arrayLength(&map_of_instance) - 1u)];
}

// For a direct view: everything that reaches its eye.
@compute @workgroup_size(8, 8)
fn shade_view(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    shaded[at] = seen_along(textureLoad(visibility, id.xy, 0).xy, id.xy, at);
}

// For a list of a direct view's pixels: the same, elsewhere.
@compute @workgroup_size(8, 8)
fn shade_pixels(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let place = places[min(list_index(rays, id.xy), arrayLength(&places) - 1u)];
    let sub_sample = listed_sub_sample(rays, place, id.xy);
    let at = id.y * rays.width + id.x;
    shaded[at] = seen_along(textureLoad(visibility, id.xy, 0).xy, sub_sample, at);
}

// For a sample: what does not depend on the viewer.
@compute @workgroup_size(8, 8)
fn shade_sample(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let ids = textureLoad(visibility, id.xy, 0).xy;
    if ids.x == 0u {
        shaded[at] = vec4f(sky_along(id.xy), 0.0);
        return;
    }
    let hit = hit_at(ids, id.xy);
    let surface = surface_at(hit);
    keep_guide(at, surface);
    let inverse_range = central_inverse_range(hit, id.xy);
    shaded[at] = vec4f(finite_or_zero(radiance(surface, false)), inverse_range);
}

// For a sample of a scene with glossy materials: also what specular reflection will need.
@compute @workgroup_size(8, 8)
fn shade_glossy_sample(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let ids = textureLoad(visibility, id.xy, 0).xy;
    if ids.x == 0u {
        shaded[at] = vec4f(sky_along(id.xy), 0.0);
        gloss[at] = vec2u(0u);
        if reflects {
            reflectors[at] = 0u;
        }
        return;
    }
    let hit = hit_at(ids, id.xy);
    let map = map_of(ids.x);
    let surface = surface_of(hit, map);
    keep_guide(at, surface);
    let inverse_range = central_inverse_range(hit, id.xy);
    shaded[at] = vec4f(finite_or_zero(radiance(surface, false)), inverse_range);
    let specular = vec4f(surface.f0, surface.roughness);
    gloss[at] = vec2u(pack2x16snorm(octahedral_from_unit(surface.normal)), pack4x8unorm(specular));
    if reflects {
        reflectors[at] = reflector_word(map, surface.transmitted);
    }
}

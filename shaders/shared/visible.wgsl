// Hits and surfaces of visible triangles. Direct views and samples both shade with this.

import package::shared::finite::{finite_or_zero};
import package::shared::geometry::{attributes, instances, mesh_from_world, meshes, triangle_about_eye};
import package::shared::ray_triangle::{cross_triangle};
import package::shared::rays::{Rays, ray_through};
import package::shared::shading::{Surface, sky_radiance};
import package::shared::surface::{Hit, lighting, reflects, surface_at};

@group(0) @binding(0) var<uniform> rays: Rays;
// 1 + the index of each instance's reflection probe; 0 for none.
@group(2) @binding(4) var<storage, read> probe_of_instance: array<u32>;

// A ray of a sub-sample, not of unit length, and its change to the next ones across and down.
struct CastRay {
    along: vec3f,
    right: vec3f,
    down: vec3f,
}

// The ray through an image position. Textures are filtered over `width` times the distance of neighbouring rays.
fn cast_through(at: vec2f, width: f32) -> CastRay {
    return CastRay(ray_through(rays, at), rays.right * width, rays.down * width);
}

// The hit of a ray with its visible triangle.
fn hit_of(ids: vec2u, ray: CastRay) -> Hit {
    let instance = instances[ids.x - 1u];
    let mesh = meshes[instance.mesh];
    let along = ray.along;
    let scale = 1.0 / length(along);
    let in_mesh = mesh_from_world(instance, along * scale);
    let triangle = triangle_about_eye(instance, mesh, ids.y);
    let crossing = cross_triangle(in_mesh, triangle.a, triangle.e1, triangle.e2);
    let records = mesh.first.z + triangle.corners * mesh.first.w;
    let weights = vec3f(1.0 - crossing.barycentric.x - crossing.barycentric.y, crossing.barycentric);
    // The range is bounded, so that its inverse and all results are finite.
    let range = clamp(crossing.t, 1e-18, 1e18);
    return Hit(
        instance, mesh, triangle, records, attributes[records.x], attributes[records.y], attributes[records.z],
        weights, cross(triangle.e1, triangle.e2), in_mesh, along * scale, scale, range, crossing.front,
        ray.right, ray.down,
    );
}

// Radiance of the sky along a ray.
fn sky_along(along: vec3f) -> vec3f {
    return finite_or_zero(sky_radiance(lighting, normalize(along)));
}

// The surface at a hit. Without a reflection probe it is opaque: transmitted light is reflected as albedo.
fn surface_of(hit: Hit, probe: u32) -> Surface {
    var surface = surface_at(hit);
    if reflects && probe == 0u {
        surface.albedo += surface.transmitted;
        surface.transmitted = vec3f(0.0);
    }
    return surface;
}

// 1 + the index of a visible instance's reflection probe; 0 for none.
fn probe_of(instance: u32) -> u32 {
    if !reflects {
        return 0u;
    }
    return probe_of_instance[min(instance - 1u, arrayLength(&probe_of_instance) - 1u)];
}

// Surfaces of triangles at given points, viewed along the normal: shading that does not depend on a viewer.

import package::shared::geometry::{attributes, instances, mesh_from_world, meshes, normal_from_mesh, triangle_about_eye};
import package::shared::surface::{Hit};

// A point of a triangle viewed along its normal, and the distance of its plane from the query position.
struct Projected {
    hit: Hit,
    // Unit normal of the triangle's front, world space.
    normal: vec3f,
    // Metres along the normal.
    offset: f32,
}

// Projects `position`, relative to the eye, onto the triangle of an instance and an index in its mesh. Textures are filtered
// over a square of that width, metres.
fn projected_onto(ids: vec2u, position: vec3f, width: f32, front: bool) -> Projected {
    let instance = instances[ids.x];
    let mesh = meshes[instance.mesh];
    let triangle = triangle_about_eye(instance, mesh, ids.y);
    let geometric = cross(triangle.e1, triangle.e2);
    let area = max(dot(geometric, geometric), 1e-37);
    let from_corner = mesh_from_world(instance, position) - triangle.a;
    // Weights of the second and third corner, clamped to the triangle.
    let v = max(dot(cross(from_corner, triangle.e2), geometric), 0.0) / area;
    let w = max(dot(cross(triangle.e1, from_corner), geometric), 0.0) / area;
    let weights = vec2f(v, w) / max(v + w, 1.0);
    let across = normal_from_mesh(instance, geometric);
    let normal = normalize(across);
    let offset = -dot(geometric, from_corner) / max(length(across), 1e-37);
    let point = position + normal * offset;
    let range = clamp(length(point), 1e-18, 1e18);
    // Two directions in the plane, of that width each: the texture footprint.
    let right = normalize(select(vec3f(0.0, -normal.z, normal.y), vec3f(normal.z, 0.0, -normal.x), abs(normal.x) < 0.7));
    let down = cross(normal, right);
    let step = width / range;
    let records = mesh.first.z + triangle.corners * mesh.first.w;
    let hit = Hit(
        instance, mesh, triangle, records, attributes[records.x], attributes[records.y], attributes[records.z],
        vec3f(1.0 - weights.x - weights.y, weights), geometric, geometric, point / range, 1.0, range, front,
        right * step, down * step,
    );
    return Projected(hit, normal, offset);
}

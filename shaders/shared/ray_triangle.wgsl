// The only ray-triangle routine of shading: the hit of a ray with a triangle that is known to be visible.

struct Crossing {
    // Weights of the second and third corner, clamped to the triangle.
    barycentric: vec2f,
    // Distance in units of the ray's direction.
    t: f32,
    // Whether the corners appear counter-clockwise.
    front: bool,
}

// Intersects a ray from zero with a triangle: first corner `a`, edges `e1` and `e2` to the others (Möller and Trumbore,
// "Fast, Minimum Storage Ray/Triangle Intersection", 1997). A rasteriser may show a triangle outside its edges, up to its
// snapping precision. Such a hit is moved to the triangle's edge, since the plane may be edge-on. A triangle without area
// is hit in its centre.
fn cross_triangle(direction: vec3f, a: vec3f, e1: vec3f, e2: vec3f) -> Crossing {
    let p = cross(direction, e2);
    let q = cross(e1, a);
    let det = dot(e1, p);
    var u = -dot(a, p) / det;
    var v = dot(direction, q) / det;
    // NaN or infinite: the triangle is edge-on.
    if !(abs(u) < 1e9 && abs(v) < 1e9) {
        u = 1.0 / 3.0;
        v = 1.0 / 3.0;
    }
    u = saturate(u);
    v = saturate(v);
    let excess = max(u + v, 1.0);
    let barycentric = vec2f(u, v) / excess;
    // Interpolating corners has an error relative to the triangle's size. Intersecting the plane does not: a floor of a
    // kilometre is hit exactly a metre away. Edge-on planes are inexact, so the result is clamped to the corners' distances.
    let normal = cross(e1, e2);
    let plane = dot(normal, a) / dot(normal, direction);
    let along = vec3f(dot(a, direction), dot(a + e1, direction), dot(a + e2, direction)) / dot(direction, direction);
    let nearest = min(min(along.x, along.y), along.z);
    let farthest = max(max(along.x, along.y), along.z);
    let blended = along.x * (1.0 - barycentric.x - barycentric.y) + along.y * barycentric.x + along.z * barycentric.y;
    let t = select(blended, clamp(plane, nearest, farthest), abs(plane) < 1e30);
    return Crossing(barycentric, max(t, 0.0), det > 0.0);
}

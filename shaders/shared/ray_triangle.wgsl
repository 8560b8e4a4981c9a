// The one ray-triangle routine: where a ray meets the plane of a triangle that is known to be seen.

struct Crossing {
    // Weights of the second and third corner; inside the triangle.
    barycentric: vec2f,
    // In units of the ray's direction.
    t: f32,
    // Whether the corners appear counter-clockwise.
    front: bool,
}

// The ray starts at zero. `a` is the first corner, `e1` and `e2` lead from it to the others (Möller, Trumbore:
// "Fast, Minimum Storage Ray/Triangle Intersection", 1997). A rasteriser may show a triangle up to its snapping
// precision outside its edges, where a plane seen edge-on would be met anywhere: such a hit is moved to the
// triangle's edge. A triangle without area is met in its middle.
fn cross_triangle(direction: vec3f, a: vec3f, e1: vec3f, e2: vec3f) -> Crossing {
    let p = cross(direction, e2);
    let q = cross(e1, a);
    let det = dot(e1, p);
    var u = -dot(a, p) / det;
    var v = dot(direction, q) / det;
    // Not a number, or infinite: edge-on.
    if !(abs(u) < 1e9 && abs(v) < 1e9) {
        u = 1.0 / 3.0;
        v = 1.0 / 3.0;
    }
    u = saturate(u);
    v = saturate(v);
    let excess = max(u + v, 1.0);
    let barycentric = vec2f(u, v) / excess;
    // A point blended from corners is as inexact as the triangle is large. Its plane is not: a floor of a
    // kilometre is met where it should be, a metre away. Seen edge-on the plane says little, but the corners
    // bound what it says.
    let normal = cross(e1, e2);
    let plane = dot(normal, a) / dot(normal, direction);
    let along = vec3f(dot(a, direction), dot(a + e1, direction), dot(a + e2, direction)) / dot(direction, direction);
    let nearest = min(min(along.x, along.y), along.z);
    let farthest = max(max(along.x, along.y), along.z);
    let blended = along.x * (1.0 - barycentric.x - barycentric.y) + along.y * barycentric.x + along.z * barycentric.y;
    let t = select(blended, clamp(plane, nearest, farthest), abs(plane) < 1e30);
    return Crossing(barycentric, max(t, 0.0), det > 0.0);
}

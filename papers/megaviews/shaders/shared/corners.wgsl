// Triangles as nine f32 each: three corners, in edges of the root cube.

@group(0) @binding(0) var<storage, read> triangles: array<f32>;

fn corner(triangle: u32, index: u32) -> vec3f {
    let at = triangle * 9u + index * 3u;
    return vec3f(triangles[at], triangles[at + 1u], triangles[at + 2u]);
}

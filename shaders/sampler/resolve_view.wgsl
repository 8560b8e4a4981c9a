// Program of `sampler/src/passes/resolve_view.rs`: colour, radiance and range of a direct view's pixels.

import package::shared::encode::{display_from_radiance};
import package::shared::finite::finite_or_zero;
import package::shared::geometry::{instances, mesh_from_world, meshes, triangle_about_eye};
import package::shared::ray_triangle::{cross_triangle};
import package::shared::rays::{Rays, list_index, ray_through};

struct ResolveView {
    // Pixels of the tile.
    size: vec2u,
    // Sub-samples along each side of a pixel.
    side: u32,
    // Radiance to display-linear.
    exposure: f32,
}

@group(0) @binding(0) var<uniform> resolve: ResolveView;
@group(0) @binding(1) var<storage, read> shaded: array<vec4f>;
// sRGB bytes, three a pixel, rows without padding.
@group(0) @binding(2) var<storage, read_write> color: array<u32>;

// Mean radiance of a pixel.
fn mean(pixel: u32) -> vec3f {
    let corner = vec2u(pixel % resolve.size.x, pixel / resolve.size.x) * resolve.side;
    let width = resolve.size.x * resolve.side;
    // No tile has 2³² pixels. Quirk: uniform-bound.
    let side = resolve.side + u32(pixel == 0xffffffffu);
    var sum = vec3f(0.0);
    for (var y = 0u; y < side; y++) {
        for (var x = 0u; x < side; x++) {
            sum += shaded[(corner.y + y) * width + corner.x + x].rgb;
        }
    }
    return sum / f32(resolve.side * resolve.side);
}

fn display(pixel: u32) -> u32 {
    return display_from_radiance(mean(pixel), resolve.exposure);
}

// Three numbers a pixel, rows without padding.
@group(0) @binding(7) var<storage, read_write> radiance: array<f32>;

@compute @workgroup_size(8, 8)
fn resolve_radiance(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= resolve.size.x || id.y >= resolve.size.y {
        return;
    }
    let pixel = id.y * resolve.size.x + id.x;
    let value = finite_or_zero(mean(pixel));
    radiance[3u * pixel] = value.r;
    radiance[3u * pixel + 1u] = value.g;
    radiance[3u * pixel + 2u] = value.b;
}

// Writes four pixels, which are three words.
@compute @workgroup_size(64)
fn resolve_color(@builtin(global_invocation_id) id: vec3u) {
    let pixels = resolve.size.x * resolve.size.y;
    let first = 4u * id.x;
    if first >= pixels {
        return;
    }
    let last = pixels - 1u;
    let a = display(first);
    let b = display(min(first + 1u, last));
    let c = display(min(first + 2u, last));
    let d = display(min(first + 3u, last));
    color[3u * id.x] = a | (b << 24u);
    color[3u * id.x + 1u] = (b >> 8u) | (c << 16u);
    color[3u * id.x + 2u] = (c >> 16u) | (d << 8u);
}

@group(0) @binding(3) var<uniform> rays: Rays;
@group(0) @binding(4) var visibility: texture_2d<u32>;
// f32 bits, metres; infinity for sky.
@group(0) @binding(5) var<storage, read_write> range: array<u32>;

// For a list of pixels, the position of each in the tile: column, and row in the upper half.
@group(0) @binding(6) var<storage, read> places: array<u32>;

const INFINITY_BITS: u32 = 0x7f800000u;

// For rays that are listed, the unit direction of each pixel; zero for no ray.
@group(0) @binding(7) var<storage, read> directions: array<vec4f>;

// Bits of the distance along a ray.
fn range_along(ids: vec2u, ray: vec3f) -> u32 {
    if ids.x == 0u {
        return INFINITY_BITS;
    }
    let instance = instances[ids.x - 1u];
    let triangle = triangle_about_eye(instance, meshes[instance.mesh], ids.y);
    let direction = normalize(ray);
    let in_mesh = mesh_from_world(instance, direction);
    let crossing = cross_triangle(in_mesh, triangle.a, triangle.e1, triangle.e2);
    return bitcast<u32>(clamp(crossing.t, 0.0, 3.4e38));
}

// For a visibility buffer with one sub-sample a pixel, at its centre.
@compute @workgroup_size(8, 8)
fn resolve_range(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    range[id.y * rays.width + id.x] = range_along(textureLoad(visibility, id.xy, 0).xy, ray_through(rays, vec2f(id.xy) + 0.5));
}

// For a list of pixels.
@compute @workgroup_size(8, 8)
fn resolve_pixel_range(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let place = places[min(list_index(rays, id.xy), arrayLength(&places) - 1u)];
    let pixel = vec2u(place & 0xffffu, place >> 16u);
    let ray = ray_through(rays, vec2f(pixel) + 0.5);
    range[id.y * rays.width + id.x] = range_along(textureLoad(visibility, id.xy, 0).xy, ray);
}

// For listed rays. What has no ray has no visible triangle.
@compute @workgroup_size(8, 8)
fn resolve_ray_range(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    range[at] = range_along(textureLoad(visibility, id.xy, 0).xy, directions[at].xyz);
}

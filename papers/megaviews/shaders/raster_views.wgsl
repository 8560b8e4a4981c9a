// Program of papers/megaviews/src/many_views/raster.rs: renders maps of many views from the scene's triangles, every triangle for every
// view. Each texel has the range of the nearest triangle that its ray hits. Hierarchies are compared with this.

import package::megaviews::shared::corners::corner;
import package::megaviews::shared::map_texels::{MapTexel, put_texel, texel_place};
import package::megaviews::shared::paraboloid::{paraboloid_area, paraboloid_ray};

struct RasterStep {
    triangles: u32,
    first_view: u32,
    side: u32,
    // Length of the root's edge, metres.
    edge: f32,
    map_shift: u32,
}

var<immediate> step: RasterStep;

// Two vectors per view: position and half the field of view; direction.
@group(0) @binding(1) var<storage, read> views: array<vec4f>;

@compute @workgroup_size(64)
fn raster(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let triangle = group.x * 64u + local;
    if triangle >= step.triangles {
        return;
    }
    let view = step.first_view + group.y;
    let eye = views[2u * view];
    let a = corner(triangle, 0u) - eye.xyz;
    let b = corner(triangle, 1u) - eye.xyz;
    let c = corner(triangle, 2u) - eye.xyz;
    let center = (a + b + c) / 3.0;
    let radius = max(max(distance(a, center), distance(b, center)), distance(c, center)) * 1.001 + 1e-7;
    let normal = cross(b - a, c - a);
    let height = dot(normal, a);
    // The triangle is behind a view that sees one hemisphere.
    let unseen = eye.w < 1.5708 && dot(views[2u * view + 1u].xyz, center) < -radius;
    let side = f32(step.side);
    let one_side = paraboloid_area(center, radius, 0u, side);
    let other_side = paraboloid_area(center, radius, 1u, side);
    let texels = one_side.z * one_side.w;
    let all_texels = select(texels + other_side.z * other_side.w, 0u, unseen);
    var area = one_side;
    var hemisphere = 0u;
    var cell = area.xy;
    for (var i = 0u; i < all_texels; i++) {
        if i == texels {
            area = other_side;
            hemisphere = 1u;
            cell = area.xy;
        }
        let ray = paraboloid_ray(hemisphere, cell, side);
        // Signed volumes of the ray with each edge. All have the same sign inside the triangle.
        let u = dot(ray, cross(b, a));
        let v = dot(ray, cross(c, b));
        let w = dot(ray, cross(a, c));
        let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let along = height / select(dot(normal, ray), 1e-37, dot(normal, ray) == 0.0);
        // A view does not see the surface that it lies on.
        if inside && along * length(ray) > 1e-6 {
            let texel = (hemisphere * step.side + cell.y) * step.side + cell.x;
            let value = MapTexel(1.0 / (along * length(ray) * step.edge), triangle);
            put_texel(texel_place(view, step.map_shift, step.side, texel), value);
        }
        let ends_row = cell.x + 1u == area.x + area.z;
        cell = select(vec2u(cell.x + 1u, cell.y), vec2u(area.x, cell.y + 1u), ends_row);
    }
}

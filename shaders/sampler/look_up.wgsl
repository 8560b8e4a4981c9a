// Program of `sampler/src/passes/look_up.rs`: what each sub-sample of an omni sample sees, by its camera's map of an
// octree's nodes.

import package::shared::encode::{unit_from_octahedral};
import package::shared::finite::{finite_or_zero};
import package::shared::paraboloid::{paraboloid_index};
import package::shared::rays::{Rays, central_ray, ray_through};
import package::shared::shading::{sky_radiance};
import package::shared::surface::{lighting};
import package::shared::surfel::{Surfel, is_seen};

struct LookUp {
    // Number of the camera among the views that maps were rendered for.
    view: u32,
    // Maps of one array: 2 to the power of this.
    map_shift: u32,
    // Texels of a hemisphere's side.
    map_side: u32,
    // Length of the octree's root's edge, metres.
    edge: f32,
    // Radius of the ball around a leaf's cell, metres.
    radius: f32,
}

// Sine of the angle to a plane below which its own direction is no guide to where the surface goes on.
const FLATTEST: f32 = 0.1;

// Cosine between a ray and the axis of a node that it meets from behind, below which the node is seen all the same.
const RIM: f32 = 0.5;

// Arrays that maps are spread over.
override arrays: u32 = 1u;

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(3) var<uniform> told: LookUp;
@group(0) @binding(4) var<storage, read_write> shaded: array<vec4f>;
@group(0) @binding(5) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(6) var<storage, read> surfels: array<Surfel>;
// Of each level, the leaves' first, the number of the node after its last.
@group(0) @binding(7) var<storage, read> ends: array<u32>;
@group(0) @binding(8) var<storage, read> map_of_view: array<u32>;
// Where each map is seen from: in edges of the root, f32 bits.
@group(0) @binding(9) var<storage, read> middles: array<vec4u>;
// Node and inverse range (f32 bits; 0 where nothing was seen) of each texel.
@group(0) @binding(10) var<storage, read> maps0: array<vec2u>;
@group(0) @binding(11) var<storage, read> maps1: array<vec2u>;
@group(0) @binding(12) var<storage, read> maps2: array<vec2u>;
@group(0) @binding(13) var<storage, read> maps3: array<vec2u>;

fn texel_of(map: u32, texel: u32) -> vec2u {
    let array_ = map >> told.map_shift;
    let at = (map - (array_ << told.map_shift)) * 2u * told.map_side * told.map_side + texel;
    if arrays == 1u || array_ == 0u {
        return maps0[min(at, arrayLength(&maps0) - 1u)];
    } else if arrays == 2u || array_ == 1u {
        return maps1[min(at, arrayLength(&maps1) - 1u)];
    } else if arrays == 3u || array_ == 2u {
        return maps2[min(at, arrayLength(&maps2) - 1u)];
    }
    return maps3[min(at, arrayLength(&maps3) - 1u)];
}

// The radius of the ball around a node's cell: twice that of the level below.
fn radius_of(node: u32) -> f32 {
    var radius = told.radius;
    for (var i = 0u; i < arrayLength(&ends); i++) {
        radius *= select(1.0, 2.0, node >= ends[i]);
    }
    return radius;
}

@compute @workgroup_size(8, 8)
fn look_up(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let ray = ray_through(rays, vec2f(id.xy) + 0.5);
    let map = map_of_view[min(told.view, arrayLength(&map_of_view) - 1u)];
    let texel = texel_of(map, paraboloid_index(ray, told.map_side));
    let node = min(texel.x, arrayLength(&surfels) - 1u);
    let surfel = surfels[node];
    let axis = unit_from_octahedral(unpack2x16snorm(surfel.axis));
    let behind = dot(axis, ray) / length(ray);
    let near_side = select(surfel.back, surfel.front, behind < 0.0);
    // What turns away but a little is the rim of something round, whose other leaves face the eye.
    let rim = !is_seen(near_side) && behind < RIM;
    let radiance = select(near_side, surfel.front, rim);
    // A map holds the nearest node alone: what lies behind the back of a single-sided surface is taken for sky.
    if texel.y == 0u || !is_seen(radiance) {
        shaded[at] = vec4f(finite_or_zero(sky_radiance(lighting, normalize(ray))), 0.0);
        return;
    }
    let eye = bitcast<vec3f>(middles[min(map, arrayLength(&middles) - 1u)].xyz);
    let to_mean = (bitcast<vec3f>(nodes[node].xyz) - eye) * told.edge;
    // Where the texel's central ray meets the node's plane. A map has a node where rays meet its cell, so that a ray
    // that grazes the plane may yet go on to meet it some cells away.
    let central = normalize(central_ray(rays, id.xy));
    let closest = dot(to_mean, central);
    let slope = dot(axis, central);
    let plane = (dot(axis, to_mean) + surfel.offset) / slope;
    let reach = radius_of(node) / max(abs(slope), FLATTEST);
    let met = clamp(select(closest, plane, abs(plane) < 1e18), closest - reach, closest + reach);
    let range = max(met, 1e-3 * told.radius);
    shaded[at] = vec4f(radiance, 1.0 / range);
}

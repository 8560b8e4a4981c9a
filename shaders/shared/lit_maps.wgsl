// What a map of an octree's nodes shows along a ray: the radiance of the node that the ray meets, and how far off that is.

import package::shared::encode::{unit_from_octahedral};
import package::shared::finite::{finite_or_zero};
import package::shared::node_maps::{map_of, node_texel};
import package::shared::paraboloid::{paraboloid_index};
import package::shared::shading::{sky_radiance};
import package::shared::surface::{lighting};
import package::shared::surfel::{Surfel, is_seen, radiance_towards};

struct MapLookup {
    // Number of the camera, or of the first, among the views that maps were rendered for.
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

@group(0) @binding(3) var<uniform> lookup: MapLookup;
@group(0) @binding(5) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(6) var<storage, read> surfels: array<Surfel>;
// Of each level, the leaves' first, the number of the node after its last.
@group(0) @binding(7) var<storage, read> ends: array<u32>;
// Where each map is seen from: in edges of the root, f32 bits.
@group(0) @binding(9) var<storage, read> map_centers: array<vec4u>;

// The radius of the ball around a node's cell: twice that of the level below.
fn radius_of(node: u32) -> f32 {
    var radius = lookup.radius;
    for (var i = 0u; i < arrayLength(&ends); i++) {
        radius *= select(1.0, 2.0, node >= ends[i]);
    }
    return radius;
}

// Radiance along a unit ray from a view's place, and in w the inverse range, 1/metres, along a unit ray beside it; 0 for
// the sky.
fn seen_in_map(view: u32, ray: vec3f, central: vec3f) -> vec4f {
    let map = map_of(view);
    let texel = node_texel(map, lookup.map_shift, lookup.map_side, paraboloid_index(ray, lookup.map_side));
    let node = min(texel.x, arrayLength(&surfels) - 1u);
    let surfel = surfels[node];
    let axis = unit_from_octahedral(unpack2x16snorm(surfel.axis));
    let radiance = radiance_towards(surfel, axis, ray);
    // A map holds the nearest node alone: what lies behind the back of a single-sided surface is taken for sky.
    if texel.y == 0u || !is_seen(radiance) {
        return vec4f(finite_or_zero(sky_radiance(lighting, ray)), 0.0);
    }
    let eye = bitcast<vec3f>(map_centers[min(map, arrayLength(&map_centers) - 1u)].xyz);
    let to_mean = (bitcast<vec3f>(nodes[node].xyz) - eye) * lookup.edge;
    // Where the ray meets the node's plane. A map has a node where rays meet its cell, so that a ray that grazes the plane
    // may yet go on to meet it some cells away.
    let closest = dot(to_mean, central);
    let slope = dot(axis, central);
    let plane = (dot(axis, to_mean) + surfel.offset) / slope;
    let reach = radius_of(node) / max(abs(slope), FLATTEST);
    let met = clamp(select(closest, plane, abs(plane) < 1e18), closest - reach, closest + reach);
    let range = max(met, 1e-3 * lookup.radius);
    return vec4f(radiance, 1.0 / range);
}

// Looks up a ray in a map of octree nodes: radiance and range of the node that the ray hits.

import package::shared::encode::{unit_from_octahedral};
import package::shared::finite::{finite_or_zero};
import package::megaviews::shared::node_maps::{map_of, node_texel};
import package::megaviews::shared::paraboloid::{paraboloid_index};
import package::shared::shading::{sky_radiance};
import package::shared::surface::{lighting};
import package::megaviews::shared::surfel::{Surfel, is_seen, radiance_towards};

struct MapLookup {
    // Index of the camera, or of the first one, among the views of the traversal.
    view: u32,
    // Base-2 logarithm of the number of maps in one array.
    map_shift: u32,
    // Texels on a side of a hemisphere.
    map_side: u32,
    // Length of the octree's root's edge, metres.
    edge: f32,
    // Radius of the sphere around a leaf's cell, metres.
    radius: f32,
}

// Least sine of the angle to a plane at which the plane's slope is used.
const FLATTEST: f32 = 0.1;

@group(0) @binding(3) var<uniform> lookup: MapLookup;
@group(0) @binding(5) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(6) var<storage, read> surfels: array<Surfel>;
// For each level, starting with the leaves, the index after its last node.
@group(0) @binding(7) var<storage, read> ends: array<u32>;
// Centre of each map, in edges of the root, f32 bits.
@group(0) @binding(9) var<storage, read> map_centers: array<vec4u>;

// Radius of the sphere around a node's cell; it doubles with each level.
fn radius_of(node: u32) -> f32 {
    var radius = lookup.radius;
    for (var i = 0u; i < arrayLength(&ends); i++) {
        radius *= select(1.0, 2.0, node >= ends[i]);
    }
    return radius;
}

// Radiance along a unit ray from a view's centre. w is the inverse range (1/metres) along the neighbouring ray `central`;
// 0 for sky.
fn seen_in_map(view: u32, ray: vec3f, central: vec3f) -> vec4f {
    let map = map_of(view);
    let texel = node_texel(map, lookup.map_shift, lookup.map_side, paraboloid_index(ray, lookup.map_side));
    let node = min(texel.x, arrayLength(&surfels) - 1u);
    let surfel = surfels[node];
    let axis = unit_from_octahedral(unpack2x16snorm(surfel.axis));
    let radiance = radiance_towards(surfel, axis, ray);
    // A map has only the nearest node, so the back of a single-sided surface shows sky.
    if texel.y == 0u || !is_seen(radiance) {
        return vec4f(finite_or_zero(sky_radiance(lighting, ray)), 0.0);
    }
    let eye = bitcast<vec3f>(map_centers[min(map, arrayLength(&map_centers) - 1u)].xyz);
    let to_mean = (bitcast<vec3f>(nodes[node].xyz) - eye) * lookup.edge;
    // Intersection of the ray with the node's plane. A map has a node where rays hit its cell, so a grazing ray may hit
    // the plane some cells away.
    let closest = dot(to_mean, central);
    let slope = dot(axis, central);
    let plane = (dot(axis, to_mean) + surfel.offset) / slope;
    let reach = radius_of(node) / max(abs(slope), FLATTEST);
    let met = clamp(select(closest, plane, abs(plane) < 1e18), closest - reach, closest + reach);
    let range = max(met, 1e-3 * lookup.radius);
    return vec4f(radiance, 1.0 / range);
}

// Merges texels of a view node's map into the maps of its descendants (MegaViews, section 3.2.5).

import package::megaviews::shared::map_texels::{MapTexel, load_texel, names_nodes, stays, stored, texel_place};
import package::megaviews::shared::paraboloid::{paraboloid_cell, paraboloid_ray};

struct Fusion {
    side: u32,
    // Length of the root's edge, metres.
    edge: f32,
    map_shift: u32,
    // Level of the maps, or number of queries.
    level: u32,
}

var<immediate> fusion: Fusion;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
// Mean position of each map's views (f32 bits), and the map that it inherits from.
@group(0) @binding(1) var<storage, read> maps: array<vec4u>;

fn map_texel(map: u32, texel: u32) -> MapTexel {
    return load_texel(texel_place(map, fusion.map_shift, fusion.side, texel));
}

// The value of a texel of the map `above`, with its range relative to the views of `map`, in stored precision. It keeps the
// index of its texel, since moving texels would leave holes. Texels that name nodes get exact ranges from them. Otherwise
// each merge may add a rounding error.
fn seen_from(value: MapTexel, above: u32, map: u32, texel: u32) -> MapTexel {
    let eye = bitcast<vec3f>(maps[map].xyz);
    let there = bitcast<vec3f>(maps[above].xyz);
    var point = bitcast<vec3f>(nodes[value.node].xyz);
    if !names_nodes {
        let cell = paraboloid_cell(texel, f32(fusion.side));
        let ray = normalize(paraboloid_ray(cell.x, cell.yz, f32(fusion.side)));
        point = there + ray / max(value.inverse_range * fusion.edge, 1e-30);
    }
    let inverse_range = 1.0 / max(distance(point, eye) * fusion.edge, 1e-37);
    return stored(MapTexel(select(inverse_range, 0.0, value.inverse_range == 0.0), value.node));
}

// The value that a texel keeps if both are written.
fn nearer(a: MapTexel, b: MapTexel) -> MapTexel {
    let first = stays(a, b);
    return MapTexel(select(b.inverse_range, a.inverse_range, first), select(b.node, a.node, first));
}

// Program of papers/megaviews/src/many_views/traverse.rs: renders leaves that are near and cover many texels (MegaViews, section 3.2.4). A
// leaf is written to each texel whose ray hits its cell.

import package::shared::linear::linear_index;
import package::megaviews::shared::map_texels::{MapTexel, put_texel, texel_place};
import package::megaviews::shared::paraboloid::{paraboloid_area, paraboloid_ray};

struct FillStep {
    // Cells along an edge of the scene's root, and the radius of a cell's sphere.
    cells: f32,
    radius: f32,
    side: u32,
    // Length of the root's edge, metres.
    edge: f32,
    capacity: u32,
    // Index of the queue in `counters`.
    counters: u32,
    map_shift: u32,
}

var<immediate> step: FillStep;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read> view_links: array<vec4u>;
@group(0) @binding(2) var<storage, read> view_maps: array<vec2u>;
@group(0) @binding(3) var<storage, read> queue: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> counters: array<atomic<u32>>;

// Maps show the leaf whose cell contains the viewpoint; its rays hit that cell in all directions.
override own_cell: bool = true;

@compute @workgroup_size(64)
fn fill(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= min(atomicLoad(&counters[step.counters]), step.capacity) {
        return;
    }
    let pair = queue[at];
    let mean = bitcast<vec3f>(nodes[pair.x].xyz);
    let eye = bitcast<vec3f>(view_links[pair.y].xyz);
    let d = mean - eye;
    let range = length(d);
    let value = MapTexel(1.0 / max(range * step.edge, 1e-37), pair.x);
    let map = view_maps[pair.y].x;
    let half_cell = 0.5 / step.cells;
    let to_center = (floor(mean * step.cells) + 0.5) / step.cells - eye;
    let side = f32(step.side);
    // Slightly larger than the cell's bounding sphere, so that rounding loses no corner of the cell.
    let one_side = paraboloid_area(to_center, step.radius * 1.001, 0u, side);
    let other_side = paraboloid_area(to_center, step.radius * 1.001, 1u, side);
    let texels = one_side.z * one_side.w;
    let all_texels = texels + other_side.z * other_side.w;
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
        // Distances at which the ray enters and leaves the cell's slab on each axis.
        let inverse = 1.0 / select(ray, vec3f(1e-20), abs(ray) < vec3f(1e-20));
        let one = (to_center - half_cell) * inverse;
        let other = (to_center + half_cell) * inverse;
        let begin = max(max(min(one.x, other.x), min(one.y, other.y)), min(one.z, other.z));
        let end = min(min(max(one.x, other.x), max(one.y, other.y)), max(one.z, other.z));
        if end >= max(begin, 0.0) && (own_cell || begin > 0.0) {
            let texel = (hemisphere * step.side + cell.y) * step.side + cell.x;
            put_texel(texel_place(map, step.map_shift, step.side, texel), value);
        }
        // Next texel, row by row, without an integer division.
        let ends_row = cell.x + 1u == area.x + area.z;
        cell = select(vec2u(cell.x + 1u, cell.y), vec2u(area.x, cell.y + 1u), ends_row);
    }
}

// Program of gpu/src/many_views/fill.rs: leaves that are so near that they cover many texels (MegaViews, section
// 3.2.4). Eight lanes take a pair, and each texel whose ray meets the leaf's cell holds it.

import package::shared::map_texels::{MapTexel, put_texel, texel_place};
import package::shared::paraboloid::paraboloid_ray;

struct FillStep {
    // Cells along an edge of the scene's root, and the radius of a cell's sphere.
    cells: f32,
    radius: f32,
    side: u32,
    // Length of the root's edge, metres.
    edge: f32,
    capacity: u32,
    // Entry of `counters` for the queue.
    counters: u32,
    map_shift: u32,
}

var<immediate> step: FillStep;


@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read> view_links: array<vec4u>;
@group(0) @binding(2) var<storage, read> view_maps: array<vec2u>;
@group(0) @binding(3) var<storage, read> queue: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> counters: array<atomic<u32>>;

// First texel and number of texels, in each direction, that a ball covers in a hemisphere; all of them where it holds
// the eye or the opposite pole.
fn covered(d: vec3f, range: f32, hemisphere: u32) -> vec4u {
    let side = f32(step.side);
    let x = select(d.x, -d.x, hemisphere == 1u);
    let tangent = sqrt(max(range * range - step.radius * step.radius, 0.0));
    let over = x + tangent;
    let is_disc = range > step.radius && over > 0.05 * range;
    let center = d.yz / max(over, 1e-37);
    let disc = step.radius / max(over, 1e-37);
    // A sample point may lie half a texel from its texel's centre.
    let least = ((center - disc) * 0.5 + 0.5) * side - 1.0;
    let most = ((center + disc) * 0.5 + 0.5) * side + 1.0;
    let first = vec2u(clamp(select(vec2f(0.0), least, is_disc), vec2f(0.0), vec2f(side)));
    let end = vec2u(clamp(select(vec2f(side), ceil(most), is_disc), vec2f(0.0), vec2f(side)));
    return vec4u(first, max(end, first) - first);
}

@compute @workgroup_size(64)
fn fill(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = (group.y * groups.x + group.x) * 8u + local / 8u;
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
    for (var hemisphere = 0u; hemisphere < 2u; hemisphere++) {
        let area = covered(d, range, hemisphere);
        let texels = area.z * area.w;
        for (var i = local & 7u; i < texels; i += 8u) {
            let cell = area.xy + vec2u(i % area.z, i / area.z);
            let texel = (hemisphere * step.side + cell.y) * step.side + cell.x;
            let ray = paraboloid_ray(texel, step.side);
            // Where the ray enters and leaves the cell, along each axis.
            let inverse = 1.0 / select(ray, vec3f(1e-20), abs(ray) < vec3f(1e-20));
            let one = (to_center - half_cell) * inverse;
            let other = (to_center + half_cell) * inverse;
            let begin = max(max(min(one.x, other.x), min(one.y, other.y)), min(one.z, other.z));
            let end = min(min(max(one.x, other.x), max(one.y, other.y)), max(one.z, other.z));
            if end >= max(begin, 0.0) {
                put_texel(texel_place(map, step.map_shift, step.side, texel), value);
            }
        }
    }
}

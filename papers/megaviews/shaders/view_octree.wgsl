// Program of papers/megaviews/src/many_views/view_octree.rs: builds an octree over views. Each node has a bounding sphere of positions
// and a bounding cone of view directions (MegaViews, section 3.1).
//
// Coordinates are in edges of the scene's root cube. A node with one child shares the child's map, since both have the same
// views.

import package::megaviews::shared::cone::{cos_of_sum, direction_of, widened};
import package::shared::linear::linear_index;
import package::megaviews::shared::morton::{morton_cell, morton_code};

struct ViewStep {
    // Corner and edge of the views' root cube, in edges of the scene's root cube.
    origin: vec3f,
    edge: f32,
    // Number of views, or bound on the number of nodes.
    count: u32,
    level: u32,
    // Cells along an edge of the root on the level.
    cells: f32,
    // Bits TIGHT and BY_DIRECTION.
    flags: u32,
}

var<immediate> step: ViewStep;

// Two vectors per view: position and half the field of view (π: all directions); direction.
@group(0) @binding(0) var<storage, read> views: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> keys: array<vec2u>;
@group(0) @binding(2) var<storage, read> sorted: array<vec2u>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> levels: array<vec2u>;
@group(0) @binding(5) var<storage, read> codes: array<u32>;
@group(0) @binding(6) var<storage, read> first_children: array<u32>;
// Two vectors per node: centre and radius of the sphere of positions; axis of the view cone and cosine of its half angle.
@group(0) @binding(7) var<storage, read_write> view_bounds: array<vec4f>;
// Mean position (f32 bits); 256 × the first child + a bit for each octant with a child.
@group(0) @binding(8) var<storage, read_write> view_links: array<vec4u>;
// Map of each node, and the number of views that share it.
@group(0) @binding(9) var<storage, read_write> view_maps: array<vec2u>;
// Leaf of each view.
@group(0) @binding(10) var<storage, read_write> leaf_of_view: array<u32>;
// 1 for each node with a map of its own, else 0. After a scan: index of the map.
@group(0) @binding(11) var<storage, read_write> heads: array<u32>;
@group(0) @binding(12) var<storage, read> total: array<u32>;
// Mean position of each map's views (f32 bits), and the map that it inherits from; the root's map names itself.
@group(0) @binding(13) var<storage, read_write> maps: array<vec4u>;
// For each level, its first map and its number of maps.
@group(0) @binding(14) var<storage, read_write> map_levels: array<vec2u>;

// Uses a sphere around the views themselves if it is smaller than the cell's.
const TIGHT: u32 = 1u;
// The nodes of this level divide the views of a cell by their direction, not by position.
const BY_DIRECTION: u32 = 2u;

const HALF_DIAGONAL: f32 = 0.8660255;

// The nearest of the six axis directions: 0 to 5 for +x, -x, +y, -y, +z, -z.
fn facing(direction: vec3f) -> u32 {
    let along = abs(direction);
    var axis = select(0u, 1u, along.y > along.x);
    axis = select(axis, 2u, along.z > max(along.x, along.y));
    return 2u * axis + select(0u, 1u, direction[axis] < 0.0);
}

// Writes the Morton code of each view, to sort by.
@compute @workgroup_size(64)
fn view_keys(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        let by_direction = (step.flags & BY_DIRECTION) != 0u;
        let cells = select(step.cells, 0.5 * step.cells, by_direction);
        let cell = (views[2u * at].xyz - step.origin) / step.edge * cells;
        let code = morton_code(vec3u(clamp(cell, vec3f(0.0), vec3f(cells - 1.0))));
        keys[at] = vec2u(at, select(code, 8u * code + facing(views[2u * at + 1u].xyz), by_direction));
    }
}

// Makes every view a node of its own, without a hierarchy.
@compute @workgroup_size(64)
fn single_views(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        let view = views[2u * at];
        let seen = widened(cos(min(view.w, 3.1415927)));
        view_bounds[2u * at] = vec4f(view.xyz, 0.0);
        view_bounds[2u * at + 1u] = vec4f(direction_of(views[2u * at + 1u].xyz), seen);
        view_links[at] = vec4u(bitcast<vec3u>(view.xyz), 0u);
        view_maps[at] = vec2u(at, 1u);
        leaf_of_view[at] = at;
        maps[at] = vec4u(bitcast<vec3u>(view.xyz), at);
    }
}

// Writes a node with the smaller sphere: the one around the mean, or the cell's.
fn store(node: u32, mean: vec3f, radius: f32, links: u32, cone: vec4f, code: u32) {
    let by_direction = (step.flags & BY_DIRECTION) != 0u;
    let side = step.edge / select(step.cells, 0.5 * step.cells, by_direction);
    let center = step.origin + (vec3f(morton_cell(select(code, code >> 3u, by_direction))) + 0.5) * side;
    // Padding covers the rounding of the mean and of distances to it.
    let reach = radius * 1.00001 + 4e-7;
    let is_tight = (step.flags & TIGHT) != 0u && reach < HALF_DIAGONAL * side;
    let sphere = select(vec4f(center, HALF_DIAGONAL * side), vec4f(mean, select(reach, 0.0, radius == 0.0)), is_tight);
    view_bounds[2u * node] = sphere;
    view_bounds[2u * node + 1u] = cone;
    view_links[node] = vec4u(bitcast<vec3u>(mean), links);
}

// Bounds leaves from their views.
@compute @workgroup_size(64)
fn view_leaves(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let leaf = linear_index(group, groups, local);
    if leaf >= levels[step.level].y {
        return;
    }
    let first = starts[leaf];
    let end = starts[leaf + 1u];
    let origin = views[2u * sorted[first].x].xyz;
    var offset = vec3f(0.0);
    var direction = vec3f(0.0);
    for (var i = first; i < end; i++) {
        let view = sorted[i].x;
        offset += views[2u * view].xyz - origin;
        direction += direction_of(views[2u * view + 1u].xyz);
        leaf_of_view[view] = leaf;
    }
    let mean = origin + offset / f32(end - first);
    let axis = direction_of(direction);
    var cosine = 1.0;
    var radius = 0.0;
    for (var i = first; i < end; i++) {
        let view = views[2u * sorted[i].x];
        let apart = clamp(dot(axis, direction_of(views[2u * sorted[i].x + 1u].xyz)), -1.0, 1.0);
        cosine = min(cosine, cos_of_sum(apart, cos(min(view.w, 3.1415927))));
        radius = max(radius, distance(view.xyz, mean));
    }
    store(leaf, mean, radius, 0u, vec4f(axis, widened(cosine)), codes[leaf]);
    view_maps[leaf] = vec2u(leaf, end - first);
}

// Bounds nodes from their children.
@compute @workgroup_size(64)
fn view_nodes(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let own = levels[step.level];
    let at = linear_index(group, groups, local);
    if at >= own.y {
        return;
    }
    let node = own.x + at;
    let below = levels[step.level + 1u];
    let first = first_children[node];
    let code = codes[node];
    let end = min(first + 8u, below.x + below.y);
    var mask = 0u;
    var offset = vec3f(0.0);
    var direction = vec3f(0.0);
    var count = 0u;
    let origin = bitcast<vec3f>(view_links[first].xyz);
    for (var child = first; child < end; child++) {
        if codes[child] >> 3u == code {
            let views_below = view_maps[child].y;
            mask |= 1u << (codes[child] & 7u);
            offset += (bitcast<vec3f>(view_links[child].xyz) - origin) * f32(views_below);
            direction += view_bounds[2u * child + 1u].xyz * f32(views_below);
            count += views_below;
        }
    }
    // A single child has the same views, so its axis is taken unchanged.
    let mean = origin + offset / f32(count);
    let axis = select(direction_of(direction), view_bounds[2u * first + 1u].xyz, countOneBits(mask) == 1u);
    var cosine = 1.0;
    var radius = 0.0;
    for (var child = first; child < end; child++) {
        if codes[child] >> 3u == code {
            let sphere = view_bounds[2u * child];
            let cone = view_bounds[2u * child + 1u];
            cosine = min(cosine, cos_of_sum(clamp(dot(axis, cone.xyz), -1.0, 1.0), cone.w));
            radius = max(radius, distance(sphere.xyz, mean) + sphere.w);
        }
    }
    store(node, mean, radius, first * 256u + mask, vec4f(axis, widened(cosine)), code);
    view_maps[node] = vec2u(0u, count);
}

// Whether a node has a map of its own.
fn has_map(links: u32) -> bool {
    return countOneBits(links & 255u) != 1u;
}

// Marks nodes with a map of their own.
@compute @workgroup_size(64)
fn map_heads(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let node = linear_index(group, groups, local);
    if node < step.count {
        let exists = node <= levels[0].x;
        heads[node] = select(0u, 1u, exists && has_map(view_links[min(node, levels[0].x)].w));
    }
}

// The node whose map a node uses: itself, or its first descendant with no child or several children.
fn owner_of(node: u32) -> u32 {
    var owner = node;
    for (var down = 0u; down < 10u; down++) {
        let links = view_links[owner].w;
        if has_map(links) {
            break;
        }
        owner = links >> 8u;
    }
    return owner;
}

// Writes the map of each node, and the mean position of each map.
@compute @workgroup_size(64)
fn map_links(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let node = linear_index(group, groups, local);
    if node >= step.count || node > levels[0].x {
        return;
    }
    let owner = owner_of(node);
    let map = heads[owner];
    view_maps[node].x = map;
    let links = view_links[node];
    if node == owner {
        maps[map] = vec4u(links.xyz, 0u);
    }
}

// Writes the map that each map inherits from.
@compute @workgroup_size(64)
fn map_parents(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let node = linear_index(group, groups, local);
    if node >= step.count || node > levels[0].x {
        return;
    }
    let links = view_links[node].w;
    let map = view_maps[node].x;
    if node == levels[0].x {
        maps[map].w = map;
    }
    if has_map(links) && links != 0u {
        let first = links >> 8u;
        let end = first + countOneBits(links & 255u);
        for (var child = first; child < end; child++) {
            maps[view_maps[child].x].w = map;
        }
    }
}

// Writes the first map and number of maps of each level.
@compute @workgroup_size(1)
fn map_ranges() {
    for (var level = 0u; level <= 10u; level++) {
        let range = levels[level];
        let end = range.x + range.y;
        let after = select(heads[min(end, levels[0].x)], total[0], end > levels[0].x);
        let used = level <= step.level;
        map_levels[level] = select(vec2u(0u), vec2u(heads[range.x], after - heads[range.x]), used);
    }
}

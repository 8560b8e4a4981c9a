// Program of papers/megaviews/src/hierarchy/octree.rs: averages the content of each cell of the scene: of leaves from their triangles,
// of nodes from their children.
//
// Coordinates are in edges of the root cube, 0..1.

import package::megaviews::shared::cone::{cos_of_sum, direction_of, widened};
import package::megaviews::shared::corners::corner;
import package::shared::linear::linear_index;
import package::megaviews::shared::morton::morton_cell;

struct Average {
    // Bound on the number of nodes of the level.
    count: u32,
    level: u32,
    // Cells along an edge of the root on the level.
    cells: f32,
}

var<immediate> average: Average;

// Linear reflectance of each triangle, eight bits per channel.
@group(0) @binding(1) var<storage, read> triangle_colors: array<u32>;
@group(0) @binding(2) var<storage, read> sorted: array<vec2u>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> levels: array<vec2u>;
@group(0) @binding(5) var<storage, read> codes: array<u32>;
@group(0) @binding(6) var<storage, read> first_children: array<u32>;
// Mean position (f32 bits); 256 × the first child + a bit for each octant with a child.
@group(0) @binding(7) var<storage, read_write> nodes: array<vec4u>;
// Axis of the cone of normals, and the cosine of its half angle.
@group(0) @binding(8) var<storage, read_write> cones: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> colors: array<u32>;
@group(0) @binding(10) var<storage, read_write> weights: array<f32>;
// For each leaf, the triangle that represents its front, and the one that represents its back. Both are the same if no
// triangle faces the other way.
@group(0) @binding(11) var<storage, read_write> facing: array<vec2u>;

// Largest offset of a mean from its cell's centre, in edges of the cell. The cell can thus be found from the mean.
const INSIDE: f32 = 0.499;

// Contribution of a triangle to a cell.
struct Share {
    // Position relative to the cell's centre, clamped to the cell, in edges of the cell.
    offset: vec3f,
    normal: vec3f,
    weight: f32,
}

fn share_of(triangle: u32, center: vec3f, side: f32) -> Share {
    let a = (corner(triangle, 0u) - center) / side;
    let ab = (corner(triangle, 1u) - center) / side - a;
    let ac = (corner(triangle, 2u) - center) / side - a;
    let normal = cross(ab, ac);
    let squared = dot(normal, normal);
    let reach = max(max(abs(a), abs(a + ab)), abs(a + ac));
    // The point of the triangle's plane that is nearest to the centre, moved into the triangle.
    let v = max(dot(cross(-a, ac), normal), 0.0) / max(squared, 1e-37);
    let w = max(dot(cross(ab, -a), normal), 0.0) / max(squared, 1e-37);
    let beyond = max(v + w, 1.0);
    let nearest = a + (ab * v + ac * w) / beyond;
    // A triangle inside the cell contributes its centroid.
    let point = select(nearest, a + (ab + ac) / 3.0, all(reach <= vec3f(0.5)));
    let area = 0.5 * sqrt(squared);
    return Share(clamp(point, vec3f(-0.5), vec3f(0.5)), direction_of(normal), clamp(area, 1e-12, 1.0));
}

fn store(node: u32, mean: vec3f, links: u32, cone: vec4f, color: vec3f, weight: f32) {
    nodes[node] = vec4u(bitcast<vec3u>(mean), links);
    cones[node] = cone;
    colors[node] = pack4x8unorm(vec4f(color, 1.0));
    weights[node] = weight;
}

// Averages leaves from their triangles.
@compute @workgroup_size(64)
fn average_leaves(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let leaf = linear_index(group, groups, local);
    if leaf >= levels[average.level].y {
        return;
    }
    let side = 1.0 / average.cells;
    let center = (vec3f(morton_cell(codes[leaf])) + 0.5) * side;
    let first = starts[leaf];
    let end = starts[leaf + 1u];
    var offset = vec3f(0.0);
    var normal = vec3f(0.0);
    var color = vec3f(0.0);
    var weight = 0.0;
    for (var i = first; i < end; i++) {
        let triangle = sorted[i].x;
        let share = share_of(triangle, center, side);
        offset += share.offset * share.weight;
        normal += share.normal * share.weight;
        color += unpack4x8unorm(triangle_colors[triangle]).xyz * share.weight;
        weight += share.weight;
    }
    let axis = direction_of(normal);
    var cosine = 1.0;
    for (var i = first; i < end; i++) {
        cosine = min(cosine, dot(axis, share_of(sorted[i].x, center, side).normal));
    }
    let inside = clamp(offset / weight, vec3f(-INSIDE), vec3f(INSIDE));
    store(leaf, center + inside * side, 0u, vec4f(axis, widened(cosine)), color / weight, weight * side * side);
}

// Weight of a triangle as the representative of a leaf: large and near the cell's centre.
fn prominence(share: Share) -> f32 {
    return share.weight * (1.0 - dot(share.offset, share.offset));
}

// Chooses the triangles that represent the two sides of each leaf.
@compute @workgroup_size(64)
fn face_leaves(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let leaf = linear_index(group, groups, local);
    if leaf >= levels[average.level].y {
        return;
    }
    let side = 1.0 / average.cells;
    let center = (vec3f(morton_cell(codes[leaf])) + 0.5) * side;
    let first = starts[leaf];
    let end = starts[leaf + 1u];
    // Pieces of a cell are sorted by triangle. Of equal ones the first is chosen.
    var front = sorted[first].x;
    var normal = vec3f(0.0);
    var most = 0.0;
    for (var i = first; i < end; i++) {
        let share = share_of(sorted[i].x, center, side);
        let is_better = prominence(share) > most;
        front = select(front, sorted[i].x, is_better);
        normal = select(normal, share.normal, is_better);
        most = select(most, prominence(share), is_better);
    }
    var back = front;
    most = 0.0;
    for (var i = first; i < end; i++) {
        let share = share_of(sorted[i].x, center, side);
        let is_better = dot(share.normal, normal) < 0.0 && prominence(share) > most;
        back = select(back, sorted[i].x, is_better);
        most = select(most, prominence(share), is_better);
    }
    facing[leaf] = vec2u(front, back);
}

// Averages nodes from their children.
@compute @workgroup_size(64)
fn average_nodes(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let own = levels[average.level];
    let at = linear_index(group, groups, local);
    if at >= own.y {
        return;
    }
    let node = own.x + at;
    let below = levels[average.level + 1u];
    let first = first_children[node];
    let code = codes[node];
    let end = min(first + 8u, below.x + below.y);
    var mask = 0u;
    var mean = vec3f(0.0);
    var normal = vec3f(0.0);
    var color = vec3f(0.0);
    var weight = 0.0;
    for (var child = first; child < end; child++) {
        if codes[child] >> 3u == code {
            let share = weights[child];
            mask |= 1u << (codes[child] & 7u);
            mean += bitcast<vec3f>(nodes[child].xyz) * share;
            normal += cones[child].xyz * share;
            color += unpack4x8unorm(colors[child]).xyz * share;
            weight += share;
        }
    }
    let axis = direction_of(normal);
    var cosine = 1.0;
    for (var child = first; child < end; child++) {
        if codes[child] >> 3u == code {
            cosine = min(cosine, cos_of_sum(clamp(dot(axis, cones[child].xyz), -1.0, 1.0), cones[child].w));
        }
    }
    let side = 1.0 / average.cells;
    let center = (vec3f(morton_cell(code)) + 0.5) * side;
    let inside = clamp(mean / weight - center, vec3f(-INSIDE * side), vec3f(INSIDE * side));
    store(node, center + inside, first * 256u + mask, vec4f(axis, widened(cosine)), color / weight, weight);
}

// Program of papers/megaviews/src/many_views/traverse.rs: one step of the simultaneous traversal of scene and views (MegaViews, section
// 3.2). Each pair of nodes in the queue is divided, and each resulting pair is culled, rendered or queued.
//
// All leaves of an octree are on its lowest level. So all pairs of a queue are on the same two levels, and the host knows
// which node of a pair to divide. Coordinates are in edges of the scene's root cube.

import package::shared::linear::linear_index;
import package::megaviews::shared::map_texels::{MapTexel, load_texel, put_texel, stays, stored, texel_place};
import package::megaviews::shared::paraboloid::{paraboloid_area, paraboloid_sample};

struct PairStep {
    // Of the scene nodes of the tested pairs: cells along an edge of the root, and the radius of a cell's sphere.
    cells: f32,
    radius: f32,
    // Texels of a hemisphere's side.
    side: f32,
    // Largest apparent size of a node that is rendered, texels.
    threshold: f32,
    // Length of the root's edge, metres.
    edge: f32,
    // Capacity of the queues, pairs.
    capacity: u32,
    // Indices in `counters`: of the queue that is read, and of the queue that is filled.
    counters_in: u32,
    counters_out: u32,
    // Index in `counters` of the overflow flag of this part of the frame.
    overflow: u32,
    // The octant of the view node that this pass descends to; 8: all octants.
    octant: u32,
    // 1: this pass counts the pairs of the step. Of several passes over the same pairs, only the first does.
    counted: u32,
    // Base-2 logarithm of the number of maps in one array.
    map_shift: u32,
    // Pairs are rendered only if the distance of their centres is at least `near` and less than `far`.
    near: f32,
    far: f32,
    // 1: the view nodes of the tested pairs are leaves.
    leaf_views: u32,
    // Owner number of the first view.
    first_owner: u32,
}

var<immediate> step: PairStep;

// Divides the view nodes; otherwise the scene nodes.
override divides_views: bool = false;
// The resulting pairs are pairs of leaves.
override leaves: bool = false;
// Culls scene nodes outside the views' cones.
override culls: bool = true;
// Most texels that a node covers in each direction.
override reach: u32 = 1u;
// Traverses pairs from near to far, and culls pairs that are hidden by nearer texels of the map.
override occludes: bool = false;
// Every view is a node of its own.
override alone: bool = false;
// Culls scene nodes that belong to the view itself. Requires `alone`.
override leaves_out: bool = false;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read> view_bounds: array<vec4f>;
@group(0) @binding(2) var<storage, read> view_links: array<vec4u>;
@group(0) @binding(3) var<storage, read> view_maps: array<vec2u>;
@group(0) @binding(4) var<storage, read> queue: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> next: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> counters: array<atomic<u32>>;
// For each scene node 1 + the number of the view that owns all of it; 0 for none or several.
@group(0) @binding(7) var<storage, read> owners: array<u32>;

// Offsets of a step's counters.
const QUEUED: u32 = 0u;
const TESTED: u32 = 1u;
const CULLED: u32 = 2u;
const RENDERED: u32 = 3u;
const SHARED_LOW: u32 = 4u;
const SHARED_HIGH: u32 = 5u;

struct ViewNode {
    center: vec3f,
    radius: f32,
    axis: vec3f,
    cos_seen: f32,
    mean: vec3f,
    node: u32,
}

fn view_node(index: u32) -> ViewNode {
    let sphere = view_bounds[2u * index];
    let cone = view_bounds[2u * index + 1u];
    let links = view_links[index];
    return ViewNode(sphere.xyz, sphere.w, cone.xyz, cone.w, bitcast<vec3f>(links.xyz), index);
}

// Result of a pair's test.
const CULL: u32 = 0u;
const RENDER: u32 = 1u;
const DIVIDE: u32 = 2u;
const HIDE: u32 = 3u;
// Outside this shell of distances, and rendered with another one.
const LATER: u32 = 4u;

// Whether the view nodes of the tested pairs are leaves, which do not share their maps.
fn leaf_views() -> bool {
    return step.leaf_views != 0u;
}

// Most texels that the test for occlusion reads.
const LOOKED_AT: u32 = 16u;

// Whether a node is hidden: all texels that its descendants may be written to have nearer values. A node is rendered as a
// disc around its mean position, which is inside a sphere of twice the cell's radius.
fn is_hidden(center: vec3f, view: ViewNode) -> bool {
    let d = center - view.mean;
    let nearest = length(d) - step.radius * 1.0001;
    if nearest <= step.radius || step.near == 0.0 {
        return false;
    }
    // Includes rounding and the precision of a texel.
    let least = stored(MapTexel(1.0001 / (nearest * step.edge), 0u)).inverse_range;
    let map = view_maps[view.node].x;
    let side = u32(step.side);
    let one_side = paraboloid_area(d, 2.0 * step.radius, 0u, step.side);
    let other_side = paraboloid_area(d, 2.0 * step.radius, 1u, step.side);
    let texels = one_side.z * one_side.w;
    let all_texels = texels + other_side.z * other_side.w;
    var hidden = all_texels <= LOOKED_AT && nearest > 2.0 * step.radius;
    for (var i = 0u; i < LOOKED_AT; i++) {
        if !hidden || i >= all_texels {
            break;
        }
        let area = select(one_side, other_side, i >= texels);
        let nth = select(i, i - texels, i >= texels);
        let cell = area.xy + vec2u(nth % max(area.z, 1u), nth / max(area.z, 1u));
        let texel = (select(0u, 1u, i >= texels) * side + cell.y) * side + cell.x;
        hidden = load_texel(texel_place(map, step.map_shift, side, texel)).inverse_range > least;
    }
    return hidden;
}

// Tests a pair of a scene node and a view node. It computes no angle: sines and cosines of the sums in the paper's figures 4
// and 6 follow from lengths.
fn test_pair(mean: vec3f, view: ViewNode) -> u32 {
    let center = (floor(mean * step.cells) + 0.5) / step.cells;
    let vs = center - view.center;
    let squared = dot(vs, vs);
    let length_ = sqrt(squared);
    // Components along the cone's axis and perpendicular to it.
    let along = dot(view.axis, vs);
    let away = sqrt(max(squared - along * along, 0.0));
    let sin_seen = sqrt(max(1.0 - view.cos_seen * view.cos_seen, 0.0));
    // Distance from the cone: of a point beside it, from its surface; of a point behind it, from its tip.
    let beside = away * view.cos_seen - along * sin_seen;
    let behind = along * view.cos_seen + away * sin_seen < 0.0;
    let outside = select(beside, length_, behind);
    if culls && beside > 0.0 && outside > (step.radius + view.radius) * 1.00001 + 1e-6 {
        return CULL;
    }
    if occludes {
        // No pair below this one is in the shell. Pairs of nearer shells were rendered before.
        let apart = (step.radius + view.radius) * 1.00001 + 1e-6;
        if length_ - apart >= step.far || length_ + apart < step.near {
            return CULL;
        }
        if (alone || leaf_views()) && is_hidden(center, view) {
            return HIDE;
        }
    }
    // A sphere of radius R at the distance D and the angle α from the map's axis covers side · sin β / (cos α + cos β)
    // texels, where sin β = R / D. D is the distance from the nearest view.
    let nearest = length_ - view.radius;
    let tangent = sqrt(max(nearest * nearest - step.radius * step.radius, 0.0));
    let texels_over = step.threshold * (abs(vs.x) / max(length_, 1e-37) * nearest + tangent);
    return select(DIVIDE, RENDER, nearest > step.radius && step.side * step.radius < texels_over);
}

// Radius of a node's disc relative to its cell's sphere: in a map of one view or leaf, and in a map that others inherit.
override own_disc: f32 = 0.5;
override shared_disc: f32 = 0.4;

// Result of rendering a node.
const DRAWN: u32 = 0u;
// The node is larger than the threshold, and is queued to be filled.
const LARGE: u32 = 1u;
// All texels already had nearer values.
const BEHIND: u32 = 2u;

// Writes a value to a texel, unless a nearer one is there. Returns DRAWN, or else `before`.
fn write_texel(map: u32, texel: u32, value: MapTexel, before: u32) -> u32 {
    let place = texel_place(map, step.map_shift, u32(step.side), texel);
    if occludes && stays(load_texel(place), stored(value)) {
        return before;
    }
    put_texel(place, value);
    return DRAWN;
}

// Renders a node into the texels whose sample points its disc covers, seen from the views' mean position.
fn render(mean: vec3f, node: u32, view: ViewNode) -> u32 {
    let d = mean - view.mean;
    let range = length(d);
    let tangent = sqrt(max(range * range - step.radius * step.radius, 0.0));
    // Centre and radius of the disc in the hemisphere's plane, -1..1.
    let at = d.yz / max(range + abs(d.x), 1e-37);
    let disc = step.radius / max(abs(d.x) + tangent, 1e-37);
    if leaves && !(range > step.radius && disc * step.side <= step.threshold) {
        return LARGE;
    }
    // A node that covers no sample point counts as rendered, with and without occlusion.
    var became = DRAWN;
    let hemisphere = select(0u, 1u, d.x < 0.0);
    let reaches = disc * select(shared_disc, own_disc, alone || leaf_views());
    let map = view_maps[view.node].x;
    let value = MapTexel(1.0 / max(range * step.edge, 1e-37), node);
    let side = u32(step.side);
    if reach == 1u {
        let cell = min(vec2u((at * 0.5 + 0.5) * step.side), vec2u(side - 1u));
        if distance(paraboloid_sample(cell, step.side), at) <= reaches {
            let texel = (hemisphere * side + cell.y) * side + cell.x;
            became = write_texel(map, texel, value, BEHIND);
        }
    } else {
        var covered = false;
        let first = vec2u(max(((at - disc) * 0.5 + 0.5) * step.side, vec2f(0.0)));
        for (var i = 0u; i < (reach + 1u) * (reach + 1u); i++) {
            let cell = first + vec2u(i % (reach + 1u), i / (reach + 1u));
            if all(cell < vec2u(side)) && distance(paraboloid_sample(cell, step.side), at) <= reaches {
                let texel = (hemisphere * side + cell.y) * side + cell.x;
                became = write_texel(map, texel, value, select(BEHIND, became, covered));
                covered = true;
            }
        }
    }
    return became;
}

// Whether a leaf that covers many texels is queued to be filled. Views that see one hemisphere do not see the surface that
// they lie on.
fn fills(mean: vec3f, view: ViewNode) -> bool {
    return view.cos_seen < -0.95 || dot(mean - view.mean, view.axis) >= 0.5 * step.radius;
}

// Divides each pair of the queue, and tests the resulting pairs.
@compute @workgroup_size(64)
fn divide(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let at = linear_index(group, groups, local);
    let count = min(atomicLoad(&counters[step.counters_in + QUEUED]), step.capacity);
    let is_pair = at < count;
    // Lanes beyond the queue's end divide nothing, but take part in the subgroup's sums below.
    let pair = select(vec2u(0u), queue[min(at, step.capacity - 1u)], is_pair);
    var mean = bitcast<vec3f>(nodes[pair.x].xyz);
    var view = view_node(pair.y);
    let links = select(nodes[pair.x].w, view_links[pair.y].w, divides_views);
    let every = countOneBits(links & 255u);
    let followed = links & (1u << step.octant);
    var first = links >> 8u;
    var children = select(0u, every, is_pair);
    if divides_views && step.octant < 8u {
        first += countOneBits(links & ((1u << step.octant) - 1u) & 255u);
        children = select(0u, 1u, is_pair && followed != 0u);
    }
    var kept = 0u;
    var culled = 0u;
    var rendered = 0u;
    var shared_ = 0u;
    for (var i = 0u; i < children; i++) {
        let child = first + i;
        if divides_views {
            view = view_node(child);
        } else {
            mean = bitcast<vec3f>(nodes[child].xyz);
        }
        let scene_node = select(child, pair.x, divides_views);
        var outcome = test_pair(mean, view);
        if leaves_out && owners[scene_node] == step.first_owner + view.node + 1u {
            outcome = CULL;
        }
        if leaves && outcome == DIVIDE {
            outcome = RENDER;
        }
        if occludes && outcome == RENDER {
            let between = distance(floor(mean * step.cells) + 0.5, view.center * step.cells) / step.cells;
            outcome = select(LATER, RENDER, (between >= step.near) & (between < step.far));
        }
        if outcome == RENDER {
            let became = render(mean, scene_node, view);
            if became == BEHIND {
                culled += 1u;
            } else {
                rendered += 1u;
                shared_ += view_maps[view.node].y;
            }
            if became == LARGE && fills(mean, view) {
                kept |= 1u << i;
            }
        } else if outcome == DIVIDE {
            kept |= 1u << i;
        } else if outcome != LATER {
            culled += 1u;
        }
    }
    let queued = countOneBits(kept);
    let before = subgroupExclusiveAdd(queued);
    let all_queued = subgroupAdd(queued);
    let tested = subgroupAdd(children);
    let all_culled = subgroupAdd(culled);
    let all_rendered = subgroupAdd(rendered);
    let all_shared = subgroupAdd(shared_);
    var base = 0u;
    if lane == 0u {
        base = atomicAdd(&counters[step.counters_out + QUEUED], all_queued);
        if step.counted != 0u {
            atomicAdd(&counters[step.counters_out + TESTED], tested);
            atomicAdd(&counters[step.counters_out + CULLED], all_culled);
            atomicAdd(&counters[step.counters_out + RENDERED], all_rendered);
            let low = atomicAdd(&counters[step.counters_out + SHARED_LOW], all_shared);
            if low + all_shared < low {
                atomicAdd(&counters[step.counters_out + SHARED_HIGH], 1u);
            }
        }
    }
    base = subgroupBroadcastFirst(base) + before;
    if queued > 0u && base + queued > step.capacity {
        atomicMax(&counters[step.overflow], 1u);
        kept = 0u;
    }
    var to = base;
    while kept != 0u {
        let child = first + countTrailingZeros(kept);
        next[to] = select(vec2u(child, pair.y), vec2u(pair.x, child), divides_views);
        to += 1u;
        kept &= kept - 1u;
    }
}

// Program of gpu/src/many_views/traverse.rs: one step of the traversal of scene and views together (MegaViews, section
// 3.2): each pair of the queue is divided, and each pair that comes of it is culled, rendered or queued.
//
// Every leaf of either octree is on its lowest level, so that all pairs of a queue are on the same two levels, and
// which of the two is divided is known beforehand. Coordinates are in edges of the scene's root cube.

import package::shared::linear::linear_index;
import package::shared::map_texels::{MapTexel, load_texel, put_texel, stays, stored, texel_place};
import package::shared::paraboloid::{paraboloid_area, paraboloid_sample};

struct PairStep {
    // Of the pairs that are tested: cells along an edge of the scene's root, and the radius of a cell's sphere.
    cells: f32,
    radius: f32,
    // Texels of a hemisphere's side.
    side: f32,
    // How large a node may appear and still be rendered whole, texels.
    threshold: f32,
    // Length of the root's edge, metres.
    edge: f32,
    // Pairs that the queues hold.
    capacity: u32,
    // Entries of `counters` for this step's queue and the one that it fills.
    counters_in: u32,
    counters_out: u32,
    // Entry that says whether a queue of this part of the frame overflowed.
    overflow: u32,
    // The only octant of the view node that this pass follows; 8: all.
    octant: u32,
    // 1: the pairs of this step are counted (by the first of the passes that share them).
    counted: u32,
    // Maps of one of the arrays: 2 to the power of this.
    map_shift: u32,
    // Only pairs whose centers are that far apart are rendered: from the first on, before the second.
    near: f32,
    far: f32,
    // 1: the view nodes of the pairs tested are leaves.
    leaf_views: u32,
    // The owner of what belongs to the first view.
    first_owner: u32,
}

var<immediate> step: PairStep;

// Whether the view nodes are divided rather than the scene's.
override divides_views: bool = false;
// Whether what comes of it are pairs of leaves.
override leaves: bool = false;
// Whether what no view sees is culled.
override culls: bool = true;
// Texels that a node may cover in each direction.
override reach: u32 = 1u;
// Whether pairs are met from near to far, and left out behind what a map already holds.
override occludes: bool = false;
// Whether every view is a node of its own.
override alone: bool = false;
// Whether a view sees nothing of what is its own; every view is then a node of its own.
override leaves_out: bool = false;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read> view_bounds: array<vec4f>;
@group(0) @binding(2) var<storage, read> view_links: array<vec4u>;
@group(0) @binding(3) var<storage, read> view_maps: array<vec2u>;
@group(0) @binding(4) var<storage, read> queue: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> next: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> counters: array<atomic<u32>>;
// For each node 1 + the index of the view that everything in it belongs to; 0 for none or several.
@group(0) @binding(7) var<storage, read> owners: array<u32>;

// Entries of a step in `counters`.
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

// What becomes of a pair.
const CULL: u32 = 0u;
const RENDER: u32 = 1u;
const DIVIDE: u32 = 2u;
const HIDE: u32 = 3u;
// It belongs to the next shell, not to this one.
const LATER: u32 = 4u;

// Whether the pairs of this step have leaves of the view octree, whose maps are theirs alone.
fn leaf_views() -> bool {
    return step.leaf_views != 0u;
}

// Texels that are looked at to tell whether a node is hidden, at most.
const LOOKED_AT: u32 = 16u;

// Whether every texel that anything below a node may be written to holds what is nearer than all of it. What is rendered
// of a node is its mean position, in a disc about that: both lie within twice the ball of its cell.
fn is_hidden(center: vec3f, view: ViewNode) -> bool {
    let d = center - view.mean;
    let nearest = length(d) - step.radius * 1.0001;
    if nearest <= step.radius || step.near == 0.0 {
        return false;
    }
    // Nearer by more than rounding, and by more than a texel leaves away.
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

// The verdict on a node of the scene and a node of views. Without a single angle: sines and cosines of the sums that
// the paper's figures 4 and 6 compare follow from lengths.
fn verdict(mean: vec3f, view: ViewNode) -> u32 {
    let center = (floor(mean * step.cells) + 0.5) / step.cells;
    let vs = center - view.center;
    let squared = dot(vs, vs);
    let length_ = sqrt(squared);
    // Along the cone's axis and away from it.
    let along = dot(view.axis, vs);
    let away = sqrt(max(squared - along * along, 0.0));
    let sin_seen = sqrt(max(1.0 - view.cos_seen * view.cos_seen, 0.0));
    // The distance from the cone: of a point beside it, from its surface; of one behind, from its tip.
    let beside = away * view.cos_seen - along * sin_seen;
    let behind = along * view.cos_seen + away * sin_seen < 0.0;
    let outside = select(beside, length_, behind);
    if culls && beside > 0.0 && outside > (step.radius + view.radius) * 1.00001 + 1e-6 {
        return CULL;
    }
    if occludes {
        // Nothing below the pair lies in this shell; what lies in a nearer one was met before.
        let apart = (step.radius + view.radius) * 1.00001 + 1e-6;
        if length_ - apart >= step.far || length_ + apart < step.near {
            return CULL;
        }
        if (alone || leaf_views()) && is_hidden(center, view) {
            return HIDE;
        }
    }
    // A ball of radius R at the distance D and the angle α from the map's axis covers side · sin β / (cos α + cos β)
    // texels, sin β = R / D; D is that from the nearest of the views.
    let nearest = length_ - view.radius;
    let tangent = sqrt(max(nearest * nearest - step.radius * step.radius, 0.0));
    let texels_over = step.threshold * (abs(vs.x) / max(length_, 1e-37) * nearest + tangent);
    return select(DIVIDE, RENDER, nearest > step.radius && step.side * step.radius < texels_over);
}

// A node's disc in radii of its cell's sphere: in a map of one view or leaf of views, and in one that several continue.
override own_disc: f32 = 0.5;
override shared_disc: f32 = 0.4;

// What becomes of a node that is rendered.
const DRAWN: u32 = 0u;
// Its cell's sphere is larger than the threshold.
const LARGE: u32 = 1u;
// Nothing of it is nearer than what is there.
const BEHIND: u32 = 2u;

// Leaves a value in a texel; what then becomes of the node.
fn leave(map: u32, texel: u32, value: MapTexel, before: u32) -> u32 {
    let place = texel_place(map, step.map_shift, u32(step.side), texel);
    if occludes && stays(load_texel(place), stored(value)) {
        return before;
    }
    put_texel(place, value);
    return DRAWN;
}

// Leaves a node in the texels whose sample points its disc covers, as seen from the views' mean position.
fn render(mean: vec3f, node: u32, view: ViewNode) -> u32 {
    let d = mean - view.mean;
    let range = length(d);
    let tangent = sqrt(max(range * range - step.radius * step.radius, 0.0));
    // In the hemisphere's plane, -1..1.
    let at = d.yz / max(range + abs(d.x), 1e-37);
    let disc = step.radius / max(abs(d.x) + tangent, 1e-37);
    if leaves && !(range > step.radius && disc * step.side <= step.threshold) {
        return LARGE;
    }
    // What covers no sample point is behind none, and counts as rendered with and without occlusion.
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
            became = leave(map, texel, value, BEHIND);
        }
    } else {
        var covered = false;
        let first = vec2u(max(((at - disc) * 0.5 + 0.5) * step.side, vec2f(0.0)));
        for (var i = 0u; i < (reach + 1u) * (reach + 1u); i++) {
            let cell = first + vec2u(i % (reach + 1u), i / (reach + 1u));
            if all(cell < vec2u(side)) && distance(paraboloid_sample(cell, step.side), at) <= reaches {
                let texel = (hemisphere * side + cell.y) * side + cell.x;
                became = leave(map, texel, value, select(BEHIND, became, covered));
                covered = true;
            }
        }
    }
    return became;
}

// A leaf so near that it covers many texels is kept for them, unless it is part of the surface that the views of a
// hemisphere lie on.
fn fills(mean: vec3f, view: ViewNode) -> bool {
    return view.cos_seen < -0.95 || dot(mean - view.mean, view.axis) >= 0.5 * step.radius;
}

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
    // Beyond the queue's end nothing is done, but the subgroup's sums below need every lane.
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
        var outcome = verdict(mean, view);
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

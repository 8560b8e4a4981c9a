// Program of `papers/virtual-lights/src/passes/cull_vpls.rs`: culls groups of VPLs that cannot light a block of sub-samples.
// Conservative: a group is culled only if its VPLs face none of the block's surfaces, or these face none of the VPLs, or
// all are beyond the cut-off (MegaViews, sections 3.2.1 and 5.1, with scene and views exchanged). Of the remaining
// groups, some are drawn at random if the settings say so.

import package::shared::receiver::{Receiver, receiver_of};
import package::virtual_lights::shared::vpl::{BLOCK, GROUP_WORDS, Gathering, LIST_HEAD, LIST_WORDS, MOST_GROUPS, VplNode};

@group(0) @binding(0) var<uniform> gathering: Gathering;
@group(0) @binding(1) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(2) var<storage, read> nodes: array<VplNode>;
@group(0) @binding(3) var<storage, read_write> lists: array<u32>;
// Number of blocks with surfaces, and of groups that they keep.
@group(0) @binding(4) var<storage, read_write> kept: array<atomic<u32>, 2>;

// Bounding sphere of a block's surfaces, relative to the root, and cone of their normals.
struct Receivers {
    center: vec3f,
    radius: f32,
    axis: vec3f,
    cosine: f32,
}

fn receiver_at(corner: vec2u, i: u32) -> Receiver {
    let at = corner + vec2u(i % BLOCK, i / BLOCK);
    let inside = all(at < gathering.size);
    let clamped = min(at, gathering.size - 1u);
    var receiver = receiver_of(g_surfaces[clamped.y * gathering.size.x + clamped.x]);
    receiver.exists = receiver.exists & inside;
    return receiver;
}

// Distance of a point at `d` from the tip outside a cone about `axis`, widened by a right angle; not positive inside.
fn outside(d: vec3f, axis: vec3f, cosine: f32) -> f32 {
    let t = dot(axis, d);
    let q = sqrt(max(dot(d, d) - t * t, 0.0));
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    return -q * sine - t * cosine;
}

fn is_dark(node: VplNode, receivers: Receivers) -> bool {
    let d = receivers.center - node.center;
    // Slack for f32 rounding far from the root.
    let slack = 1e-5 * (length(receivers.center) + length(node.center) + node.radius + receivers.radius);
    let reach = node.radius + receivers.radius + slack;
    // A half angle of 90° or more covers all directions once widened.
    let unlit = node.cosine > 0.0 && outside(d, node.axis, node.cosine) > reach;
    let unseen = receivers.cosine > 0.0 && outside(-d, receivers.axis, receivers.cosine) > reach;
    return unlit || unseen || length(d) - reach > gathering.cutoff;
}

// Estimated light of a group for a block. Never 0, because its VPLs may be drawn. Cosines are those between the centres,
// widened by the cones and by the apparent sizes.
fn worth(node: VplNode, receivers: Receivers) -> f32 {
    let d = receivers.center - node.center;
    let distance = max(length(d), 1e-20);
    let size = node.radius + receivers.radius;
    let wider = size / distance;
    let leaving = dot(node.axis, d) / distance + sqrt(max(1.0 - node.cosine * node.cosine, 0.0)) + wider;
    let arriving =
        -dot(receivers.axis, d) / distance + sqrt(max(1.0 - receivers.cosine * receivers.cosine, 0.0)) + wider;
    let cosines = select(clamp(leaving, 0.05, 1.0), 1.0, node.cosine <= 0.0)
        * select(clamp(arriving, 0.05, 1.0), 1.0, receivers.cosine <= 0.0);
    let nearest = max(gathering.least_distance, 0.5 * size);
    return max(node.power * cosines / max(distance * distance, nearest * nearest), 1e-30);
}

// Draws some of a block's groups by systematic sampling of their weights (after Tokuyoshi, Harada: "Stochastic Light
// Culling", 2016). A group of weight of at least one step is always kept. One of 1/n step is kept in one of n blocks,
// with n times its weight, so the estimate is unbiased. Neighbouring blocks start at different offsets (plastic number
// sequence). Returns the number of groups kept.
fn draw(list: u32, block: vec2u) -> u32 {
    let step = bitcast<f32>(lists[list + 2u]) / f32(gathering.kept_groups);
    let begin = fract(f32(block.x) * 0.7548776662 + f32(block.y) * 0.5698402910);
    let groups = lists[list];
    var drawn = 0u;
    var lights = 0u;
    var sum_of_worth = 0.0;
    var lights_before = 0u;
    var worth_before = 0.0;
    for (var i = 0u; i < MOST_GROUPS; i++) {
        if i >= groups {
            break;
        }
        let entry = list + LIST_HEAD + GROUP_WORDS * i;
        let first = lists[entry];
        let lights_here = lists[entry + 1u];
        let worth_here = bitcast<f32>(lists[entry + 2u]);
        if floor(worth_here / step + begin) > floor(worth_before / step + begin) {
            let own = max(worth_here - worth_before, 1e-37);
            lights += lights_here - lights_before;
            sum_of_worth += max(own, step);
            let kept_entry = list + LIST_HEAD + GROUP_WORDS * drawn;
            lists[kept_entry] = first;
            lists[kept_entry + 1u] = lights;
            lists[kept_entry + 2u] = bitcast<u32>(sum_of_worth);
            lists[kept_entry + 3u] = bitcast<u32>(max(step / own, 1.0));
            drawn += 1u;
        }
        lights_before = lights_here;
        worth_before = worth_here;
    }
    lists[list] = drawn;
    lists[list + 1u] = lights;
    lists[list + 2u] = bitcast<u32>(sum_of_worth);
    return drawn;
}

@compute @workgroup_size(64)
fn cull_vpls(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= gathering.blocks.x * gathering.blocks.y {
        return;
    }
    let corner = vec2u(id.x % gathering.blocks.x, id.x / gathering.blocks.x) * BLOCK;
    var low = vec3f(3e38);
    var high = vec3f(-3e38);
    var sum = vec3f(0.0);
    for (var i = 0u; i < BLOCK * BLOCK; i++) {
        let receiver = receiver_at(corner, i);
        low = select(low, min(low, receiver.position), receiver.exists);
        high = select(high, max(high, receiver.position), receiver.exists);
        sum += select(vec3f(0.0), receiver.normal, receiver.exists);
    }
    let list = id.x * LIST_WORDS;
    lists[list] = 0u;
    lists[list + 1u] = 0u;
    lists[list + 2u] = 0u;
    if low.x > high.x {
        return;
    }
    let length_of_sum = length(sum);
    let axis = sum / max(length_of_sum, 1e-20);
    var receivers = Receivers((low + high) * 0.5 + gathering.root_from_eye, length(high - low) * 0.5, axis, 1.0);
    for (var i = 0u; i < BLOCK * BLOCK; i++) {
        let receiver = receiver_at(corner, i);
        receivers.cosine = select(receivers.cosine, min(receivers.cosine, dot(axis, receiver.normal)), receiver.exists);
    }
    // Slack for unpacking and summing. Normals that cancel out have no axis.
    receivers.cosine = select(-1.0, receivers.cosine - 1e-4, length_of_sum > 1e-3);
    var groups = 0u;
    var lights = 0u;
    var sum_of_worth = 0.0;
    var index = 0u;
    loop {
        let node = nodes[min(index, arrayLength(&nodes) - 1u)];
        let dark = (gathering.culls != 0u) & is_dark(node, receivers);
        if !dark && node.leaf != 0u && groups < MOST_GROUPS {
            lights += node.count;
            let weighed = worth(node, receivers);
            sum_of_worth += select(f32(node.count), weighed, gathering.weighs != 0u);
            let entry = list + LIST_HEAD + GROUP_WORDS * groups;
            lists[entry] = node.first;
            lists[entry + 1u] = lights;
            lists[entry + 2u] = bitcast<u32>(sum_of_worth);
            lists[entry + 3u] = bitcast<u32>(1.0);
            groups += 1u;
        }
        index = select(index + 1u, node.skip, dark);
        if index >= arrayLength(&nodes) {
            break;
        }
    }
    lists[list] = groups;
    lists[list + 1u] = lights;
    lists[list + 2u] = bitcast<u32>(sum_of_worth);
    if gathering.kept_groups > 0u && groups > gathering.kept_groups {
        groups = draw(list, gathering.origin / BLOCK + corner / BLOCK);
    }
    atomicAdd(&kept[0], 1u);
    atomicAdd(&kept[1], groups);
}

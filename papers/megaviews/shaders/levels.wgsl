// Program of papers/megaviews/src/hierarchy/levels.rs: makes the nodes of an octree from sorted Morton codes, level by level upwards.
//
// The nodes of all levels are in one array, the leaves first and the root last. The children of a node are adjacent.

import package::shared::linear::linear_index;

struct LevelStep {
    // Number of sorted elements; not used by passes over nodes.
    count: u32,
    // The level that is made; its children are on the next one.
    level: u32,
    // Levels below the root.
    depth: u32,
}

var<immediate> step: LevelStep;

// Sorted elements: element, Morton code of its leaf.
@group(0) @binding(0) var<storage, read> sorted: array<vec2u>;
// 1 at the first element of each leaf or node, else 0. After a scan: index of the leaf or node.
@group(0) @binding(1) var<storage, read_write> heads: array<u32>;
@group(0) @binding(2) var<storage, read> total: array<u32>;
// Index in `sorted` of each leaf's first element; after the last leaf, the number of elements.
@group(0) @binding(3) var<storage, read_write> starts: array<u32>;
@group(0) @binding(4) var<storage, read_write> codes: array<u32>;
// First node and number of nodes of each level.
@group(0) @binding(5) var<storage, read_write> levels: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> histogram: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read_write> first_children: array<u32>;

fn index_of(group: vec3u, groups: vec3u, local: u32) -> u32 {
    return linear_index(group, groups, local);
}

// Marks the first element of each leaf.
@compute @workgroup_size(64)
fn leaf_heads(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = index_of(group, groups, local);
    if at < step.count {
        heads[at] = select(0u, 1u, at == 0u || sorted[at].y != sorted[max(at, 1u) - 1u].y);
    }
}

// Writes the start and code of each leaf, and counts the nodes that begin on each level.
@compute @workgroup_size(64)
fn leaf_starts(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = index_of(group, groups, local);
    if at >= step.count {
        return;
    }
    let code = sorted[at].y;
    let before = sorted[max(at, 1u) - 1u].y;
    if at == 0u || code != before {
        let leaf = heads[at];
        starts[leaf] = at;
        codes[leaf] = code;
        // The highest level on which this leaf and the previous one have different ancestors.
        let differs = step.depth - firstLeadingBit(max(code ^ before, 1u)) / 3u;
        atomicAdd(&histogram[select(differs, 0u, at == 0u)], 1u);
    }
    if at == 0u {
        starts[total[0]] = step.count;
    }
}

// Sums the counts to the first node and number of nodes of each level.
@compute @workgroup_size(1)
fn level_ranges() {
    var nodes = 0u;
    for (var level = 0u; level <= 10u; level++) {
        nodes += atomicLoad(&histogram[level]);
        levels[level].y = nodes;
    }
    var first = 0u;
    for (var up = 0u; up <= 10u; up++) {
        let level = 10u - up;
        let used = level <= step.depth;
        levels[level].x = first;
        first += select(0u, levels[level].y, used);
    }
}

// Marks the first child of each node.
@compute @workgroup_size(64)
fn node_heads(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = index_of(group, groups, local);
    let children = levels[step.level + 1u];
    if at >= children.y {
        return;
    }
    let code = codes[children.x + at] >> 3u;
    let before = codes[children.x + max(at, 1u) - 1u] >> 3u;
    heads[at] = select(0u, 1u, at == 0u || code != before);
}

// Writes the code and first child of each node.
@compute @workgroup_size(64)
fn node_links(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = index_of(group, groups, local);
    let children = levels[step.level + 1u];
    if at >= children.y {
        return;
    }
    let code = codes[children.x + at] >> 3u;
    if at == 0u || code != codes[children.x + max(at, 1u) - 1u] >> 3u {
        let node = levels[step.level].x + heads[at];
        codes[node] = code;
        first_children[node] = children.x + at;
    }
}

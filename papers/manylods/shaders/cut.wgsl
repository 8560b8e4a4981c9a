// Program of papers/manylods/src/passes.rs: finds a cut through a sphere tree for every view (ManyLoDs, section 3),
// from the root or from the last frame's cut.
//
// Cuts are kept in chunks of 64 entries. Each chunk has a due time on a clock of motion: its entries stay valid until views
// and spheres have moved that far. Chunks that are not due are not read. The entries of due chunks are tested again and
// sorted into new chunks by their slack: the motion until the next test.

import package::megaviews::shared::cone::{direction_of, widened};
import package::manylods::shared::cut::{Course, EYE_WORDS, Eye, VIEW_BITS, VIEW_MASK, cut_margin, cut_slack, eye_from};
import package::shared::linear::linear_index;

struct CutStep {
    // Number of views.
    views: u32,
    // Index of the tree's root.
    root: u32,
    // Texels of a hemisphere's side, divided by the threshold.
    scale: f32,
    // Motion of a view, edges of the root, beyond which its cut restarts from the root.
    jump: f32,
    // Capacity of the queues and of the cuts, entries.
    capacity: u32,
    // Number of chunks.
    chunks: u32,
    // Indices in `counters`: of the queue that is read, and of the queue that is filled.
    queue_in: u32,
    queue_out: u32,
    // Index in `arguments` of the numbers of workgroups.
    arguments: u32,
    // Lazy cuts: units of motion by which chunks may be overdue while views move.
    lag: u32,
    // 1: the cuts of all views restart from the root.
    restart: u32,
    // 0: this step divides only nodes of views that restarted in this frame.
    deep: u32,
}

var<immediate> step: CutStep;

// Culls nodes outside a view's cone.
override culls: bool = true;
// Sorts entries into chunks by slack. Otherwise entries are stored one after another.
override ordered: bool = true;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read> spheres: array<vec4f>;
@group(0) @binding(2) var<storage, read> parents: array<u32>;
// Two vectors per view: position and half the field of view; direction.
@group(0) @binding(3) var<storage, read> views: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> eyes: array<vec4f>;
// Nodes to divide: node and FRESH; view and generation.
@group(0) @binding(5) var<storage, read> queue: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> next: array<vec2u>;
// Entries that are part of a cut, not sorted yet.
@group(0) @binding(7) var<storage, read_write> settled: array<vec2u>;
// Destination of each settled entry: its bin, then its number within the bin in the lower 25 bits.
@group(0) @binding(8) var<storage, read_write> slots: array<u32>;
@group(0) @binding(9) var<storage, read_write> entries: array<vec2u>;
// Due time and number of entries of each chunk.
@group(0) @binding(10) var<storage, read_write> chunks: array<vec2u>;
// Stack of empty chunks.
@group(0) @binding(11) var<storage, read_write> free: array<u32>;
// Due chunks and their numbers of entries.
@group(0) @binding(12) var<storage, read_write> due: array<vec2u>;
// Counters of this frame.
@group(0) @binding(13) var<storage, read_write> counters: array<atomic<u32>>;
@group(0) @binding(14) var<storage, read_write> arguments: array<u32>;
// Accumulated motion and growth of the tree's spheres, units of motion.
@group(0) @binding(15) var<storage, read> moved: array<u32>;
// State that is kept from frame to frame.
@group(0) @binding(16) var<storage, read_write> state: array<atomic<u32>>;

// `counters`: words of papers/manylods/src/counters.rs.
const OVERFLOW: u32 = 0u;
const MOTION: u32 = 1u;
const VISITS: u32 = 2u;
const SPLITS: u32 = 3u;
const MERGES: u32 = 4u;
const SETTLED: u32 = 5u;
const DUE: u32 = 6u;
const STARTED: u32 = 7u;
const WRAPPED: u32 = 8u;
const FREE_BASE: u32 = 9u;
const TURNING: u32 = 10u;
const BINS: u32 = 16u;
const BIN_COUNT: u32 = 128u;
// First chunk of each bin among the chunks that this frame takes from `free`.
const BASES: u32 = 144u;

// `state`
const CLOCK: u32 = 0u;
const SEEN_SHIFT: u32 = 1u;
const SEEN_GROWTH: u32 = 2u;
const FREE: u32 = 3u;
// 1 + the index of the last chunk that was ever used.
const HIGH: u32 = 4u;
const LATEST: u32 = 5u;
// Largest curvature of the views' courses, radians per edge of the root, f32.
const BEND: u32 = 6u;
// Number of frames without a sharper turn.
const STEADY: u32 = 7u;
// 1: due times may follow the views' courses.
const PREDICTS: u32 = 8u;
// 1: some due times follow courses.
const PREDICTED: u32 = 9u;
// 1: all chunks are due, because a view left its course.
const ALL_DUE: u32 = 10u;

// Units of motion in an edge of the root: 2^22.
const UNITS: f32 = 4194304.0;
// Base-2 logarithm of the least slack, in units, that is told from none.
const LEAST_OCTAVE: u32 = 6u;
// Bin of entries that are tested again in the next frame, whatever the motion.
const UNSETTLED: u32 = 127u;
const NEVER: f32 = 8.0;
// Largest curvature, radians per edge, that raises BEND. Sharper turns are treated as exceptions.
const SHARPEST: f32 = 200.0;
// Least value of BEND: the rounding of f32 makes straight courses appear curved.
const STRAIGHTEST: f32 = 2.0;
// Frames without a sharper turn before due times follow courses.
const STEADY_FRAMES: u32 = 2u;
// Flag of a node in the queue: its view restarted in this frame, and is divided down to its cut in this frame.
const FRESH: u32 = 0x80000000u;

fn eye_of(view: u32) -> Eye {
    return eye_from(eyes[EYE_WORDS * view], eyes[EYE_WORDS * view + 1u]);
}

fn course_of(view: u32) -> Course {
    let direction = eyes[EYE_WORDS * view + 2u].xyz;
    let known = atomicLoad(&state[PREDICTS]) != 0u && any(direction != vec3f(0.0));
    return Course(direction, bitcast<f32>(atomicLoad(&state[BEND])), select(0u, 1u, known));
}

// Motion of the view before this node of a cut must be tested again. The slack of its parent limits an entry, too.
fn node_slack(node: u32, eye: Eye, course: Course) -> f32 {
    if is_leaf(node) {
        return NEVER;
    }
    return cut_slack(spheres[node], eye, course, step.scale, culls, true);
}

fn parent_slack(parent: u32, eye: Eye, course: Course) -> f32 {
    return cut_slack(spheres[parent], eye, course, step.scale, culls, false);
}

fn margin_of(node: u32, eye: Eye) -> f32 {
    return cut_margin(spheres[node], eye, step.scale, culls);
}

fn is_leaf(node: u32) -> bool {
    return (nodes[node].w & 255u) == 0u;
}

// The bin of a slack. An octave has eight bins, so rounding down loses at most an eighth of the slack.
fn bin_of(slack: f32) -> u32 {
    let units = u32(clamp(slack * UNITS, 0.0, 4294967040.0));
    if units < (1u << LEAST_OCTAVE) {
        return 0u;
    }
    let octave = 31u - countLeadingZeros(units);
    let eighth = (units >> (octave - 3u)) & 7u;
    return min(1u + (octave - LEAST_OCTAVE) * 8u + eighth, UNSETTLED - 1u);
}

// Least slack of the entries of a bin, units.
fn slack_of(bin: u32) -> u32 {
    let octave = (bin - 1u) / 8u + LEAST_OCTAVE;
    let eighth = (bin - 1u) % 8u;
    return select((8u + eighth) << (octave - 3u), 1u, bin == 0u);
}

// Writes an entry of a cut at its reserved index. `bin` is used only if entries are sorted.
fn settle(at: u32, node: u32, tagged: u32, bin: u32) {
    if at >= step.capacity {
        atomicMax(&counters[OVERFLOW], 1u);
        return;
    }
    if ordered {
        let number = atomicAdd(&counters[BINS + bin], 1u);
        settled[at] = vec2u(node, tagged);
        slots[at] = (bin << 25u) | (number & 0x1ffffffu);
    } else {
        entries[at] = vec2u(node, tagged);
    }
}

fn enqueue(at: u32, node: u32, tagged: u32) {
    if at >= step.capacity {
        atomicMax(&counters[OVERFLOW], 1u);
    } else {
        next[at] = vec2u(node, tagged);
    }
}

fn groups_for(count: u32) {
    let across = min(count, 32768u);
    arguments[step.arguments] = across;
    arguments[step.arguments + 1u] = (count + max(across, 1u) - 1u) / max(across, 1u);
    arguments[step.arguments + 2u] = 1u;
}

// Pushes all chunks onto the stack of free chunks, the first on top.
@compute @workgroup_size(64)
fn reset_chunks(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.chunks {
        chunks[at] = vec2u(0u);
        free[at] = step.chunks - 1u - at;
    }
    if at == 0u {
        atomicStore(&state[FREE], step.chunks);
        atomicStore(&state[HIGH], 0u);
        // Lag is subtracted from due times, which must not go below zero.
        atomicStore(&state[CLOCK], 1u << 23u);
        atomicStore(&state[SEEN_SHIFT], moved[0]);
        atomicStore(&state[SEEN_GROWTH], moved[1]);
        atomicStore(&state[BEND], 0u);
        atomicStore(&state[STEADY], 0u);
        atomicStore(&state[PREDICTS], 0u);
        atomicStore(&state[PREDICTED], 0u);
    }
}

// Updates the views and measures their motion. Views that moved far, or whose field of view changed, restart.
@compute @workgroup_size(64)
fn move_views(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let view = linear_index(group, groups, local);
    if view >= step.views {
        return;
    }
    let position = views[2u * view].xyz;
    let all = views[2u * view].w >= 3.1415926;
    let axis = select(direction_of(views[2u * view + 1u].xyz), vec3f(1.0, 0.0, 0.0), all);
    let cos_seen = select(widened(cos(min(views[2u * view].w, 3.1415927))), -1.0, all);
    var generation = 0u;
    var course = vec3f(0.0);
    var starts = step.restart != 0u;
    if !starts {
        let before = eye_of(view);
        generation = before.generation;
        // A turn moves visible points in proportion to their distance.
        let reach = distance(position, vec3f(0.5)) + 0.9;
        let way = position - before.position;
        let ahead = length(way);
        let turn = distance(axis, before.axis) * reach;
        let motion = ahead + turn;
        starts = motion > step.jump || cos_seen != before.cos_seen;
        if starts {
            generation = (generation + 1u) & 255u;
            if generation == 0u {
                // Entries of the earlier generation of this number may still exist.
                atomicMax(&counters[WRAPPED], 1u);
            }
        } else {
            atomicMax(&counters[MOTION], bitcast<u32>(motion));
            let last_course = eyes[EYE_WORDS * view + 2u].xyz;
            course = select(last_course, way / max(ahead, 1e-37), ahead > 0.0);
            // An arc is at most 5% longer than its chord, for chords up to 1.
            let chord = distance(course, last_course);
            let arc = select(4.0, chord * 1.05, chord <= 1.0) / max(ahead, 1e-37);
            let turned = any(last_course != vec3f(0.0)) && chord > 0.0;
            // The course of a view that turns on the spot does not predict what it sees.
            let turning = select(select(0.0, arc, turned), 1e30, turn > 1e-4 * ahead);
            atomicMax(&counters[TURNING], bitcast<u32>(turning));
        }
    }
    eyes[EYE_WORDS * view] = vec4f(position, bitcast<f32>(generation));
    eyes[EYE_WORDS * view + 1u] = vec4f(axis, cos_seen);
    eyes[EYE_WORDS * view + 2u] = vec4f(course, 0.0);
    if starts {
        atomicAdd(&counters[STARTED], 1u);
        atomicAdd(&counters[VISITS], 1u);
        let eye = Eye(position, generation, axis, cos_seen);
        let tagged = view | (generation << VIEW_BITS);
        if margin_of(step.root, eye) > 0.0 {
            let nowhere = Course(course, 0.0, 0u);
            let bin = bin_of(cut_slack(spheres[step.root], eye, nowhere, step.scale, culls, true));
            settle(atomicAdd(&counters[SETTLED], 1u), step.root, tagged, bin);
        } else {
            enqueue(atomicAdd(&counters[step.queue_out], 1u), step.root | FRESH, tagged);
        }
    }
}

// Advances the clock by the largest motion of any view and sphere.
@compute @workgroup_size(1)
fn tick() {
    let shift = moved[0] - atomicLoad(&state[SEEN_SHIFT]);
    let growth = moved[1] - atomicLoad(&state[SEEN_GROWTH]);
    atomicStore(&state[SEEN_SHIFT], moved[0]);
    atomicStore(&state[SEEN_GROWTH], moved[1]);
    let motion = bitcast<f32>(atomicLoad(&counters[MOTION]));
    let of_views = select(0u, u32(ceil(motion * 1.00001 * UNITS)) + 1u, motion > 0.0);
    // A margin changes by at most scale / 2 + 1 times the change of a radius.
    let of_spheres = f32(shift) + f32(growth) * (0.5 * step.scale + 1.0);
    let ticks = of_views + u32(min(ceil(of_spheres * 1.00001), 16777216.0));
    atomicAdd(&state[CLOCK], ticks);
    atomicStore(&state[LATEST], ticks);
    // Due times follow courses after some steady frames, until a view leaves its course. Then all chunks are due once.
    let turning = bitcast<f32>(atomicLoad(&counters[TURNING]));
    let bend = max(bitcast<f32>(atomicLoad(&state[BEND])), STRAIGHTEST);
    let strays = turning > bend || of_spheres > 0.0;
    let predicted = atomicLoad(&state[PREDICTED]);
    atomicStore(&state[ALL_DUE], select(0u, predicted, strays));
    if strays {
        let wider = select(bend, max(bend, 1.15 * turning), turning < SHARPEST);
        atomicStore(&state[BEND], bitcast<u32>(wider));
        atomicStore(&state[STEADY], 0u);
        atomicStore(&state[PREDICTS], 0u);
        atomicStore(&state[PREDICTED], 0u);
    } else if ticks > 0u {
        atomicStore(&state[BEND], bitcast<u32>(max(max(0.9 * bend, 1.15 * turning), STRAIGHTEST)));
        let steady = atomicAdd(&state[STEADY], 1u) + 1u;
        if steady >= STEADY_FRAMES {
            atomicStore(&state[PREDICTS], 1u);
            atomicStore(&state[PREDICTED], 1u);
        }
    }
    groups_for((atomicLoad(&state[HIGH]) + 63u) / 64u);
}

// Finds due chunks and pushes them onto the stack of free chunks. Their entries stay intact until `place`.
@compute @workgroup_size(64)
fn find_due(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= atomicLoad(&state[HIGH]) {
        return;
    }
    let chunk = chunks[at];
    let lag = select(0u, step.lag, atomicLoad(&state[LATEST]) > 0u);
    let is_due = chunk.x + lag <= atomicLoad(&state[CLOCK]) || atomicLoad(&state[ALL_DUE]) != 0u;
    if chunk.y > 0u && is_due {
        due[atomicAdd(&counters[DUE], 1u)] = vec2u(at, chunk.y);
        chunks[at].y = 0u;
        free[atomicAdd(&state[FREE], 1u)] = at;
    }
}

// Sets one workgroup of `visit` for each due chunk.
@compute @workgroup_size(1)
fn prepare_visits() {
    groups_for(atomicLoad(&counters[DUE]));
}

// Sets the workgroups of `split`. After an overflow there are none, since the frame is run again.
@compute @workgroup_size(1)
fn prepare() {
    let overflowed = atomicLoad(&counters[OVERFLOW]) != 0u;
    let count = select(atomicLoad(&counters[step.queue_in]), 0u, overflowed);
    groups_for((count + 63u) / 64u);
}

// Tests an entry again. It stays, is queued to be divided, or is replaced by its highest ancestor that is fine enough.
// Only first children are replaced by their parent; the other children are dropped. All descendants of that ancestor are
// tested in the same frame, since the slack of each is limited by its parent's.
@compute @workgroup_size(64)
fn visit(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let nth = group.y * groups.x + group.x;
    let chunk = due[min(nth, step.chunks - 1u)];
    let exists = nth < atomicLoad(&counters[DUE]) && local < chunk.y;
    let entry = entries[min(chunk.x, step.chunks - 1u) * 64u + local];
    let eye = eye_of(min(entry.y & VIEW_MASK, step.views - 1u));
    let is_entry = exists && (entry.y >> VIEW_BITS) == eye.generation;
    var node = select(step.root, entry.x, is_entry);
    var above = -NEVER;
    var own = NEVER;
    var visits = 0u;
    var merges = 0u;
    var stays = false;
    var divides = false;
    if is_entry {
        visits = 1u;
        var parent = parents[node];
        if node != step.root {
            above = margin_of(parent, eye);
        }
        if above > 0.0 {
            stays = true;
            loop {
                stays = (nodes[parent].w >> 8u) == node;
                if !stays {
                    break;
                }
                merges += 1u;
                visits += 1u;
                node = parent;
                own = above;
                parent = parents[node];
                // The root is its own parent.
                if parent == node {
                    above = -NEVER;
                    break;
                }
                above = margin_of(parent, eye);
                if above <= 0.0 {
                    break;
                }
            }
        } else {
            if !is_leaf(node) {
                own = margin_of(node, eye);
            }
            stays = own > 0.0;
            divides = !stays;
        }
    }
    let staying = select(0u, 1u, stays);
    let dividing = select(0u, 1u, divides);
    let stays_before = subgroupExclusiveAdd(staying);
    let divides_before = subgroupExclusiveAdd(dividing);
    let all_staying = subgroupAdd(staying);
    let all_dividing = subgroupAdd(dividing);
    let all_visits = subgroupAdd(visits);
    let all_merges = subgroupAdd(merges);
    var stay_base = 0u;
    var divide_base = 0u;
    if lane == 0u {
        stay_base = atomicAdd(&counters[SETTLED], all_staying);
        divide_base = atomicAdd(&counters[step.queue_out], all_dividing);
        atomicAdd(&counters[VISITS], all_visits);
        atomicAdd(&counters[MERGES], all_merges);
    }
    stay_base = subgroupBroadcastFirst(stay_base) + stays_before;
    divide_base = subgroupBroadcastFirst(divide_base) + divides_before;
    if stays {
        let course = course_of(entry.y & VIEW_MASK);
        var slack = node_slack(node, eye, course);
        if node != step.root {
            slack = min(slack, parent_slack(parents[node], eye, course));
        }
        settle(stay_base, node, entry.y, bin_of(slack));
    }
    if divides {
        enqueue(divide_base, node, entry.y);
    }
}

// Divides each node of the queue. Each child becomes part of the cut, or is queued for the next step. Nodes that may not be
// divided further in this frame stay in the cut until the next frame.
@compute @workgroup_size(64)
fn split(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let at = linear_index(group, groups, local);
    let count = min(atomicLoad(&counters[step.queue_in]), step.capacity);
    let is_pair = at < count;
    let pair = select(vec2u(step.root, 0u), queue[min(at, step.capacity - 1u)], is_pair);
    let fresh = pair.x & FRESH;
    let node = pair.x & ~FRESH;
    let waits = is_pair && step.deep == 0u && fresh == 0u;
    let eye = eye_of(pair.y & VIEW_MASK);
    let links = nodes[node].w;
    let first = links >> 8u;
    let children = select(0u, countOneBits(links & 255u), is_pair && !waits);
    let course = course_of(pair.y & VIEW_MASK);
    // Slack of the children's parent.
    var above = NEVER;
    if ordered && is_pair {
        above = parent_slack(node, eye, course);
    }
    var settles = 0u;
    var divides = 0u;
    var low_bins = 0u;
    var high_bins = 0u;
    for (var i = 0u; i < children; i++) {
        let child = first + i;
        var own = NEVER;
        if !is_leaf(child) {
            own = margin_of(child, eye);
        }
        if own > 0.0 {
            settles |= 1u << i;
            if ordered {
                let bin = bin_of(min(above, node_slack(child, eye, course))) << (8u * (i & 3u));
                low_bins |= select(bin, 0u, i >= 4u);
                high_bins |= select(0u, bin, i >= 4u);
            }
        } else {
            divides |= 1u << i;
        }
    }
    let settling = countOneBits(settles) + select(0u, 1u, waits);
    let dividing = countOneBits(divides);
    let settles_before = subgroupExclusiveAdd(settling);
    let divides_before = subgroupExclusiveAdd(dividing);
    let all_settling = subgroupAdd(settling);
    let all_dividing = subgroupAdd(dividing);
    let all_visits = subgroupAdd(children);
    let all_splits = subgroupAdd(select(0u, 1u, children > 0u));
    var settle_base = 0u;
    var divide_base = 0u;
    if lane == 0u {
        settle_base = atomicAdd(&counters[SETTLED], all_settling);
        divide_base = atomicAdd(&counters[step.queue_out], all_dividing);
        atomicAdd(&counters[VISITS], all_visits);
        atomicAdd(&counters[SPLITS], all_splits);
    }
    settle_base = subgroupBroadcastFirst(settle_base) + settles_before;
    divide_base = subgroupBroadcastFirst(divide_base) + divides_before;
    if waits {
        settle(settle_base, node, pair.y, UNSETTLED);
    }
    while settles != 0u {
        let i = countTrailingZeros(settles);
        let bins = select(low_bins, high_bins, i >= 4u);
        settle(settle_base, first + i, pair.y, (bins >> (8u * (i & 3u))) & 255u);
        settle_base += 1u;
        settles &= settles - 1u;
    }
    while divides != 0u {
        enqueue(divide_base, (first + countTrailingZeros(divides)) | fresh, pair.y);
        divide_base += 1u;
        divides &= divides - 1u;
    }
}

// Allocates chunks for the entries of each bin from the stack of free chunks. Unsorted entries use the first chunks.
@compute @workgroup_size(1)
fn allot() {
    let all = min(atomicLoad(&counters[SETTLED]), step.capacity);
    if !ordered {
        let used = (all + 63u) / 64u;
        atomicStore(&state[HIGH], used);
        groups_for(used);
        return;
    }
    let top = atomicLoad(&state[FREE]);
    var needed = 0u;
    for (var bin = 0u; bin < BIN_COUNT; bin++) {
        atomicStore(&counters[BASES + bin], needed);
        needed += (atomicLoad(&counters[BINS + bin]) + 63u) / 64u;
    }
    if needed > top {
        atomicMax(&counters[OVERFLOW], 1u);
    }
    let overflowed = atomicLoad(&counters[OVERFLOW]) != 0u;
    let taken = select(needed, 0u, overflowed);
    atomicStore(&counters[FREE_BASE], top - taken);
    atomicStore(&state[FREE], top - taken);
    groups_for(select((all + 63u) / 64u, 0u, overflowed));
}

// Writes settled entries to their chunks.
@compute @workgroup_size(64)
fn place(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    let count = min(atomicLoad(&counters[SETTLED]), step.capacity);
    if at >= count {
        return;
    }
    if !ordered {
        if local == 0u {
            chunks[at / 64u] = vec2u(0u, min(64u, count - at));
        }
        return;
    }
    let bin = slots[at] >> 25u;
    let number = slots[at] & 0x1ffffffu;
    let chunk = free[atomicLoad(&counters[FREE_BASE]) + atomicLoad(&counters[BASES + bin]) + number / 64u];
    entries[chunk * 64u + number % 64u] = settled[at];
    if number % 64u == 0u {
        let clock = atomicLoad(&state[CLOCK]);
        // Subtracts the lag, so that this chunk is due in any case.
        let when = select(clock + slack_of(bin), clock - step.lag, bin == UNSETTLED);
        chunks[chunk] = vec2u(when, min(64u, atomicLoad(&counters[BINS + bin]) - number));
        atomicMax(&state[HIGH], chunk + 1u);
    }
}

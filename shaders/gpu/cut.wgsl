// Program of gpu/src/many_views/cuts/passes.rs: a cut through a tree of balls for every view at once (ManyLoDs, section
// 3), found from the root, or from the last frame's.
//
// What is kept of a cut lies in chunks of 64 entries that need not be looked at again before views have moved by
// so much: each has a due time on a clock of motion, and a chunk that is not due is not touched. Chunks that are due
// are taken apart and their entries put into others by how far off their verdicts now are.

import package::shared::cone::{direction_of, widened};
import package::shared::cut::{Course, EYE_WORDS, Eye, VIEW_BITS, VIEW_MASK, cut_lasts, cut_value, eye_from};
import package::shared::linear::linear_index;

struct CutStep {
    // Views.
    views: u32,
    // The tree's root.
    root: u32,
    // Texels of a hemisphere's side by the threshold.
    scale: f32,
    // Motion of a view, edges, beyond which it starts over.
    jump: f32,
    // Entries that the queues and the cut hold.
    capacity: u32,
    // Chunks of the cut.
    chunks: u32,
    // Entries of `counters` for the queue that is read and the one that is filled.
    queue_in: u32,
    queue_out: u32,
    // Where numbers of workgroups go.
    arguments: u32,
    // Units of motion by which chunks may be overdue while views move.
    lag: u32,
    // 1: every view starts over.
    restart: u32,
    // 0: of this step's queue only what started over is divided.
    deep: u32,
}

var<immediate> step: CutStep;

// Whether what no view sees is culled.
override culls: bool = true;
// Whether entries are kept in the order of their due times; else one after the other.
override ordered: bool = true;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read> spheres: array<vec4f>;
@group(0) @binding(2) var<storage, read> parents: array<u32>;
// Two a view: position and half the field of view; direction.
@group(0) @binding(3) var<storage, read> views: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> eyes: array<vec4f>;
// Nodes that must be divided, and for which view.
@group(0) @binding(5) var<storage, read> queue: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> next: array<vec2u>;
// Entries that are settled, and where they go: 25 bits of a number within a bin, below the bin.
@group(0) @binding(7) var<storage, read_write> settled: array<vec2u>;
@group(0) @binding(8) var<storage, read_write> places: array<u32>;
@group(0) @binding(9) var<storage, read_write> entries: array<vec2u>;
// Of each chunk when it is due and how many entries it has.
@group(0) @binding(10) var<storage, read_write> chunks: array<vec2u>;
// Chunks that are empty, a stack.
@group(0) @binding(11) var<storage, read_write> free: array<u32>;
// Chunks that are due and how many entries they had.
@group(0) @binding(12) var<storage, read_write> due: array<vec2u>;
// Of this frame.
@group(0) @binding(13) var<storage, read_write> counters: array<atomic<u32>>;
@group(0) @binding(14) var<storage, read_write> arguments: array<u32>;
// How far the tree's balls moved and grew since it was made.
@group(0) @binding(15) var<storage, read> moved: array<u32>;
// From frame to frame.
@group(0) @binding(16) var<storage, read_write> state: array<atomic<u32>>;

// `counters`: words of gpu/src/many_views/cuts/counters.rs.
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
// Where each bin's chunks begin in the stack of free ones.
const BASES: u32 = 144u;

// `state`
const CLOCK: u32 = 0u;
const SEEN_SHIFT: u32 = 1u;
const SEEN_GROWTH: u32 = 2u;
const FREE: u32 = 3u;
// One more than the last chunk that was ever in use.
const HIGH: u32 = 4u;
const LATEST: u32 = 5u;
// Radians by which courses turn in an edge of way at most, f32.
const BEND: u32 = 6u;
// Frames in which none turned by more.
const CALM: u32 = 7u;
// Whether due times may count on courses; whether any does; whether all chunks are due since one turned away.
const COUNTS_ON: u32 = 8u;
const COUNTED_ON: u32 = 9u;
const FORCED: u32 = 10u;

// Units of motion in an edge of the root: 2^22.
const UNITS: f32 = 4194304.0;
// Slack that is less than this many units, a power of two, is none.
const LEAST_OCTAVE: u32 = 6u;
// The bin of entries that must be looked at in the next frame whatever moves.
const UNSETTLED: u32 = 127u;
const NEVER: f32 = 8.0;
// Courses that turn by more, radians an edge, are not worth counting on; nor are those after fewer calm frames.
const SHARPEST: f32 = 200.0;
// Courses are taken to turn by this much at least: straight ones do by what f32 rounds.
const STRAIGHTEST: f32 = 2.0;
const CALM_FRAMES: u32 = 2u;
// Of a node in the queue: its view has started over in this frame, and is divided down to its cut whatever it takes.
const FRESH: u32 = 0x80000000u;

fn eye_of(view: u32) -> Eye {
    return eye_from(eyes[EYE_WORDS * view], eyes[EYE_WORDS * view + 1u]);
}

fn course_of(view: u32) -> Course {
    let direction = eyes[EYE_WORDS * view + 2u].xyz;
    let known = atomicLoad(&state[COUNTS_ON]) != 0u && any(direction != vec3f(0.0));
    return Course(direction, bitcast<f32>(atomicLoad(&state[BEND])), select(0u, 1u, known));
}

// How far a view may go before a node must be looked at again: it or what is above it may then be another matter.
fn node_lasts(node: u32, eye: Eye, course: Course) -> f32 {
    if is_leaf(node) {
        return NEVER;
    }
    return cut_lasts(spheres[node], eye, course, step.scale, culls, true);
}

fn parent_lasts(parent: u32, eye: Eye, course: Course) -> f32 {
    return cut_lasts(spheres[parent], eye, course, step.scale, culls, false);
}

fn value_of(node: u32, eye: Eye) -> f32 {
    return cut_value(spheres[node], eye, step.scale, culls);
}

fn is_leaf(node: u32) -> bool {
    return (nodes[node].w & 255u) == 0u;
}

// The bin by slack: eight to an octave, so that at most an eighth of it is given away.
fn bin_of(slack: f32) -> u32 {
    let units = u32(clamp(slack * UNITS, 0.0, 4294967040.0));
    if units < (1u << LEAST_OCTAVE) {
        return 0u;
    }
    let octave = 31u - countLeadingZeros(units);
    let eighth = (units >> (octave - 3u)) & 7u;
    return min(1u + (octave - LEAST_OCTAVE) * 8u + eighth, UNSETTLED - 1u);
}

// The least slack of a bin's entries, units.
fn slack_of(bin: u32) -> u32 {
    let octave = (bin - 1u) / 8u + LEAST_OCTAVE;
    let eighth = (bin - 1u) % 8u;
    return select((8u + eighth) << (octave - 3u), 1u, bin == 0u);
}

// Writes an entry that is settled where it was reserved; `bin` counts where order is kept.
fn settle(at: u32, node: u32, tagged: u32, bin: u32) {
    if at >= step.capacity {
        atomicMax(&counters[OVERFLOW], 1u);
        return;
    }
    if ordered {
        let number = atomicAdd(&counters[BINS + bin], 1u);
        settled[at] = vec2u(node, tagged);
        places[at] = (bin << 25u) | (number & 0x1ffffffu);
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

// Puts every chunk on the stack of free ones, the first on top.
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
        // Lag is taken off due times: it must not take them below zero.
        atomicStore(&state[CLOCK], 1u << 23u);
        atomicStore(&state[SEEN_SHIFT], moved[0]);
        atomicStore(&state[SEEN_GROWTH], moved[1]);
        atomicStore(&state[BEND], 0u);
        atomicStore(&state[CALM], 0u);
        atomicStore(&state[COUNTS_ON], 0u);
        atomicStore(&state[COUNTED_ON], 0u);
    }
}

// Where views are now and how far they moved; those that moved far, or see another angle, start over from the root.
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
        // A turn moves what is seen by as much as its distance makes of it.
        let reach = distance(position, vec3f(0.5)) + 0.9;
        let way = position - before.position;
        let ahead = length(way);
        let turn = distance(axis, before.axis) * reach;
        let motion = ahead + turn;
        starts = motion > step.jump || cos_seen != before.cos_seen;
        if starts {
            generation = (generation + 1u) & 255u;
            if generation == 0u {
                // Entries of the generation that had this number before might still be there.
                atomicMax(&counters[WRAPPED], 1u);
            }
        } else {
            atomicMax(&counters[MOTION], bitcast<u32>(motion));
            let last_course = eyes[EYE_WORDS * view + 2u].xyz;
            course = select(last_course, way / max(ahead, 1e-37), ahead > 0.0);
            // An arc is at most this much longer than a chord of up to 1.
            let chord = distance(course, last_course);
            let arc = select(4.0, chord * 1.05, chord <= 1.0) / max(ahead, 1e-37);
            let turned = any(last_course != vec3f(0.0)) && chord > 0.0;
            // What turns about itself has no course that says what it sees next.
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
        if value_of(step.root, eye) > 0.0 {
            let nowhere = Course(course, 0.0, 0u);
            let bin = bin_of(cut_lasts(spheres[step.root], eye, nowhere, step.scale, culls, true));
            settle(atomicAdd(&counters[SETTLED], 1u), step.root, tagged, bin);
        } else {
            enqueue(atomicAdd(&counters[step.queue_out], 1u), step.root | FRESH, tagged);
        }
    }
}

// Moves the clock on by as much as views and balls moved at most.
@compute @workgroup_size(1)
fn tick() {
    let shift = moved[0] - atomicLoad(&state[SEEN_SHIFT]);
    let growth = moved[1] - atomicLoad(&state[SEEN_GROWTH]);
    atomicStore(&state[SEEN_SHIFT], moved[0]);
    atomicStore(&state[SEEN_GROWTH], moved[1]);
    let motion = bitcast<f32>(atomicLoad(&counters[MOTION]));
    let of_views = select(0u, u32(ceil(motion * 1.00001 * UNITS)) + 1u, motion > 0.0);
    // A verdict changes by at most scale / 2 + 1 times as much as a radius.
    let of_balls = f32(shift) + f32(growth) * (0.5 * step.scale + 1.0);
    let ticks = of_views + u32(min(ceil(of_balls * 1.00001), 16777216.0));
    atomicAdd(&state[CLOCK], ticks);
    atomicStore(&state[LATEST], ticks);
    // Due times count on courses once those have been calm, and until one is not: then all chunks are due once.
    let turning = bitcast<f32>(atomicLoad(&counters[TURNING]));
    let bend = max(bitcast<f32>(atomicLoad(&state[BEND])), STRAIGHTEST);
    let strays = turning > bend || of_balls > 0.0;
    let counted_on = atomicLoad(&state[COUNTED_ON]);
    atomicStore(&state[FORCED], select(0u, counted_on, strays));
    if strays {
        let wider = select(bend, max(bend, 1.15 * turning), turning < SHARPEST);
        atomicStore(&state[BEND], bitcast<u32>(wider));
        atomicStore(&state[CALM], 0u);
        atomicStore(&state[COUNTS_ON], 0u);
        atomicStore(&state[COUNTED_ON], 0u);
    } else if ticks > 0u {
        atomicStore(&state[BEND], bitcast<u32>(max(max(0.9 * bend, 1.15 * turning), STRAIGHTEST)));
        let calm = atomicAdd(&state[CALM], 1u) + 1u;
        if calm >= CALM_FRAMES {
            atomicStore(&state[COUNTS_ON], 1u);
            atomicStore(&state[COUNTED_ON], 1u);
        }
    }
    groups_for((atomicLoad(&state[HIGH]) + 63u) / 64u);
}

// Which chunks are due. They are free from now on, though what they hold stays until `place`.
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
    let is_due = chunk.x + lag <= atomicLoad(&state[CLOCK]) || atomicLoad(&state[FORCED]) != 0u;
    if chunk.y > 0u && is_due {
        due[atomicAdd(&counters[DUE], 1u)] = vec2u(at, chunk.y);
        chunks[at].y = 0u;
        free[atomicAdd(&state[FREE], 1u)] = at;
    }
}

@compute @workgroup_size(1)
fn prepare_visits() {
    groups_for(atomicLoad(&counters[DUE]));
}

// After an overflow nothing follows: the frame is run again.
@compute @workgroup_size(1)
fn prepare() {
    let overflowed = atomicLoad(&counters[OVERFLOW]) != 0u;
    let count = select(atomicLoad(&counters[step.queue_in]), 0u, overflowed);
    groups_for((count + 63u) / 64u);
}

// Looks at an entry again: it stays, is to be divided, or gives way to the highest node above it that will do. All
// below that node are looked at in the same frame, since each of them depends on it, and only first children go up.
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
            above = value_of(parent, eye);
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
                // The root is its own.
                if parent == node {
                    above = -NEVER;
                    break;
                }
                above = value_of(parent, eye);
                if above <= 0.0 {
                    break;
                }
            }
        } else {
            if !is_leaf(node) {
                own = value_of(node, eye);
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
        var lasts = node_lasts(node, eye, course);
        if node != step.root {
            lasts = min(lasts, parent_lasts(parents[node], eye, course));
        }
        settle(stay_base, node, entry.y, bin_of(lasts));
    }
    if divides {
        enqueue(divide_base, node, entry.y);
    }
}

// Divides each node of the queue: its children are settled, or are divided next. What may not be divided any further in
// this frame stays as it is until the next.
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
    // What is above the children is this node.
    var above = NEVER;
    if ordered && is_pair {
        above = parent_lasts(node, eye, course);
    }
    var settles = 0u;
    var divides = 0u;
    var low_bins = 0u;
    var high_bins = 0u;
    for (var i = 0u; i < children; i++) {
        let child = first + i;
        var own = NEVER;
        if !is_leaf(child) {
            own = value_of(child, eye);
        }
        if own > 0.0 {
            settles |= 1u << i;
            if ordered {
                let bin = bin_of(min(above, node_lasts(child, eye, course))) << (8u * (i & 3u));
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

// Takes as many free chunks for each bin as its entries fill; or, without order, as many from the first on.
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
    let bin = places[at] >> 25u;
    let number = places[at] & 0x1ffffffu;
    let chunk = free[atomicLoad(&counters[FREE_BASE]) + atomicLoad(&counters[BASES + bin]) + number / 64u];
    entries[chunk * 64u + number % 64u] = settled[at];
    if number % 64u == 0u {
        let clock = atomicLoad(&state[CLOCK]);
        // Without regard to the lag: this is due in any case.
        let when = select(clock + slack_of(bin), clock - step.lag, bin == UNSETTLED);
        chunks[chunk] = vec2u(when, min(64u, atomicLoad(&counters[BINS + bin]) - number));
        atomicMax(&state[HIGH], chunk + 1u);
    }
}

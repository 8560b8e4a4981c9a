// Program of papers/manylods/src/draw.rs: draws the cuts of all views into their maps (ManyLoDs, section 4.2).

import package::manylods::shared::cut::{EYE_WORDS, VIEW_BITS, VIEW_MASK, cut_unseen, eye_from};
import package::shared::linear::linear_index;
import package::megaviews::shared::map_texels::{MapTexel, put_texel, texel_place};
import package::megaviews::shared::paraboloid::{paraboloid_area, paraboloid_ray, paraboloid_sample};

struct DrawStep {
    views: u32,
    side: u32,
    // Largest apparent size of a node that is drawn as one disc, texels.
    threshold: f32,
    // Length of the root's edge, metres.
    edge: f32,
    // Base-2 logarithm of the number of maps in one array.
    map_shift: u32,
    // Capacity of the queue, entries, and its index in `counters`.
    capacity: u32,
    queue: u32,
    // Index in `arguments` of the number of workgroups.
    arguments: u32,
}

var<immediate> step: DrawStep;

// Leaves are surface points, drawn as discs. Otherwise they are cells.
override surfels: bool = false;
// Most texels that a disc covers in each direction.
override reach: u32 = 1u;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read> spheres: array<vec4f>;
@group(0) @binding(2) var<storage, read> cones: array<vec4f>;
@group(0) @binding(3) var<storage, read> eyes: array<vec4f>;
@group(0) @binding(4) var<storage, read> entries: array<vec2u>;
@group(0) @binding(5) var<storage, read> chunks: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> next: array<vec2u>;
@group(0) @binding(7) var<storage, read> queue: array<vec2u>;
@group(0) @binding(8) var<storage, read_write> counters: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> arguments: array<u32>;
@group(0) @binding(10) var<storage, read_write> state: array<atomic<u32>>;

// `counters` and `state`: see papers/manylods/shaders/cut.wgsl.
const OVERFLOW: u32 = 0u;
const DRAWN: u32 = 11u;
const HIGH: u32 = 4u;

// Radius of a disc relative to its sphere's radius. The squared radius of a surface point's sphere is the area that the
// point represents. Points get larger discs, since they are spread less evenly than cells.
override disc_of_cell: f32 = 0.5;
const DISC_OF_POINT: f32 = 1.0;

fn disc_radius(radius: f32) -> f32 {
    return radius * select(disc_of_cell, DISC_OF_POINT, surfels);
}

fn groups_for(count: u32) {
    let across = min(count, 32768u);
    arguments[step.arguments] = across;
    arguments[step.arguments + 1u] = (count + max(across, 1u) - 1u) / max(across, 1u);
    arguments[step.arguments + 2u] = 1u;
}

// Sets one workgroup of `draw` for each used chunk; none after an overflow.
@compute @workgroup_size(1)
fn prepare_draw() {
    let overflowed = atomicLoad(&counters[OVERFLOW]) != 0u;
    groups_for(select(atomicLoad(&state[HIGH]), 0u, overflowed));
}

// Sets the workgroups of `fill_large`; none after an overflow.
@compute @workgroup_size(1)
fn prepare_fill() {
    let overflowed = atomicLoad(&counters[OVERFLOW]) != 0u;
    groups_for((select(atomicLoad(&counters[step.queue]), 0u, overflowed) + 63u) / 64u);
}

// Draws each node into the texels whose sample points its disc covers. Leaves larger than the threshold are queued for
// `fill_large`. Nodes outside the view's cone are not drawn.
@compute @workgroup_size(64)
fn draw(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let chunk = group.y * groups.x + group.x;
    let exists = chunk < atomicLoad(&state[HIGH]) && local < chunks[min(chunk, arrayLength(&chunks) - 1u)].y;
    let entry = select(vec2u(0u), entries[min(chunk * 64u + local, arrayLength(&entries) - 1u)], exists);
    let view = entry.y & VIEW_MASK;
    let eye = eye_from(eyes[EYE_WORDS * view], eyes[EYE_WORDS * view + 1u]);
    let is_entry = exists && (entry.y >> VIEW_BITS) == eye.generation;
    let sphere = spheres[entry.x];
    let radius = sphere.w;
    let mean = bitcast<vec3f>(nodes[entry.x].xyz);
    let d = mean - eye.position;
    let range = length(d);
    let unseen = cut_unseen(sphere, eye) > 0.0;
    let tangent = sqrt(max(range * range - radius * radius, 0.0));
    // Centre and radius of the disc in the hemisphere's plane, -1..1.
    let at = d.yz / max(range + abs(d.x), 1e-37);
    let disc = radius / max(abs(d.x) + tangent, 1e-37);
    let side = f32(step.side);
    let leaf = (nodes[entry.x].w & 255u) == 0u;
    let large = leaf && !(range > radius && disc * side <= step.threshold);
    // A view that sees one hemisphere does not see the surface that it lies on.
    let before_it = eye.cos_seen < -0.95 || dot(d, eye.axis) >= 0.5 * radius;
    let fills = is_entry && !unseen && large && before_it;
    if is_entry && !unseen && !large {
        let hemisphere = select(0u, 1u, d.x < 0.0);
        let value = MapTexel(1.0 / max(range * step.edge, 1e-37), entry.x);
        let covered = disc_radius(disc);
        let corner = select(vec2u(max(((at - disc) * 0.5 + 0.5) * side, vec2f(0.0))),
            min(vec2u((at * 0.5 + 0.5) * side), vec2u(step.side - 1u)), reach == 1u);
        let across = select(reach + 1u, 1u, reach == 1u);
        for (var i = 0u; i < across * across; i++) {
            let cell = corner + vec2u(i % across, i / across);
            if all(cell < vec2u(step.side)) && distance(paraboloid_sample(cell, side), at) <= covered {
                let texel = (hemisphere * step.side + cell.y) * step.side + cell.x;
                put_texel(texel_place(view, step.map_shift, step.side, texel), value);
            }
        }
    }
    let one = select(0u, 1u, fills);
    let before = subgroupExclusiveAdd(one);
    let all_filling = subgroupAdd(one);
    let all_drawn = subgroupAdd(select(0u, 1u, is_entry));
    var base = 0u;
    if lane == 0u {
        base = atomicAdd(&counters[step.queue], all_filling);
        atomicAdd(&counters[DRAWN], all_drawn);
    }
    base = subgroupBroadcastFirst(base) + before;
    if fills {
        if base < step.capacity {
            next[base] = vec2u(entry.x, view);
        } else {
            atomicMax(&counters[OVERFLOW], 1u);
        }
    }
}

// Writes a large leaf to each texel whose ray hits it. A cell has the range of its mean position; a disc has the range of
// the hit.
@compute @workgroup_size(64)
fn fill_large(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let nth = linear_index(group, groups, local);
    if nth >= min(atomicLoad(&counters[step.queue]), step.capacity) {
        return;
    }
    let pair = queue[nth];
    let eye = eyes[EYE_WORDS * pair.y].xyz;
    let sphere = spheres[pair.x];
    let to_center = sphere.xyz - eye;
    let to_mean = bitcast<vec3f>(nodes[pair.x].xyz) - eye;
    let half_cell = sphere.w * 0.57735026;
    let normal = cones[pair.x].xyz;
    let height = dot(normal, to_mean);
    let far = 1.0 / max(length(to_mean) * step.edge, 1e-37);
    let side = f32(step.side);
    let one_side = paraboloid_area(to_center, sphere.w * 1.001, 0u, side);
    let other_side = paraboloid_area(to_center, sphere.w * 1.001, 1u, side);
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
        var meets = false;
        var inverse_range = far;
        if surfels {
            let slant = dot(normal, ray);
            let t = height / select(slant, 1e-20, abs(slant) < 1e-20);
            meets = t > 0.0 && distance(ray * t, to_mean) <= disc_radius(sphere.w);
            inverse_range = 1.0 / max(t * length(ray) * step.edge, 1e-30);
        } else {
            // Distances at which the ray enters and leaves the cell's slab on each axis.
            let inverse = 1.0 / select(ray, vec3f(1e-20), abs(ray) < vec3f(1e-20));
            let one = (to_center - half_cell) * inverse;
            let other = (to_center + half_cell) * inverse;
            let begin = max(max(min(one.x, other.x), min(one.y, other.y)), min(one.z, other.z));
            let end = min(min(max(one.x, other.x), max(one.y, other.y)), max(one.z, other.z));
            meets = end >= max(begin, 0.0);
        }
        if meets {
            let texel = (hemisphere * step.side + cell.y) * step.side + cell.x;
            put_texel(texel_place(pair.y, step.map_shift, step.side, texel), MapTexel(inverse_range, pair.x));
        }
        // Next texel, row by row, without an integer division.
        let ends_row = cell.x + 1u == area.x + area.z;
        cell = select(vec2u(cell.x + 1u, cell.y), vec2u(area.x, cell.y + 1u), ends_row);
    }
}

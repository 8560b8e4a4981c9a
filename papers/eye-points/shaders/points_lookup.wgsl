// Program of papers/eye-points/src/device/lookup.rs: looks up what reflected rays meet, lists it, and averages its radiance (EPR,
// sections 4.1.2 and 4.1.3). Defined in f64 by `papers/eye-points/src/lookup.rs` and `requests.rs`.
//
// An invocation is a ray, a word of 32 points, a requested point, or a pixel.

import package::eye_points::shared::eye_points::{ABSENT, BACK, PointMap};
import package::shared::cube_faces::{face_of, from_face, in_face};
import package::shared::linear::linear_index;

// A pixel of the eye in which a reflector is seen.
struct PointPixel {
    // What its central ray meets, from the middle of the reflector's map, metres.
    about: vec3f,
    // Index of the reflector's map.
    map: u32,
    // The same place from the eye.
    from_eye: vec3f,
    // Unit normal.
    normal: vec3f,
    // Changes of the place, and of the normal, to the next pixel on the right and below.
    right: vec3f,
    down: vec3f,
    normal_right: vec3f,
    normal_down: vec3f,
}

// A reflected ray.
struct PointRay {
    // Its start, from the middle of the reflector's map, metres.
    start: vec3f,
    // Index of the reflector's map.
    map: u32,
    // Unit vector.
    direction: vec3f,
}

struct LookupStep {
    // The sky's radiance above, at the horizon and below.
    zenith: vec3f,
    // Number of rays, words, requested points or pixels.
    count: u32,
    horizon: vec3f,
    // Rays of a pixel.
    taps: u32,
    ground: vec3f,
    // Impostor steps.
    steps: u32,
    // First requested point of this dispatch.
    first: u32,
    // Id of the first point of a part, and number of its points.
    base: u32,
    points: u32,
    // What is added to the triangles of a part.
    facet_base: u32,
}

var<immediate> step: LookupStep;

// Id of the point, and bits of the inverse range; zeros for the sky.
@group(0) @binding(0) var<storage, read> texels: array<vec2u>;
@group(0) @binding(1) var<storage, read> maps: array<PointMap>;
@group(0) @binding(2) var<storage, read> pixels: array<PointPixel>;
@group(0) @binding(3) var<storage, read> taps: array<vec2f>;
@group(0) @binding(4) var<storage, read> rays: array<PointRay>;
// For each ray the id of the point that it meets, + 1; 0 for the sky.
@group(0) @binding(5) var<storage, read_write> met: array<u32>;
// A bit for each point.
@group(0) @binding(6) var<storage, read_write> requested: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read> request_words: array<u32>;
// For each word the number of its bits, which is scanned to `requested_before`.
@group(0) @binding(8) var<storage, read_write> request_counts: array<u32>;
@group(0) @binding(9) var<storage, read> requested_before: array<u32>;
// Ids of requested points, ascending.
@group(0) @binding(10) var<storage, read_write> list: array<u32>;
@group(0) @binding(11) var<storage, read> listed: array<u32>;
@group(0) @binding(12) var<storage, read> points: array<vec2u>;
@group(0) @binding(13) var<storage, read> kept_parts: array<vec4u>;
// For each requested point: triangle and side; quarters and flags; density; row and column.
@group(0) @binding(14) var<storage, read_write> found: array<vec4u>;
@group(0) @binding(15) var<storage, read> met_ids: array<u32>;
// For each ray the place of its point in the list, + 1.
@group(0) @binding(16) var<storage, read_write> slots: array<u32>;
// Radiance of requested points.
@group(0) @binding(17) var<storage, read> shaded: array<vec4f>;
// Mean radiance of each pixel's rays.
@group(0) @binding(18) var<storage, read_write> arriving: array<vec4f>;

// A ray is met by a plane at most at this many times the texel's range.
const FARTHEST: f32 = 8.0;
// Most impostor steps.
const MOST_STEPS: u32 = 16u;

fn texel_at(map: PointMap, face: u32, column: u32, row: u32) -> u32 {
    return map.first + (face * map.side + row) * map.side + column;
}

// Face, column and row of the texel that a direction belongs to.
fn texel_of(map: PointMap, direction: vec3f) -> vec3u {
    let face = face_of(direction);
    let at = in_face(face, direction);
    let side = f32(map.side);
    let place = (at.xy / at.z + 1.0) * 0.5 * side;
    return vec3u(face, vec2u(clamp(place, vec2f(0.0), vec2f(side - 0.5))));
}

// Change of the inverse depth along an axis, by the neighbour whose depth differs less. 0 stands for the sky.
fn slope(here: f32, before: f32, after: f32, each: f32) -> f32 {
    let back = (here - before) / each;
    let ahead = (after - here) / each;
    let nearer = select(ahead, back, abs(back) < abs(ahead));
    return select(select(0.0, ahead, after > 0.0), select(back, nearer, after > 0.0), before > 0.0);
}

fn inverse_depth(texel: u32, x: f32, y: f32) -> f32 {
    return bitcast<f32>(texels[texel].y) * sqrt(x * x + y * y + 1.0);
}

// The plane that a texel and its neighbours see: places about the map's middle whose product with it is 1.
fn plane(map: PointMap, texel: vec3u, index: u32) -> vec3f {
    let each = 2.0 / f32(map.side);
    let x = (f32(texel.y) + 0.5) * each - 1.0;
    let y = (f32(texel.z) + 0.5) * each - 1.0;
    let here = inverse_depth(index, x, y);
    let last = map.side - 1u;
    let left = inverse_depth(select(index, index - 1u, texel.y > 0u), x - each, y);
    let right = inverse_depth(select(index, index + 1u, texel.y < last), x + each, y);
    let below = inverse_depth(select(index, index - map.side, texel.z > 0u), x, y - each);
    let above = inverse_depth(select(index, index + map.side, texel.z < last), x, y + each);
    let along_x = slope(here, select(0.0, left, texel.y > 0u), select(0.0, right, texel.y < last), each);
    let along_y = slope(here, select(0.0, below, texel.z > 0u), select(0.0, above, texel.z < last), each);
    return from_face(texel.x, vec3f(along_x, along_y, here - along_x * x - along_y * y));
}

// Distance along a ray to the sphere of a range about the middle.
fn sphere(range: f32, start: vec3f, direction: vec3f) -> f32 {
    let along = dot(start, direction);
    let squared = along * along - dot(start, start) + range * range;
    return max(sqrt(max(squared, 0.0)) - along, 0.0);
}

// The texel that shows what a ray meets (Szirmay-Kalos et al. 2005).
fn lookup(map: PointMap, start: vec3f, direction: vec3f) -> u32 {
    var texel = texel_of(map, direction);
    var index = texel_at(map, texel.x, texel.y, texel.z);
    for (var i = 0u; i < MOST_STEPS; i++) {
        if i >= min(step.steps, arrayLength(&maps) * MOST_STEPS) {
            break;
        }
        let inverse = bitcast<f32>(texels[index].y);
        var towards = direction;
        if inverse > 0.0 {
            let range = 1.0 / inverse;
            let surface = plane(map, texel, index);
            let slope = dot(surface, direction);
            let t = (1.0 - dot(surface, start)) / select(1.0, slope, slope != 0.0);
            let on_plane = slope != 0.0 && t > 0.0 && t < FARTHEST * range;
            towards = start + direction * select(sphere(range, start, direction), t, on_plane);
            towards = select(towards, direction, all(towards == vec3f(0.0)));
        }
        let next = texel_of(map, towards);
        if all(next == texel) {
            break;
        }
        texel = next;
        index = texel_at(map, texel.x, texel.y, texel.z);
    }
    return index;
}

// Marks the point that a ray meets. Rays into maps of another turn are left.
fn request(at: u32, map: PointMap, start: vec3f, direction: vec3f) {
    if map.first == ABSENT {
        return;
    }
    let texel = texels[lookup(map, start, direction)];
    if texel.y == 0u {
        met[at] = 0u;
        return;
    }
    met[at] = texel.x + 1u;
    let word = texel.x / 32u;
    let bit = 1u << (texel.x % 32u);
    // Most have been requested before.
    if (atomicLoad(&requested[word]) & bit) == 0u {
        atomicOr(&requested[word], bit);
    }
}

fn normalized_or(v: vec3f, other: vec3f) -> vec3f {
    let squared = dot(v, v);
    return select(other, v * inverseSqrt(max(squared, 1e-37)), squared > 0.0);
}

// Start and direction of the reflected ray at an offset from a pixel's middle.
struct TapRay {
    start: vec3f,
    direction: vec3f,
}

fn tap_ray(pixel: PointPixel, tap: vec2f) -> TapRay {
    let moved = pixel.right * tap.x + pixel.down * tap.y;
    let normal =
        normalized_or(pixel.normal + pixel.normal_right * tap.x + pixel.normal_down * tap.y, pixel.normal);
    let direction = normalized_or(pixel.from_eye + moved, -normal);
    return TapRay(pixel.about + moved, direction - 2.0 * dot(direction, normal) * normal);
}

@compute @workgroup_size(64)
fn request_taps(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        let pixel = pixels[at / step.taps];
        let ray = tap_ray(pixel, taps[at % step.taps]);
        request(at, maps[pixel.map], ray.start, ray.direction);
    }
}

@compute @workgroup_size(64)
fn request_rays(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        let ray = rays[at];
        // Of a reflector without a map nothing is known.
        if ray.map != ABSENT {
            request(at, maps[ray.map], ray.start, ray.direction);
        }
    }
}

@compute @workgroup_size(64)
fn count_requests(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        request_counts[at] = countOneBits(request_words[at]);
    }
}

// Lists requested points, ascending.
@compute @workgroup_size(64)
fn list_requests(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    var bits = request_words[at];
    var to = requested_before[at];
    while bits != 0u {
        list[to] = 32u * at + firstTrailingBit(bits);
        bits &= bits - 1u;
        to++;
    }
}

// Finds what shading needs of the requested points of a part.
@compute @workgroup_size(64)
fn find_points(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let id = listed[step.first + at];
    if id < step.base || id - step.base >= step.points {
        return;
    }
    let point = points[id - step.base];
    let part = kept_parts[point.y];
    let facet = (part.x & ~BACK) + step.facet_base;
    found[at] = vec4u(facet | (part.x & BACK), part.y, part.z, point.x);
}

// The place of a requested point in the list.
fn slot_of(id: u32) -> u32 {
    let lower = (1u << (id % 32u)) - 1u;
    return requested_before[id / 32u] + countOneBits(request_words[id / 32u] & lower);
}

@compute @workgroup_size(64)
fn find_slots(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        let id = met_ids[at];
        slots[at] = select(0u, slot_of(max(id, 1u) - 1u) + 1u, id != 0u);
    }
}

// As `sky_radiance` of shared/shading.wgsl without an environment map.
fn sky(direction: vec3f) -> vec3f {
    let above = mix(step.horizon, step.zenith, min(direction.y, 1.0));
    let below = mix(step.horizon, step.ground, min(-4.0 * direction.y, 1.0));
    return select(below, above, direction.y >= 0.0);
}

// Averages the radiance that each pixel's rays meet.
@compute @workgroup_size(64)
fn mirror(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let pixel = pixels[at];
    let count = min(step.taps, arrayLength(&taps));
    var sum = vec3f(0.0);
    for (var i = 0u; i < count; i++) {
        let id = met_ids[at * step.taps + i];
        if id != 0u {
            sum += shaded[slot_of(id - 1u)].xyz;
        } else {
            sum += sky(tap_ray(pixel, taps[i]).direction);
        }
    }
    arriving[at] = vec4f(sum / f32(max(step.taps, 1u)), 0.0);
}

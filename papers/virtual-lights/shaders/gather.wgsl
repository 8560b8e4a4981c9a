// Program of `papers/virtual-lights/src/passes/gather.rs`: irradiance / π that each sub-sample receives from VPLs. Each sub-sample
// takes systematic samples of its block's list by weight, with another offset than its neighbours (Keller, Heidrich:
// "Interleaved Sampling", 2001). VPLs are weighted by the inverse of their probability, so the estimate is unbiased.

import package::shared::finite::{finite_or_zero};
import package::megaviews::shared::paraboloid::{paraboloid_index};
import package::shared::receiver::{receiver_of};
import package::virtual_lights::shared::vpl::{BLOCK, GROUP_WORDS, Gathering, LIST_HEAD, LIST_WORDS, Vpl};

@group(0) @binding(0) var<uniform> gathering: Gathering;
@group(0) @binding(1) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(2) var<storage, read> vpls: array<Vpl>;
@group(0) @binding(3) var<storage, read> lists: array<u32>;
@group(0) @binding(4) var<storage, read_write> gathered: array<vec4f>;
// For each VPL the centre of its map (f32 bits, relative to the root), and the index of the map.
@group(0) @binding(5) var<storage, read> eyes: array<vec4u>;
// Dual-paraboloid maps of distances, or of inverse distances (0: none); f32 bits.
@group(0) @binding(6) var<storage, read> maps0: array<u32>;
@group(0) @binding(7) var<storage, read> maps1: array<u32>;
@group(0) @binding(8) var<storage, read> maps2: array<u32>;
@group(0) @binding(9) var<storage, read> maps3: array<u32>;

override has_maps: bool = true;
override has_inverse_maps: bool = false;
// Number of arrays of maps.
override arrays: u32 = 1u;

// Steepest slope towards a VPL that the bias corrects.
const STEEPEST: f32 = 4.0;

// Pseudo-random number in 0..1 (Jarzynski, Olano: "Hash Functions for GPU Rendering", 2020: pcg).
fn random(seed: u32) -> f32 {
    let state = seed * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return f32(((word >> 22u) ^ word) >> 8u) / 16777216.0;
}

// Offset of a sub-sample in a stride. The 4×4 neighbours of a square have different sixteenths (ordered dither), and each
// square has a random shift, so that squares draw different VPLs.
fn beginning(at: vec2u) -> f32 {
    let x = at.x ^ at.y;
    let y = at.y;
    let order = ((x & 1u) << 3u) | ((y & 1u) << 2u) | (x & 2u) | ((y & 2u) >> 1u);
    let square = at / 4u;
    return (f32(order) + random(square.x + (square.y << 16u))) / 16.0;
}

// Distance in a texel of a map, metres.
fn nearest_in(map: u32, texel: u32) -> f32 {
    let side = gathering.map_side;
    let array_ = map >> gathering.map_shift;
    let at = (map - (array_ << gathering.map_shift)) * 2u * side * side + texel;
    var word = 0u;
    if arrays == 1u || array_ == 0u {
        word = maps0[min(at, arrayLength(&maps0) - 1u)];
    } else if arrays == 2u || array_ == 1u {
        word = maps1[min(at, arrayLength(&maps1) - 1u)];
    } else if arrays == 3u || array_ == 2u {
        word = maps2[min(at, arrayLength(&maps2) - 1u)];
    } else {
        word = maps3[min(at, arrayLength(&maps3) - 1u)];
    }
    let value = bitcast<f32>(word);
    return select(value, 1.0 / max(value, 1e-30), has_inverse_maps);
}

// Whether a surface is visible from a VPL, by its map.
fn sees(eye: vec4u, position: vec3f, normal: vec3f) -> bool {
    let d = position - bitcast<vec3f>(eye.xyz);
    let distance = max(length(d), 1e-20);
    let side = gathering.map_side;
    let nearest = nearest_in(eye.w, paraboloid_index(d, side));
    // Angle of a texel of a stereographic map, and the change of a plane's distance across it.
    let width = 2.0 / f32(side) * (1.0 + abs(d.x) / distance) * distance;
    let cosine = abs(dot(normal, d)) / distance;
    let slope = min(sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, 1e-3), STEEPEST);
    return distance <= nearest + gathering.bias * width * max(slope, 0.1) + gathering.slack * max(slope, 1.0);
}

fn light_of(index: u32, position: vec3f, normal: vec3f) -> vec3f {
    let vpl = vpls[index];
    let d = position - vpl.position;
    let distance = length(d);
    // A particle has no normal and emits in all directions.
    let leaving = select(dot(vpl.normal, d) / distance, 1.0, all(vpl.normal == vec3f(0.0)));
    let arriving = -dot(normal, d) / distance;
    if !(leaving > 0.0 && arriving > 0.0 && distance <= gathering.cutoff) {
        return vec3f(0.0);
    }
    let nearer = max(distance, gathering.least_distance);
    var lit = true;
    if has_maps {
        lit = sees(eyes[min(index, arrayLength(&eyes) - 1u)], position, normal);
    }
    return select(vec3f(0.0), vpl.intensity * (leaving * arriving / (nearer * nearer)), lit);
}

// A VPL and its weight.
struct Taken {
    index: u32,
    share: f32,
}

// The VPL at a cumulative weight in a block's list, found by bisection.
fn taken_at(list: u32, place: f32) -> Taken {
    var low = 0u;
    var high = lists[list] - 1u;
    for (var i = 0u; i < 8u; i++) {
        let middle = (low + high) / 2u;
        let beyond = bitcast<f32>(lists[list + LIST_HEAD + GROUP_WORDS * middle + 2u]) > place;
        high = select(high, middle, beyond);
        low = select(min(middle + 1u, high), low, beyond);
    }
    let entry = list + LIST_HEAD + GROUP_WORDS * low;
    var lights_before = 0u;
    var worth_before = 0.0;
    if low > 0u {
        lights_before = lists[entry - GROUP_WORDS + 1u];
        worth_before = bitcast<f32>(lists[entry - GROUP_WORDS + 2u]);
    }
    let lights = lists[entry + 1u] - lights_before;
    let worth = max(bitcast<f32>(lists[entry + 2u]) - worth_before, 1e-37);
    let within = min(u32(max(place - worth_before, 0.0) / worth * f32(lights)), lights - 1u);
    return Taken(lists[entry] + within, f32(lights) / worth * bitcast<f32>(lists[entry + 3u]));
}

// The VPL of an index in a block's list.
fn listed(list: u32, number: u32) -> Taken {
    var low = 0u;
    var high = lists[list] - 1u;
    for (var i = 0u; i < 8u; i++) {
        let middle = (low + high) / 2u;
        let beyond = lists[list + LIST_HEAD + GROUP_WORDS * middle + 1u] > number;
        high = select(high, middle, beyond);
        low = select(min(middle + 1u, high), low, beyond);
    }
    let entry = list + LIST_HEAD + GROUP_WORDS * low;
    var before = 0u;
    if low > 0u {
        before = lists[entry - GROUP_WORDS + 1u];
    }
    return Taken(lists[entry] + number - before, bitcast<f32>(lists[entry + 3u]));
}

@compute @workgroup_size(8, 8)
fn gather(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= gathering.size.x || id.y >= gathering.size.y {
        return;
    }
    let at = id.y * gathering.size.x + id.x;
    let receiver = receiver_of(g_surfaces[at]);
    let block = id.xy / BLOCK;
    let list = (block.y * gathering.blocks.x + block.x) * LIST_WORDS;
    let lights = lists[list + 1u];
    var sum = vec3f(0.0);
    if receiver.exists && lights > 0u {
        let position = receiver.position + gathering.root_from_eye;
        let all = gathering.samples >= lights;
        let count = min(gathering.samples, lights);
        let step = bitcast<f32>(lists[list + 2u]) / f32(count);
        let begin = beginning(gathering.origin + id.xy);
        var i = 0u;
        loop {
            var taken = Taken(0u, 1.0);
            if all {
                taken = listed(list, i);
            } else {
                taken = taken_at(list, (f32(i) + begin) * step);
                taken.share *= step;
            }
            let index = min(taken.index, arrayLength(&vpls) - 1u);
            sum += light_of(index, position, receiver.normal) * taken.share;
            i += 1u;
            if i >= count {
                break;
            }
        }
    }
    gathered[at] = vec4f(finite_or_zero(sum), 0.0);
}

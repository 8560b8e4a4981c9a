// Program of `sampler/src/passes/gather.rs`: irradiance by π that each sub-sample's surface receives from VPLs. Each
// takes every so-many-th VPL of its block's list, from another beginning than its neighbours, so that a square of them
// takes all (Keller, Heidrich: "Interleaved Sampling", 2001).

import package::shared::finite::{finite_or_zero};
import package::shared::paraboloid::{paraboloid_index};
import package::shared::vpl::{BLOCK, Gathering, LIST_WORDS, Vpl, receiver_of};

@group(0) @binding(0) var<uniform> gathering: Gathering;
@group(0) @binding(1) var<storage, read> guides: array<vec4u>;
@group(0) @binding(2) var<storage, read> vpls: array<Vpl>;
@group(0) @binding(3) var<storage, read> lists: array<u32>;
// Of each VPL a dual-paraboloid map of distances, f32 bits.
@group(0) @binding(4) var<storage, read> maps: array<u32>;
@group(0) @binding(5) var<storage, read_write> gathered: array<vec4f>;

override has_maps: bool = true;

// Steepest slope against the direction to a VPL that the bias makes up for.
const STEEPEST: f32 = 4.0;

// In 0..1 (Jarzynski, Olano: "Hash Functions for GPU Rendering", 2020: pcg).
fn random(seed: u32) -> f32 {
    let state = seed * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return f32(((word >> 22u) ^ word) >> 8u) / 16777216.0;
}

// Where in a stride a sub-sample begins: each of 4×4 neighbours in another sixteenth, near ones far apart (an ordered
// dither), and each such square elsewhere in them, lest all of the image take the same few VPLs.
fn beginning(at: vec2u) -> f32 {
    let x = at.x ^ at.y;
    let y = at.y;
    let order = ((x & 1u) << 3u) | ((y & 1u) << 2u) | (x & 2u) | ((y & 2u) >> 1u);
    let square = at / 4u;
    return (f32(order) + random(square.x + (square.y << 16u))) / 16.0;
}

// Whether the VPL sees a surface at `d` from it, whose normal has that cosine with the direction back.
fn sees(vpl: Vpl, d: vec3f, distance: f32, cosine: f32) -> bool {
    let side = gathering.map_side;
    let texel = vpl.map * 2u * side * side + paraboloid_index(d, side);
    let nearest = bitcast<f32>(maps[min(texel, arrayLength(&maps) - 1u)]);
    // Angle that a texel spans in a stereographic map.
    let width = 2.0 / f32(side) * (1.0 + abs(d.x) / distance) * distance;
    let slope = min(sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, 1e-3), STEEPEST);
    return distance <= nearest + gathering.bias * width * max(slope, 0.1);
}

fn light_of(vpl: Vpl, position: vec3f, normal: vec3f) -> vec3f {
    let d = position - vpl.position;
    let distance = length(d);
    let leaving = dot(vpl.normal, d) / distance;
    let arriving = -dot(normal, d) / distance;
    if !(leaving > 0.0 && arriving > 0.0 && distance <= gathering.cutoff) {
        return vec3f(0.0);
    }
    let nearer = max(distance, gathering.least_distance);
    var lit = true;
    if has_maps {
        lit = sees(vpl, d, distance, arriving);
    }
    return select(vec3f(0.0), vpl.intensity * (leaving * arriving / (nearer * nearer)), lit);
}

// The VPL that stands at a place in a block's list: the first group whose share ends beyond it, by halving.
fn listed(list: u32, place: u32) -> u32 {
    var low = 0u;
    var high = lists[list] - 1u;
    for (var i = 0u; i < 8u; i++) {
        let middle = (low + high) / 2u;
        let beyond = lists[list + 3u + 2u * middle] > place;
        high = select(high, middle, beyond);
        low = select(min(middle + 1u, high), low, beyond);
    }
    var before = 0u;
    if low > 0u {
        before = lists[list + 1u + 2u * low];
    }
    return lists[list + 2u + 2u * low] + place - before;
}

@compute @workgroup_size(8, 8)
fn gather(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= gathering.size.x || id.y >= gathering.size.y {
        return;
    }
    let at = id.y * gathering.size.x + id.x;
    let receiver = receiver_of(guides[at]);
    let block = id.xy / BLOCK;
    let list = (block.y * gathering.blocks.x + block.x) * LIST_WORDS;
    let lights = lists[list + 1u];
    var sum = vec3f(0.0);
    if receiver.exists && lights > 0u {
        let position = receiver.position + gathering.root_from_eye;
        let count = min(gathering.samples, lights);
        let stride = f32(lights) / f32(count);
        let begin = beginning(gathering.origin + id.xy);
        var i = 0u;
        loop {
            let place = min(u32((f32(i) + begin) * stride), lights - 1u);
            sum += light_of(vpls[min(listed(list, place), arrayLength(&vpls) - 1u)], position, receiver.normal);
            i += 1u;
            if i >= count {
                break;
            }
        }
        sum *= stride;
    }
    gathered[at] = vec4f(finite_or_zero(sum), 0.0);
}

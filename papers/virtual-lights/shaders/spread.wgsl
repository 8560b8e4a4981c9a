// Program of `papers/virtual-lights/src/passes/spread.rs`: interpolates the receivers' light at sub-samples and multiplies by albedo.
// Weights follow irradiance caching: distance relative to the distance of the light, and angle between normals (Ward,
// Rubinstein, Clear: "A Ray Tracing Solution for Diffuse Interreflection", 1988), times a smooth window.

import package::shared::receiver::{albedo_of, receiver_of};
import package::virtual_lights::shared::receivers::{Blocks, Chosen};

@group(0) @binding(0) var<uniform> blocks: Blocks;
@group(0) @binding(1) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(2) var<storage, read> g_materials: array<vec4u>;
// Indices of each block's receivers; NONE for none.
@group(0) @binding(3) var<storage, read> of_blocks: array<vec2u>;
@group(0) @binding(4) var<storage, read> receivers: array<Chosen>;
@group(0) @binding(5) var<storage, read> received: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> shaded: array<vec4f>;

const NONE: u32 = 0xffffffffu;
// Error of a receiver that is the sub-sample itself.
const LEAST_ERROR: f32 = 0.02;
// Weight of a receiver that faces away, used only if there is no other.
const FACING_AWAY: f32 = 1e-6;

@compute @workgroup_size(8, 8)
fn spread(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= blocks.size.x || id.y >= blocks.size.y {
        return;
    }
    let at = id.y * blocks.size.x + id.x;
    let own = receiver_of(g_surfaces[at]);
    if !own.exists {
        return;
    }
    let block = id.xy / blocks.block;
    let reach = min(blocks.reach, 1u);
    let first = max(block, vec2u(reach)) - reach;
    let last = min(block + reach, blocks.count - 1u);
    var sum = vec4f(0.0);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let numbers = of_blocks[y * blocks.count.x + x];
            for (var k = 0u; k < 2u; k++) {
                let number = select(numbers.x, numbers.y, k == 1u);
                if number == NONE {
                    continue;
                }
                let other = receivers[min(number, arrayLength(&receivers) - 1u)];
                let light = received[min(number, arrayLength(&received) - 1u)];
                let place = vec2f(vec2u(other.place & 0xffffu, other.place >> 16u));
                // From sub-sample to receiver, in blocks.
                let off = abs(place - vec2f(id.xy)) / vec2f(blocks.block);
                let window = max(1.0 - off.x / 1.5, 0.0) * max(1.0 - off.y / 1.5, 0.0);
                let facing = dot(own.normal, other.normal);
                let moved = length(other.position - own.position) * light.w;
                let error = moved + sqrt(max(1.0 - facing, 0.0)) + LEAST_ERROR;
                let weight = window / (error * error) * select(FACING_AWAY, 1.0, facing > 0.0);
                sum += vec4f(light.rgb, 1.0) * weight;
            }
        }
    }
    let light = select(vec3f(0.0), sum.rgb / max(sum.w, 1e-30), sum.w > 0.0);
    shaded[at] += vec4f(albedo_of(g_materials[at].x) * light, 0.0);
}

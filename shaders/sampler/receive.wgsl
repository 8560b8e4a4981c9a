// Program of `sampler/src/passes/receive.rs`: light that receivers receive from all that their maps show, the mean over
// the half space before each surface by the cosine of its normal: what a diffuse surface's reflection is made of.

import package::shared::encode::{unit_from_octahedral};
import package::shared::finite::{finite_or_zero};
import package::shared::node_maps::{map_of, node_texel};
import package::shared::paraboloid::{paraboloid_cell, paraboloid_direction};
import package::shared::receivers::{Chosen};
import package::shared::surfel::{Surfel, is_seen, radiance_towards};

struct Receive {
    // First receiver of those whose maps there are, and how many they are.
    first: u32,
    count: u32,
    // Maps of one array: 2 to the power of this.
    map_shift: u32,
    // Texels of a hemisphere's side.
    map_side: u32,
}

@group(0) @binding(0) var<uniform> receive: Receive;
@group(0) @binding(1) var<storage, read> receivers: array<Chosen>;
@group(0) @binding(6) var<storage, read> surfels: array<Surfel>;
// Irradiance by π; in w the mean of what is seen's inverse distance in 1/metres. Added to what is there.
@group(0) @binding(2) var<storage, read_write> received: array<vec4f>;

const GROUP: u32 = 64u;

// Light by weight, and the weight.
var<workgroup> lights: array<vec4f, GROUP>;
// Inverse distance by weight.
var<workgroup> near: array<f32, GROUP>;

@compute @workgroup_size(GROUP)
fn receive_light(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = group.y * groups.x + group.x;
    let index = min(receive.first + number, arrayLength(&receivers) - 1u);
    let normal = receivers[index].normal;
    let map = map_of(number);
    // Not the bare uniform, see resolve_view.wgsl.
    let side = receive.map_side + u32(index == 0xffffffffu);
    var light = vec4f(0.0);
    var inverse = 0.0;
    let texels = 2u * side * side;
    for (var texel = local; texel < texels; texel += GROUP) {
        let cell = paraboloid_cell(texel, f32(side));
        let at = vec2f(cell.yz) + 0.5;
        let p = at / f32(side) * 2.0 - 1.0;
        let ray = paraboloid_direction(cell.x, at, f32(side));
        // Solid angle of a texel of a stereographic map, but for a factor that all have. Beyond the rim is nothing.
        let s = 1.0 + dot(p, p);
        let weight = select(0.0, max(dot(ray, normal), 0.0) / (s * s), s <= 2.0);
        if weight > 0.0 {
            let seen = node_texel(map, receive.map_shift, side, texel);
            let surfel = surfels[min(seen.x, arrayLength(&surfels) - 1u)];
            let radiance = radiance_towards(surfel, unit_from_octahedral(unpack2x16snorm(surfel.axis)), ray);
            let shines = seen.y != 0u && is_seen(radiance);
            light += vec4f(select(vec3f(0.0), radiance, shines), 1.0) * weight;
            inverse += bitcast<f32>(seen.y) * weight;
        }
    }
    lights[local] = light;
    near[local] = inverse;
    workgroupBarrier();
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        if local < half {
            lights[local] += lights[local + half];
            near[local] += near[local + half];
        }
        workgroupBarrier();
    }
    if local == 0u && number < receive.count {
        let weight = max(lights[0].w, 1e-20);
        received[index] += vec4f(finite_or_zero(lights[0].rgb / weight), near[0] / weight);
    }
}

// Program of `papers/virtual-lights/src/passes/receive.rs`: integrates the light of receivers from their maps: the cosine-weighted mean
// over the half space in front of each surface.

import package::shared::encode::{unit_from_octahedral};
import package::shared::finite::{finite_or_zero};
import package::megaviews::shared::node_maps::{map_of, node_texel};
import package::megaviews::shared::paraboloid::{paraboloid_cell, paraboloid_direction};
import package::virtual_lights::shared::receivers::{Chosen};
import package::megaviews::shared::surfel::{Surfel, is_seen, radiance_towards};

struct Receive {
    // First receiver of the batch, and number of receivers.
    first: u32,
    count: u32,
    // Base-2 logarithm of the number of maps in one array.
    map_shift: u32,
    // Texels on a side of a hemisphere.
    map_side: u32,
}

@group(0) @binding(0) var<uniform> receive: Receive;
@group(0) @binding(1) var<storage, read> receivers: array<Chosen>;
@group(0) @binding(6) var<storage, read> surfels: array<Surfel>;
// Irradiance / π; w is the mean inverse distance of the visible surfaces, 1/metres. Added to the buffer.
@group(0) @binding(2) var<storage, read_write> received: array<vec4f>;

const GROUP: u32 = 64u;

// Weighted light, and the weight.
var<workgroup> lights: array<vec4f, GROUP>;
// Weighted inverse distance.
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
    // The bound is no bare uniform: see resolve_view.wgsl.
    let side = receive.map_side + u32(index == 0xffffffffu);
    var light = vec4f(0.0);
    var inverse = 0.0;
    let texels = 2u * side * side;
    for (var texel = local; texel < texels; texel += GROUP) {
        let cell = paraboloid_cell(texel, f32(side));
        let at = vec2f(cell.yz) + 0.5;
        let p = at / f32(side) * 2.0 - 1.0;
        let ray = paraboloid_direction(cell.x, at, f32(side));
        // Solid angle of a texel of a stereographic map, up to a common factor. 0 beyond the rim.
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

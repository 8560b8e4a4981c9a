// Program of `sampler/src/passes/add_direct.rs`: adds the direct light that arrives at each sub-sample to its radiance.

import package::shared::encode::{unit_from_octahedral};
import package::shared::finite::{finite_or_zero};
import package::shared::receiver::{albedo_of, receiver_of};
import package::shared::shading::{Light, Lighting, Surface, specular_light, specular_sky};

struct AddDirect {
    // Sub-samples.
    size: vec2u,
}

@group(0) @binding(0) var<uniform> tile: AddDirect;
@group(0) @binding(1) var<uniform> lighting: Lighting;
@group(0) @binding(2) var<storage, read> lights: array<Light>;
@group(0) @binding(3) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(4) var<storage, read> g_materials: array<vec4u>;
// Irradiance / pi, and the shares of lights and sky that are seen, a byte each.
@group(0) @binding(5) var<storage, read> arriving: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> shaded: array<vec4f>;

// Whether glossy surfaces reflect lights and sky towards the eye.
override reflects_light: bool = false;

// The reflection of lights and sky towards the eye, as far as they are seen.
fn reflected(position: vec3f, normal: vec3f, material: vec4u, word: u32) -> vec3f {
    let lobe = unpack4x8unorm(material.w);
    let to_eye = -normalize(position);
    let black = vec3f(0.0);
    let surface = Surface(position, normal, black, black, lobe.rgb, lobe.a, black, normal, 0.0);
    let seen = unpack4x8unorm(word);
    let has_probe = (material.z & 0x80000000u) != 0u;
    var sum = select(specular_sky(surface, to_eye, lighting) * seen.w, black, has_probe);
    // The body comes first: without lights the array has one black light.
    var i = 0u;
    loop {
        let light = lights[i];
        sum += specular_light(surface, to_eye, light) * seen[min(light.visibility_byte, 3u)];
        i += 1u;
        // The bound is no bare uniform: see resolve_view.wgsl.
        if i >= min(lighting.light_count, arrayLength(&lights)) {
            break;
        }
    }
    return select(sum, black, all(lobe.rgb == black));
}

@compute @workgroup_size(8, 8)
fn add_direct(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= tile.size) {
        return;
    }
    let at = id.y * tile.size.x + id.x;
    let receiver = receiver_of(g_surfaces[at]);
    if !receiver.exists {
        return;
    }
    let material = g_materials[at];
    let light = arriving[at];
    var sum = albedo_of(material.x) * light.rgb;
    if reflects_light {
        sum += reflected(receiver.position, receiver.normal, material, bitcast<u32>(light.w));
    }
    shaded[at] += vec4f(finite_or_zero(sum), 0.0);
}

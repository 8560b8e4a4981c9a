// Program of `sampler/src/passes/add_reflections.rs`: adds what each sub-sample reflects of the scene, and lets through.

import package::shared::finite::{finite_or_zero};
import package::shared::receiver::{receiver_of};
import package::shared::reflection_probes::{probe_in_word, transmitted_in_word};
import package::shared::shading::{Surface, specular_of};

struct AddReflections {
    // Sub-samples.
    size: vec2u,
}

@group(0) @binding(0) var<uniform> tile: AddReflections;
@group(0) @binding(1) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(2) var<storage, read> g_materials: array<vec4u>;
// Words of reflectors: `shared/reflection_probes.wgsl`.
@group(0) @binding(3) var<storage, read> reflectors: array<u32>;
// Radiance along reflected rays, and then along refracted rays, if any surface lets light through.
@group(0) @binding(4) var<storage, read> arriving: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> shaded: array<vec4f>;

@compute @workgroup_size(8, 8)
fn add_reflections(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= tile.size) {
        return;
    }
    let at = id.y * tile.size.x + id.x;
    let receiver = receiver_of(g_surfaces[at]);
    let word = reflectors[at];
    if !receiver.exists || probe_in_word(word) == 0u {
        return;
    }
    let lobe = unpack4x8unorm(g_materials[at].w);
    let to_eye = -normalize(receiver.position);
    let black = vec3f(0.0);
    let normal = receiver.normal;
    let surface = Surface(receiver.position, normal, black, black, lobe.rgb, lobe.a, black, normal, 0.0);
    var sent = specular_of(surface, to_eye, arriving[at].rgb);
    let through = tile.size.x * tile.size.y + at;
    if through < arrayLength(&arriving) {
        let rest = 1.0 - specular_of(surface, to_eye, vec3f(1.0));
        sent += transmitted_in_word(word) * arriving[through].rgb * rest;
    }
    shaded[at] += vec4f(finite_or_zero(sent), 0.0);
}

// G-buffer: the surface of each sub-sample, for passes after shading. Zeros for sky.

import package::shared::encode::{octahedral_from_unit, rgb9e5_from_radiance};
import package::shared::shading::{Surface};

// Position relative to the eye (f32 bits), octahedral normal (2x16snorm).
@group(0) @binding(20) var<storage, read_write> g_surfaces: array<vec4u>;
// Diffuse albedo, rgb9e5; the triangle's normal on the visible side, octahedral (2x16snorm); height above the triangle at
// which rays to lights begin, metres (f32 bits), with the sign bit set where the surface takes its reflection from a probe; F0 and
// roughness (4x8unorm).
@group(0) @binding(21) var<storage, read_write> g_materials: array<vec4u>;

// If false, the program writes no G-buffer, at no cost.
override keeps_g_buffer: bool = false;

fn keep_surface(at: u32, surface: Surface, probe: u32) {
    if keeps_g_buffer {
        g_surfaces[at] = vec4u(bitcast<vec3u>(surface.position), pack2x16snorm(octahedral_from_unit(surface.normal)));
        g_materials[at] = vec4u(
            rgb9e5_from_radiance(surface.albedo),
            pack2x16snorm(octahedral_from_unit(surface.side)),
            bitcast<u32>(surface.lift) | select(0u, 0x80000000u, probe != 0u),
            pack4x8unorm(vec4f(surface.f0, surface.roughness)),
        );
    }
}

// Guides: what passes after shading need of each sub-sample's surface. Zeros where there is none.

import package::shared::encode::{octahedral_from_unit, rgb9e5_from_radiance};
import package::shared::shading::{Surface};

// Position about the eye as f32 bits, octahedral normal (2x16snorm).
@group(0) @binding(20) var<storage, read_write> guides: array<vec4u>;
// Diffuse albedo, rgb9e5.
@group(0) @binding(21) var<storage, read_write> guide_albedos: array<u32>;

// Off, a program that shades writes none and costs what it would without.
override keeps_guides: bool = false;

fn keep_guide(at: u32, surface: Surface) {
    if keeps_guides {
        guides[at] = vec4u(bitcast<vec3u>(surface.position), pack2x16snorm(octahedral_from_unit(surface.normal)));
        guide_albedos[at] = rgb9e5_from_radiance(surface.albedo);
    }
}

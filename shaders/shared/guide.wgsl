// Guides: the surface of each sub-sample, for passes after shading. Zeros for sky.

import package::shared::encode::{octahedral_from_unit, rgb9e5_from_radiance};
import package::shared::shading::{Surface};

// Position relative to the eye (f32 bits), octahedral normal (2x16snorm).
@group(0) @binding(20) var<storage, read_write> guides: array<vec4u>;
// Diffuse albedo, rgb9e5.
@group(0) @binding(21) var<storage, read_write> guide_albedos: array<u32>;

// If false, the program writes no guides, at no cost.
override keeps_guides: bool = false;

fn keep_guide(at: u32, surface: Surface) {
    if keeps_guides {
        guides[at] = vec4u(bitcast<vec3u>(surface.position), pack2x16snorm(octahedral_from_unit(surface.normal)));
        guide_albedos[at] = rgb9e5_from_radiance(surface.albedo);
    }
}

// Reads the surface of a sub-sample for passes that add indirect light. `g_buffer.wgsl` writes it.

import package::shared::encode::{unit_from_octahedral};

struct Receiver {
    // Relative to the eye, metres.
    position: vec3f,
    normal: vec3f,
    // False for sky.
    exists: bool,
}

fn receiver_of(texel: vec4u) -> Receiver {
    return Receiver(
        bitcast<vec3f>(texel.xyz), unit_from_octahedral(unpack2x16snorm(texel.w)), any(texel.xyz != vec3u(0u)),
    );
}

// Decodes an rgb9e5 albedo.
fn albedo_of(word: u32) -> vec3f {
    let scale = exp2(f32(word >> 27u) - 24.0);
    return vec3f(vec3u(word, word >> 9u, word >> 18u) & vec3u(511u)) * scale;
}

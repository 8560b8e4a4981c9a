// What passes that add indirect light know of a sub-sample's surface: its guide, as `guide.wgsl` keeps it.

import package::shared::encode::{unit_from_octahedral};

struct Receiver {
    // About the eye.
    position: vec3f,
    normal: vec3f,
    exists: bool,
}

fn receiver_of(guide: vec4u) -> Receiver {
    return Receiver(
        bitcast<vec3f>(guide.xyz), unit_from_octahedral(unpack2x16snorm(guide.w)), any(guide.xyz != vec3u(0u)),
    );
}

// Diffuse albedo from its rgb9e5 bits.
fn albedo_of(word: u32) -> vec3f {
    let scale = exp2(f32(word >> 27u) - 24.0);
    return vec3f(vec3u(word, word >> 9u, word >> 18u) & vec3u(511u)) * scale;
}

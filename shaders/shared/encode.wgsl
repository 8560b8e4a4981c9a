// Encodings of texels: octahedral normals, shared-exponent radiance, sRGB.

// Unit vector to the octahedral square -1..1 (Cigolle et al., "A Survey of Efficient Representations for
// Independent Unit Vectors", 2014).
fn octahedral_from_unit(n: vec3f) -> vec2f {
    let p = n.xy / max(abs(n.x) + abs(n.y) + abs(n.z), 1e-20);
    if n.z >= 0.0 {
        return p;
    }
    return (1.0 - abs(p.yx)) * select(vec2f(-1.0), vec2f(1.0), p >= vec2f(0.0));
}

// Inverse of octahedral_from_unit.
fn unit_from_octahedral(e: vec2f) -> vec3f {
    var n = vec3f(e, 1.0 - abs(e.x) - abs(e.y));
    if n.z < 0.0 {
        n = vec3f((1.0 - abs(n.yx)) * select(vec2f(-1.0), vec2f(1.0), n.xy >= vec2f(0.0)), n.z);
    }
    return normalize(n);
}

// Linear radiance to the bits of rgb9e5ufloat (EXT_texture_shared_exponent), negative and NaN to 0.
fn rgb9e5_from_radiance(radiance: vec3f) -> u32 {
    // max(x, 0) returns 0 for NaN on the implementations tested, but WGSL promises nothing: select does.
    let c = min(select(vec3f(0.0), radiance, radiance > vec3f(0.0)), vec3f(65408.0));
    let most = max(c.r, max(c.g, c.b));
    // Floor of log2 by exponent bits: exact, where log2 is not.
    let log = i32((bitcast<u32>(most) >> 23u) & 0xffu) - 127;
    var exponent = max(-16, log) + 16;
    let rounded = floor(most * exp2(f32(24 - exponent)) + 0.5);
    exponent += select(0, 1, rounded >= 512.0);
    let q = vec3u(floor(c * exp2(f32(24 - exponent)) + 0.5));
    return q.r | (q.g << 9u) | (q.b << 18u) | (u32(exponent) << 27u);
}

// Radiance of a word of rgb9e5.
fn radiance_from_rgb9e5(word: u32) -> vec3f {
    // Exact, unlike exp2: 2^(e − 15 − 9).
    let scale = bitcast<f32>(((word >> 27u) + 127u - 24u) << 23u);
    return vec3f((vec3u(word) >> vec3u(0u, 9u, 18u)) & vec3u(511u)) * scale;
}

// Linear 0..1 to sRGB-encoded 0..1; clamps, NaN to 0.
fn srgb_from_linear(linear: vec3f) -> vec3f {
    let x = min(select(vec3f(0.0), linear, linear > vec3f(0.0)), vec3f(1.0));
    return select(1.055 * pow(x, vec3f(1.0 / 2.4)) - 0.055, 12.92 * x, x <= vec3f(0.0031308));
}

// sRGB bytes of a radiance: exposure, clamp, sRGB, rounded to nearest; rgb in the low three bytes.
fn display_from_radiance(radiance: vec3f, exposure: f32) -> u32 {
    let byte = vec3u(floor(srgb_from_linear(radiance * exposure) * 255.0 + 0.5));
    return byte.r | (byte.g << 8u) | (byte.b << 16u);
}

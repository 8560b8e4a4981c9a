//! Colours of 32 bits with a common exponent (`rgb9e5ufloat`).

use glam::Vec3;

/// The largest number of `rgb9e5ufloat`.
pub const LARGEST: f32 = 65408.0;

/// Nearest `rgb9e5ufloat` (OES_texture_shared_exponent), clamped to its largest number.
pub fn encode(color: Vec3) -> u32 {
    let color = color.clamp(Vec3::ZERO, Vec3::splat(LARGEST)).as_dvec3();
    let largest = color.max_element();
    if !(largest > 0.0) {
        return 0;
    }
    let exponent = (largest.log2().floor() as i32).max(-16) + 16;
    let mantissa = |exponent: i32, x: f64| (x * f64::from(24 - exponent).exp2() + 0.5).floor() as u32;
    let exponent = if mantissa(exponent, largest) == 512 { exponent + 1 } else { exponent };
    let [r, g, b] = color.to_array().map(|x| mantissa(exponent, x));
    r | g << 9 | b << 18 | (exponent as u32) << 27
}

/// The colour of an `rgb9e5ufloat`.
pub fn decode(word: u32) -> Vec3 {
    // 2^(exponent − 24) as bits: from 2^−24 to 2^7.
    let scale = f32::from_bits(((word >> 27) + 127 - 24) << 23);
    let mantissa = |shift: u32| (word >> shift & 511) as f32;
    Vec3::new(mantissa(0), mantissa(9), mantissa(18)) * scale
}

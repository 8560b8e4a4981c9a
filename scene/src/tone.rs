//! The last step of every image: exposure and sRGB.

use glam::Vec3;

/// Linear 0..1 to sRGB-encoded 0..1 (IEC 61966-2-1); values outside are clamped, NaN becomes 0.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let x = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// sRGB-encoded 0..1 to linear 0..1.
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Display value of a linear radiance: exposure, clamp, sRGB, 8 bits, rounded to nearest.
pub fn display_from_radiance(radiance: Vec3, exposure: f32) -> [u8; 3] {
    let encode = |x: f32| (srgb_from_linear(x * exposure) * 255.0 + 0.5) as u8;
    [encode(radiance.x), encode(radiance.y), encode(radiance.z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_decoding_and_encoding_and_nan_is_black() {
        for byte in 0..=255u8 {
            let linear = linear_from_srgb(f32::from(byte) / 255.0);
            assert_eq!(display_from_radiance(Vec3::splat(linear), 1.0), [byte; 3]);
        }
        let odd = Vec3::new(f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
        assert_eq!(display_from_radiance(odd, 1.0), [0, 255, 0]);
    }
}

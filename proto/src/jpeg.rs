//! JPEG for browsers: colour at half resolution (4:2:0), by the crate `jpeg-encoder`.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// Encodes an sRGB image, 3 bytes per pixel, tightly packed, row 0 at the top. `quality` is 1 (smallest) to 100 (best).
///
/// Takes milliseconds: call it off async threads.
///
/// Returns `None` if a side is 0 or above 65,535, or if `rgb` does not have that many pixels.
pub fn encode(rgb: &[u8], width: u32, height: u32, quality: u8) -> Option<Vec<u8>> {
    let [columns, rows] = [width, height].map(|side| u16::try_from(side).ok().filter(|side| *side > 0));
    let (columns, rows) = (columns?, rows?);
    if rgb.len() != usize::from(columns) * usize::from(rows) * 3 {
        return None;
    }
    let mut jpeg = Vec::with_capacity(rgb.len() / 8);
    let mut encoder = Encoder::new(&mut jpeg, quality.clamp(1, 100));
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder.encode(rgb, columns, rows, ColorType::Rgb).ok()?;
    Some(jpeg)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong
mod tests {
    use image::RgbImage;

    use super::encode;

    #[test]
    fn images_of_every_size_around_a_unit_are_complete() {
        for (width, height) in
            [(1, 1), (1, 33), (7, 9), (8, 8), (15, 16), (16, 16), (17, 16), (16, 17), (31, 33), (48, 1)]
        {
            let plain = RgbImage::from_pixel(width, height, image::Rgb([200, 90, 30]));
            let jpeg = encode(&plain, width, height, 90).unwrap();
            let back =
                image::load_from_memory_with_format(&jpeg, image::ImageFormat::Jpeg).unwrap().to_rgb8();
            assert_eq!(back.dimensions(), (width, height));
            let off = back.as_raw().iter().zip(plain.as_raw()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(off <= 3, "{width} × {height}: off by {off}");
        }
    }

    #[test]
    fn invalid_images_are_refused() {
        assert!(encode(&[], 0, 0, 90).is_none());
        assert!(encode(&[0; 3], 0, 1, 90).is_none());
        assert!(encode(&[0; 11], 2, 2, 90).is_none());
        assert!(encode(&[0; 13], 2, 2, 90).is_none());
        assert!(encode(&vec![0; 65_536 * 3], 65_536, 1, 90).is_none());
        assert!(encode(&[], u32::MAX, u32::MAX, 90).is_none());
        // Qualities outside the range are clamped.
        assert_eq!(encode(&[9; 12], 2, 2, 0), encode(&[9; 12], 2, 2, 1));
        assert_eq!(encode(&[9; 12], 2, 2, 255), encode(&[9; 12], 2, 2, 100));
    }
}

//! Tests that decode with the `image` crate.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use proptest::prelude::*;

use super::encode;

/// Smooth shades, edges and a fine pattern.
fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let edge = if (x / 24 + y / 40) % 2 == 0 { 60 } else { 0 };
        let fine = ((x * 7 + y * 13) % 11) as u8;
        image::Rgb([(x / 4) as u8 % 120 + edge + fine, (y / 3) as u8 % 160 + fine, edge + 90 - fine])
    })
}

fn decoded(jpeg: &[u8]) -> RgbImage {
    image::load_from_memory_with_format(jpeg, image::ImageFormat::Jpeg).unwrap().to_rgb8()
}

/// Peak signal-to-noise ratio of the luminance, decibels.
fn psnr(a: &RgbImage, b: &RgbImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let luminance = |pixel: &image::Rgb<u8>| {
        let [r, g, b] = pixel.0.map(f64::from);
        0.299 * r + 0.587 * g + 0.114 * b
    };
    let squares: f64 = a.pixels().zip(b.pixels()).map(|(a, b)| (luminance(a) - luminance(b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 * a.pixels().len() as f64 / squares.max(1e-9)).log10()
}

#[test]
fn quality_is_close_to_that_of_another_encoder() {
    let image = picture(331, 243);
    for quality in [20, 50, 75, 90] {
        let ours = encode(&image, 331, 243, quality).unwrap();
        let mut theirs = Vec::new();
        JpegEncoder::new_with_quality(&mut theirs, quality).encode_image(&image).unwrap();
        let [our_db, their_db] = [&ours, &theirs].map(|jpeg| psnr(&image, &decoded(jpeg)));
        assert!(our_db > their_db - 1.0, "quality {quality}: {our_db} dB, another encoder {their_db} dB");
        assert!(ours.len() < theirs.len(), "quality {quality}: {} bytes, {}", ours.len(), theirs.len());
    }
}

#[test]
fn grey_images_lose_at_most_the_quantisation_error() {
    // Grey images have no half-resolution colour, and at the best quality all divisors are 1.
    let grey = RgbImage::from_fn(64, 48, |x, y| image::Rgb([((x * 37 + y * 101) % 256) as u8; 3]));
    let db = psnr(&grey, &decoded(&encode(&grey, 64, 48, 100).unwrap()));
    assert!(db > 50.0, "{db} dB");
}

#[test]
fn images_of_every_size_around_a_unit_are_complete() {
    for (width, height) in
        [(1, 1), (1, 33), (7, 9), (8, 8), (15, 16), (16, 16), (17, 16), (16, 17), (31, 33), (48, 1)]
    {
        let plain = RgbImage::from_pixel(width, height, image::Rgb([200, 90, 30]));
        let back = decoded(&encode(&plain, width, height, 90).unwrap());
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

proptest! {
    /// An image with the largest coefficients, and with bytes of ones in its codes.
    #[test]
    fn whatever_the_pixels_are_the_file_can_be_read(
        width in 1_u32..40,
        height in 1_u32..40,
        quality in 1_u8..=100,
        extreme: bool,
        seed: u32,
    ) {
        let mut state = seed | 1;
        let image = RgbImage::from_fn(width, height, |_, _| {
            image::Rgb([0; 3].map(|_: u8| {
                // Xorshift (Marsaglia 2003).
                state ^= state << 13;
                state ^= state >> 17;
                state ^= state << 5;
                if extreme { if state & 0x100 == 0 { 0 } else { 255 } } else { (state >> 8) as u8 }
            }))
        });
        let jpeg = encode(&image, width, height, quality).unwrap();
        prop_assert_eq!(decoded(&jpeg).dimensions(), (width, height));
    }
}

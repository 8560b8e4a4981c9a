//! Differences between two images: FLIP, PSNR and SSIM.
//!
//! All three compare display values (sRGB, 8 bits).
//!
//! - **FLIP** (Andersson et al. 2020, after its authors' code): the difference that a person sees who alternates
//!   between the two images, 0 to 1 per pixel, at 67 pixels per degree; here its mean.
//! - **PSNR**: 10·log₁₀(255² / mean squared difference over all channels). Identical images have +∞, which JSON
//!   cannot hold: a [`Comparison`] writes `psnr_db: null` for them, and reads null as +∞.
//! - **SSIM** (Wang et al. 2004) of the luma, Gaussian window of 11 pixels, σ = 1.5; 1 for identical images.

use std::ops::Range;

use glam::DVec3;
use image::RgbImage;
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageFloat, FlipImageRgb8};
use rayon::prelude::*;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The differences of an image from a reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Mean FLIP error: 0 identical … 1.
    pub flip_mean: f64,
    /// Peak signal to noise ratio, decibels; +∞ for identical images, as JSON null.
    #[serde(serialize_with = "null_if_infinite", deserialize_with = "infinite_if_null")]
    pub psnr_db: f64,
    /// Structural similarity of the luma: −1 … 1 identical.
    pub ssim: f64,
}

/// Why two images cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// The sizes differ, so pixels have no counterparts.
    #[error("images differ in size: {}×{} and {}×{} pixels", .0[0], .0[1], .1[0], .1[1])]
    Sizes([u32; 2], [u32; 2]),
    /// An image without pixels.
    #[error("there is nothing to compare in images of {}×{} pixels", .0[0], .0[1])]
    Empty([u32; 2]),
}

/// Compares `test` with `reference`.
///
/// # Errors
/// Images of different sizes, or without pixels.
pub fn compare(reference: &RgbImage, test: &RgbImage) -> Result<Comparison, CompareError> {
    Ok(Comparison {
        flip_mean: flip_mean(reference, test)?,
        psnr_db: psnr_db(reference, test),
        ssim: ssim(reference, test),
    })
}

/// The mean FLIP error alone.
///
/// # Errors
/// Images of different sizes, or without pixels.
pub fn flip_mean(reference: &RgbImage, test: &RgbImage) -> Result<f64, CompareError> {
    let flip = flip_errors(reference, test)?.to_vec();
    Ok(flip.iter().map(|&e| f64::from(e)).sum::<f64>() / flip.len() as f64)
}

/// Mean FLIP errors of a whole image and of its tiles.
#[derive(Debug, Clone, PartialEq)]
pub struct FlipTiles {
    /// Mean over all pixels: 0 identical … 1.
    pub mean: f64,
    /// Mean over each tile, row by row from the top left. Images of one size have the same tiles.
    pub tiles: Vec<f64>,
}

/// Mean FLIP errors of square tiles of `side` pixels (at least 1), and of the whole image.
///
/// Every tile is whole, so that no tile has only a few pixels. Where `side` does not divide the image, the last tile
/// of a row or column ends at the border and overlaps its neighbour. An image narrower or lower than a tile has one
/// tile in that direction, as wide or high as the image.
///
/// # Errors
/// Images of different sizes, or without pixels.
pub fn flip_tiles(reference: &RgbImage, test: &RgbImage, side: u32) -> Result<FlipTiles, CompareError> {
    let errors = flip_errors(reference, test)?.to_vec();
    let mean = |values: &mut dyn Iterator<Item = f32>| {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), e| (sum + f64::from(e), count + 1.0));
        sum / count
    };
    let (width, height) = (reference.width() as usize, reference.height() as usize);
    let starts = |length: usize| {
        let side = (side.max(1) as usize).min(length);
        (0..length.div_ceil(side)).map(move |i| (i * side).min(length - side)).map(move |at| at..at + side)
    };
    let tile = |rows: Range<usize>, columns: Range<usize>| {
        mean(&mut rows.flat_map(|y| &errors[y * width + columns.start..y * width + columns.end]).copied())
    };
    let tiles = starts(height).flat_map(|rows| starts(width).map(move |columns| (rows.clone(), columns)));
    Ok(FlipTiles {
        tiles: tiles.map(|(rows, columns)| tile(rows, columns)).collect(),
        mean: mean(&mut errors.iter().copied()),
    })
}

/// The FLIP error of every pixel in its authors' colours (magma: black is zero, pale yellow the largest).
///
/// # Errors
/// Images of different sizes, or without pixels.
pub fn flip_map(reference: &RgbImage, test: &RgbImage) -> Result<RgbImage, CompareError> {
    let colors = flip_errors(reference, test)?.apply_color_lut(&nv_flip::magma_lut());
    let (width, height) = reference.dimensions();
    Ok(RgbImage::from_raw(width, height, colors.to_vec()).unwrap_or_else(|| RgbImage::new(width, height)))
}

fn flip_errors(reference: &RgbImage, test: &RgbImage) -> Result<FlipImageFloat, CompareError> {
    let size = |image: &RgbImage| [image.width(), image.height()];
    if size(reference) != size(test) {
        return Err(CompareError::Sizes(size(reference), size(test)));
    }
    if size(reference).contains(&0) {
        return Err(CompareError::Empty(size(reference)));
    }
    let flip = |image: &RgbImage| FlipImageRgb8::with_data(image.width(), image.height(), image);
    Ok(nv_flip::flip(flip(reference), flip(test), DEFAULT_PIXELS_PER_DEGREE))
}

fn psnr_db(a: &RgbImage, b: &RgbImage) -> f64 {
    let squares = a.iter().zip(b.iter()).map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2));
    let sum: u64 = squares.sum();
    10.0 * (255.0_f64.powi(2) * a.len() as f64 / sum as f64).log10()
}

/// Taps on each side of a window's middle.
const REACH: usize = 5;

/// Mean over the pixels whose whole window lies in the image, as published. A smaller image is averaged over all its
/// pixels, with windows cut off at its border.
fn ssim(a: &RgbImage, b: &RgbImage) -> f64 {
    let (width, height) = (a.width() as usize, a.height() as usize);
    let (a, b) = (luma(a), luma(b));
    let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).collect::<Vec<f64>>();
    let moments = [product(&a, &a), product(&b, &b), product(&a, &b), a, b];
    let [aa, bb, ab, a, b] = moments.map(|plane| blur(&plane, width, height));
    let (c1, c2) = ((0.01_f64 * 255.0).powi(2), (0.03_f64 * 255.0).powi(2));
    let at = |i: usize| {
        let (variances, covariance) = (aa[i] - a[i] * a[i] + bb[i] - b[i] * b[i], ab[i] - a[i] * b[i]);
        let luminance = (2.0 * a[i] * b[i] + c1) / (a[i] * a[i] + b[i] * b[i] + c1);
        luminance * (2.0 * covariance + c2) / (variances + c2)
    };
    let inside = |side: usize| if side > 2 * REACH { REACH..side - REACH } else { 0..side };
    let (columns, rows) = (inside(width), inside(height));
    let count = columns.len() * rows.len();
    let sum: f64 = rows.flat_map(|y| columns.clone().map(move |x| y * width + x)).map(at).sum();
    sum / count as f64
}

/// Rec. 601 luma, 0 to 255.
fn luma(image: &RgbImage) -> Vec<f64> {
    let weights = DVec3::new(0.299, 0.587, 0.114);
    image.pixels().map(|p| DVec3::from(p.0.map(f64::from)).dot(weights)).collect()
}

/// Gaussian, σ = 1.5, rows then columns; weights beyond the border are left out and the rest scaled up.
fn blur(plane: &[f64], width: usize, height: usize) -> Vec<f64> {
    let weight = |offset: usize| (-(offset as f64).powi(2) / (2.0 * 1.5 * 1.5)).exp();
    let weights: [f64; REACH + 1] = std::array::from_fn(weight);
    let mean_around = |middle: usize, side: usize, value: &dyn Fn(usize) -> f64| {
        let (mut sum, mut total) = (0.0, 0.0);
        for i in middle.saturating_sub(REACH)..(middle + REACH + 1).min(side) {
            let w = weights[middle.abs_diff(i)];
            sum += w * value(i);
            total += w;
        }
        sum / total
    };
    let across: Vec<f64> = (0..plane.len())
        .into_par_iter()
        .map(|i| mean_around(i % width, width, &|x| plane[i - i % width + x]))
        .collect();
    (0..plane.len())
        .into_par_iter()
        .map(|i| mean_around(i / width, height, &|y| across[y * width + i % width]))
        .collect()
}

fn null_if_infinite<S: Serializer>(psnr_db: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    psnr_db.is_finite().then_some(*psnr_db).serialize(serializer)
}

fn infinite_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    fn picture(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            Rgb([(x * 37 % 256) as u8, (y * 23 % 256) as u8, ((x * y) % 200) as u8])
        })
    }

    fn changed(image: &RgbImage, by: u8) -> RgbImage {
        let mut changed = image.clone();
        changed.iter_mut().for_each(|byte| *byte = byte.saturating_add(by));
        changed
    }

    #[test]
    fn identical_images_of_any_size_have_no_difference() {
        for (width, height) in [(1, 1), (1, 9), (8, 8), (11, 11), (12, 3), (64, 48)] {
            let image = picture(width, height);
            let result = compare(&image, &image).unwrap();
            assert_eq!((result.flip_mean, result.psnr_db), (0.0, f64::INFINITY), "{width}×{height}");
            assert!((result.ssim - 1.0).abs() < 1e-9, "{width}×{height}: {}", result.ssim);
            assert_eq!(flip_map(&image, &image).unwrap().dimensions(), (width, height));
        }
    }

    #[test]
    fn every_metric_orders_a_small_and_a_large_difference() {
        for (width, height) in [(1, 1), (8, 8), (64, 48)] {
            let image = picture(width, height);
            let [small, large] = [10, 80].map(|by| compare(&image, &changed(&image, by)).unwrap());
            assert!(small.flip_mean > 0.0 && large.flip_mean > small.flip_mean, "{small:?} {large:?}");
            assert!(small.psnr_db < 40.0 && large.psnr_db < small.psnr_db, "{small:?} {large:?}");
            assert!(small.ssim < 1.0 && large.ssim < small.ssim, "{small:?} {large:?}");
        }
    }

    #[test]
    fn known_differences_have_known_values() {
        let grey = |level| RgbImage::from_pixel(16, 16, Rgb([level; 3]));
        let result = compare(&grey(100), &grey(110)).unwrap();
        assert!((result.psnr_db - 20.0 * 25.5_f64.log10()).abs() < 1e-9);
        let c1 = (0.01_f64 * 255.0).powi(2);
        let expected = (2.0 * 100.0 * 110.0 + c1) / (100.0_f64.powi(2) + 110.0_f64.powi(2) + c1);
        assert!((result.ssim - expected).abs() < 1e-9, "flat images differ in luminance alone");
        let black_white = compare(&grey(0), &grey(255)).unwrap();
        assert!(black_white.flip_mean > 0.9, "{black_white:?}");
        assert_eq!(black_white.psnr_db, 0.0);
    }

    #[test]
    fn the_map_is_bright_where_the_images_differ() {
        let image = RgbImage::from_pixel(64, 64, Rgb([128; 3]));
        let mut other = image.clone();
        for y in 40..60 {
            for x in 40..60 {
                other.put_pixel(x, y, Rgb([255, 0, 0]));
            }
        }
        let map = flip_map(&image, &other).unwrap();
        let light = |x, y| map.get_pixel(x, y).0.iter().map(|&b| u32::from(b)).sum::<u32>();
        assert!(light(50, 50) > 300 && light(5, 5) < 20, "{} {}", light(50, 50), light(5, 5));
    }

    #[test]
    fn a_difference_in_one_tile_is_found_in_that_tile() {
        let image = RgbImage::from_pixel(160, 96, Rgb([128; 3]));
        let mut other = image.clone();
        for y in 40..56 {
            for x in 104..120 {
                other.put_pixel(x, y, Rgb([255, 255, 255]));
            }
        }
        let found = flip_tiles(&image, &other, 32).unwrap();
        assert_eq!(found.tiles.len(), 5 * 3);
        let (worst, error) = found.tiles.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        assert_eq!(worst, 5 + 3, "second row, fourth column: {found:?}");
        // A quarter of that tile's pixels differ, and FLIP's filters reach a few pixels beyond.
        assert!((0.1..0.5).contains(error), "{error}");
        assert!([0, 4, 10, 14].iter().all(|&corner| found.tiles[corner] < 1e-4), "{found:?}");
        // Whole tiles that do not overlap: their mean is the image's.
        let of_tiles = found.tiles.iter().sum::<f64>() / found.tiles.len() as f64;
        assert!((of_tiles - found.mean).abs() < 1e-6, "{of_tiles} {}", found.mean);
        assert!((found.mean - flip_mean(&image, &other).unwrap()).abs() < 1e-12);
    }

    #[test]
    fn tiles_are_whole_whatever_the_size_of_the_image() {
        let tiles = |width, height, side| {
            let (image, white) = (picture(width, height), RgbImage::from_pixel(width, height, Rgb([255; 3])));
            let found = flip_tiles(&image, &white, side).unwrap();
            assert!(found.tiles.iter().all(|error| (0.0..=1.0).contains(error)), "{found:?}");
            assert!(flip_tiles(&image, &image, side).unwrap().tiles.iter().all(|error| *error == 0.0));
            found.tiles.len()
        };
        assert_eq!(tiles(64, 64, 32), 4);
        assert_eq!(tiles(65, 64, 32), 6, "the last column overlaps the one before");
        assert_eq!(tiles(20, 70, 32), 3, "as wide as the image");
        assert_eq!(tiles(1, 1, 32), 1);
        assert_eq!(tiles(3, 2, 0), 6, "no side is the least side");
        assert_eq!(tiles(9, 9, u32::MAX), 1);
        let flat = RgbImage::from_pixel(40, 33, Rgb([90; 3]));
        let mut other = flat.clone();
        (0..40).for_each(|x| other.put_pixel(x, 32, Rgb([255, 0, 0])));
        let found = flip_tiles(&flat, &other, 32).unwrap();
        assert!(found.tiles[2] < 0.2, "the last row of pixels is judged with those above it: {found:?}");
        assert!(found.tiles[2] > found.tiles[0], "{found:?}");
    }

    #[test]
    fn images_that_cannot_be_compared_are_refused_with_their_sizes() {
        let error = compare(&picture(3, 4), &picture(4, 3)).unwrap_err();
        assert_eq!(error.to_string(), "images differ in size: 3×4 and 4×3 pixels");
        assert_eq!(flip_map(&picture(0, 4), &picture(0, 4)).unwrap_err(), CompareError::Empty([0, 4]));
        assert_eq!(flip_tiles(&picture(4, 0), &picture(4, 0), 32).unwrap_err(), CompareError::Empty([4, 0]));
        let sizes = CompareError::Sizes([3, 4], [4, 3]);
        assert_eq!(flip_tiles(&picture(3, 4), &picture(4, 3), 32).unwrap_err(), sizes);
    }
}

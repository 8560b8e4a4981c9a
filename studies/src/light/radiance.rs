//! Errors of light against a path-traced reference, apart from the reference's own noise.
//!
//! A reference is two images whose noise is independent: one of the view, and one with the camera upside down, turned
//! back. The mean of (x − a)·(x − b) over pixels is then an unbiased estimate of the squared error of an image x, while
//! that of (x − a)² would count the noise of a. The same over means of 8×8 blocks, within which noise of x nearly cancels,
//! is about its *bias*.

use argus_scene::metrics::flip_mean;
use argus_scene::reference::{Indirect as Paths, ReferenceImage, Tracer, cache};
use argus_scene::tone::{display_from_radiance, linear_from_srgb};
use argus_scene::{Camera, Lighting};
use glam::Vec3;
use image::RgbImage;

/// Edge of a block in pixels.
const BLOCK: usize = 8;
/// Display-linear value from which a pixel counts as white: its radiance is not known.
const WHITE: f32 = 0.9;

/// Two independent images of a view: linear values of a display, not clipped.
pub(crate) struct Reference {
    size: [usize; 2],
    halves: [Vec<Vec3>; 2],
}

/// Errors of an image, relative to the root mean square of the reference. White pixels are left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RadianceError {
    /// Root of the mean squared error of pixels.
    pub(crate) error: f64,
    /// The same of blocks of 8×8 pixels.
    pub(crate) bias: f64,
    /// The image's mean over the reference's.
    pub(crate) energy: f64,
}

impl Reference {
    /// Renders a view, or reads it from the cache. Each half has `samples` samples a pixel, with `paths` paths each.
    pub(crate) fn render(
        tracer: &Tracer,
        lighting: &Lighting,
        camera: &Camera,
        size: [u32; 2],
        samples: u32,
        paths: Option<Paths>,
    ) -> Self {
        let folder = cache::directory();
        let half = |camera: &Camera| -> Vec<Vec3> {
            let image = cache::render_with(folder.as_deref(), tracer, camera, size, samples, paths, |_| ());
            let ReferenceImage { radiance, .. } = image;
            radiance.into_iter().map(|radiance| radiance * lighting.exposure).collect()
        };
        let upright = half(camera);
        let mut turned = half(&Camera { up: -camera.up, ..*camera });
        turned.reverse();
        Self { size: size.map(|n| n as usize), halves: [upright, turned] }
    }

    /// The mean of both halves, as a display shows it.
    pub(crate) fn display(&self) -> RgbImage {
        let [a, b] = &self.halves;
        self.displayed(a.iter().zip(b).map(|(a, b)| (*a + *b) * 0.5))
    }

    /// Mean FLIP between the halves. The noise that [`Self::display`] adds to every error is about half of it.
    pub(crate) fn noise(&self) -> f64 {
        let [a, b] = &self.halves;
        let [a, b] = [a, b].map(|half| self.displayed(half.iter().copied()));
        flip_mean(&a, &b).unwrap_or(f64::NAN)
    }

    fn displayed(&self, linear: impl Iterator<Item = Vec3>) -> RgbImage {
        let [width, height] = self.size.map(|n| n as u32);
        let bytes = linear.flat_map(|linear| display_from_radiance(linear, 1.0)).collect();
        RgbImage::from_raw(width, height, bytes).unwrap_or_else(|| RgbImage::new(width, height))
    }

    /// The errors of a displayed image of the same size.
    pub(crate) fn errors(&self, image: &RgbImage) -> RadianceError {
        let [a, b] = &self.halves;
        let linear = |pixel: &image::Rgb<u8>| {
            Vec3::from_array(pixel.0.map(|byte| linear_from_srgb(f32::from(byte) / 255.0)))
        };
        let pixels: Vec<[Vec3; 3]> =
            image.pixels().zip(a).zip(b).map(|((x, a), b)| [linear(x), *a, *b]).collect();
        let is_known =
            |[x, a, b]: &[Vec3; 3]| x.max_element() < WHITE && ((a + b) * 0.5).max_element() < WHITE;
        let [width, height] = self.size;
        let block = |number: usize| {
            let columns = width.div_ceil(BLOCK);
            let (left, top) = (number % columns * BLOCK, number / columns * BLOCK);
            let places = (top..(top + BLOCK).min(height))
                .flat_map(|y| (left..(left + BLOCK).min(width)).map(move |x| y * width + x));
            let known: Vec<&[Vec3; 3]> =
                places.filter_map(|at| pixels.get(at)).filter(|pixel| is_known(pixel)).collect();
            let sum = |which: usize| known.iter().map(|pixel| pixel[which]).sum::<Vec3>();
            (known.len() >= BLOCK * BLOCK / 4).then(|| [0, 1, 2].map(|which| sum(which) / known.len() as f32))
        };
        let blocks: Vec<[Vec3; 3]> =
            (0..width.div_ceil(BLOCK) * height.div_ceil(BLOCK)).filter_map(block).collect();
        let known: Vec<[Vec3; 3]> = pixels.iter().filter(|pixel| is_known(pixel)).copied().collect();
        let total =
            |of: fn(&[Vec3; 3]) -> Vec3| known.iter().map(|p| f64::from(of(p).element_sum())).sum::<f64>();
        RadianceError {
            error: relative(&known),
            bias: relative(&blocks),
            energy: total(|[x, _, _]| *x) / total(|[_, a, b]| (*a + *b) * 0.5),
        }
    }
}

/// Root of the mean squared error over that of the mean square, from an image and two references; NaN for none.
fn relative(values: &[[Vec3; 3]]) -> f64 {
    let sum = |of: fn(&[Vec3; 3]) -> f32| values.iter().map(|value| f64::from(of(value))).sum::<f64>();
    let off = sum(|[x, a, b]| (*x - *a).dot(*x - *b));
    let whole = sum(|[_, a, b]| a.dot(*b));
    // An estimate of a small square may be negative.
    (off.max(0.0) / whole).sqrt()
}

#[cfg(test)]
mod tests {
    use argus_scene::tone::srgb_from_linear;

    use super::*;

    /// References of one value with noise, an independent one in each half.
    fn reference(value: f32, noise: f32) -> Reference {
        let half = |seed: u32| -> Vec<Vec3> {
            let sign =
                |i: u32| ((i.wrapping_mul(0x9e37_79b9) ^ seed).wrapping_mul(0x85eb_ca6b) >> 15 & 1) as f32;
            (0..64 * 64).map(|i| Vec3::splat(value + noise * (2.0 * sign(i) - 1.0))).collect()
        };
        Reference { size: [64, 64], halves: [half(1), half(0x5bd1_e995)] }
    }

    fn image(value: impl Fn(u32, u32) -> f32) -> RgbImage {
        let byte = |value: f32| (srgb_from_linear(value) * 255.0).round() as u8;
        RgbImage::from_fn(64, 64, |x, y| image::Rgb([byte(value(x, y)); 3]))
    }

    #[test]
    fn noise_of_the_reference_is_no_error_of_the_image() {
        let found = reference(0.4, 0.3).errors(&image(|_, _| 0.4));
        assert!(found.error < 0.15 && found.bias < 0.1, "{found:?}");
        assert!((found.energy - 1.0).abs() < 0.03, "{found:?}");
        assert!(reference(0.4, 0.3).noise() > 0.1);
    }

    #[test]
    fn a_wrong_mean_is_bias_and_noise_of_the_image_is_not() {
        let wrong = reference(0.4, 0.0).errors(&image(|_, _| 0.3));
        assert!((wrong.error - 0.25).abs() < 0.01 && (wrong.bias - 0.25).abs() < 0.01, "{wrong:?}");
        let noisy = reference(0.4, 0.0).errors(&image(|x, y| if (x + y) % 2 == 0 { 0.3 } else { 0.5 }));
        assert!((noisy.error - 0.25).abs() < 0.01 && noisy.bias < 0.01, "{noisy:?}");
    }

    #[test]
    fn white_pixels_are_left_out_and_an_image_of_them_has_no_error() {
        let half_white = reference(0.4, 0.0).errors(&image(|x, _| if x < 32 { 1.0 } else { 0.4 }));
        assert!(half_white.error < 0.01, "{half_white:?}");
        assert!(reference(3.0, 0.0).errors(&image(|_, _| 1.0)).error.is_nan());
    }

    #[test]
    fn the_second_half_shows_the_same_view() {
        let scene = std::sync::Arc::new(argus_scene::procedural::terrain(2_000));
        let tracer = Tracer::new(std::sync::Arc::clone(&scene));
        let camera = scene.default_camera();
        let found = Reference::render(&tracer, &scene.lighting, &camera, [32, 24], 1, None);
        assert!(found.noise() < 1e-3, "{}", found.noise());
        let image = tracer.render(&camera, 32, 24, 1, |_| ()).display(scene.lighting.exposure);
        assert!(found.errors(&image).error < 0.01);
    }
}

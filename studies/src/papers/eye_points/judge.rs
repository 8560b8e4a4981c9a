//! What reflected rays of the f64 reference find, and how far a way is from it.

use anyhow::Result;
use argus_eye_points::ReflectivePixel;
use argus_sampler::plug::IndexMaps;
use argus_scene::metrics;
use argus_scene::reference::Hit;
use glam::{DVec2, DVec3};
use image::RgbImage;
use rayon::prelude::*;

use super::stage::{Seen, Stage};

/// Distance off a surface at which a ray starts, as a share of the distances around it.
const OFF_SURFACE: f64 = 1e-7;
/// Most surfaces of its own reflector that a ray passes.
const MOST_PASSED: u32 = 64;
/// Most texels that are examined for holes.
const EXAMINED: usize = 30_000;

/// What reflected rays meet.
pub(super) struct Truth {
    /// Where the central ray of each reflective pixel ends; `None` for the sky.
    met: Vec<Option<DVec3>>,
    /// With the mean radiance of each pixel's taps.
    image: RgbImage,
    /// Multi-view rendering at a multiple of the resolution.
    fine: Option<RgbImage>,
}

/// Errors of a way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Errors {
    /// Share of reflective pixels whose lookup is within 1° and 5% of the range.
    pub(super) right: f64,
    /// Mean FLIP of the image, and of its reflective pixels.
    pub(super) flip: f64,
    pub(super) flip_reflective: f64,
    /// Root of the mean square error of a channel over the image, of 255.
    pub(super) rmse: f64,
    /// Root of the mean square error against multi-view rendering at a multiple of the resolution, as in the paper.
    pub(super) rmse_fine: Option<f64>,
}

/// Errors of an image; `right` is not known from it.
pub(super) fn of_images(seen: &Seen, truth: &RgbImage, image: &RgbImage) -> Result<Errors> {
    let flip = metrics::flip_mean(truth, image)?;
    let pixels = f64::from(image.width()) * f64::from(image.height());
    let reflective = seen.pixels.len().max(1) as f64;
    Ok(Errors {
        right: f64::NAN,
        flip,
        flip_reflective: (flip * pixels / reflective).min(1.0),
        rmse: rmse(truth, image),
        rmse_fine: None,
    })
}

/// Root of the mean square difference of the channels of two images of a size, of 255.
fn rmse(a: &RgbImage, b: &RgbImage) -> f64 {
    let squares = a.iter().zip(b.iter()).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
    (squares.sum::<f64>() / a.len().max(1) as f64).sqrt()
}

impl Stage {
    /// The nearest surface along a ray, past those of one instance.
    pub(super) fn past(&self, origin: DVec3, direction: DVec3, own: u32) -> Option<Hit> {
        let mut from = origin;
        for _ in 0..MOST_PASSED {
            let hit = self.tracer.trace(from, direction)?;
            if hit.instance != own {
                return Some(hit);
            }
            from = hit.position + direction * (OFF_SURFACE * hit.range.max(1e-6));
        }
        None
    }

    /// A place of a surface, off it by as little as rounding allows; `eye` is where the place is seen from.
    pub(super) fn off_surface(&self, place: DVec3, normal: DVec3, eye: DVec3) -> DVec3 {
        place + normal * (OFF_SURFACE * (place - eye).length())
    }

    /// The truth for what an eye sees.
    pub(super) fn truth(&self, seen: &Seen, taps: &[DVec2]) -> Truth {
        let eye = seen.eye.position;
        let central = |pixel: &ReflectivePixel| {
            let (origin, direction) = pixel.ray(eye, DVec2::ZERO);
            let own = seen.reflectors[pixel.reflector as usize].instance;
            self.past(self.off_surface(origin, pixel.normal, eye), direction, own).map(|hit| hit.position)
        };
        let met = seen.pixels.par_iter().map(central).collect();
        let arriving = self.arriving(seen, taps, 1);
        let image = seen.image(&arriving, self.scene.lighting.exposure);
        Truth { met, image, fine: None }
    }

    /// Shares of texels that see nothing where a ray meets a surface, and that see another triangle than a ray. `facet_of` gives
    /// instance and triangle of an id. Texels are examined at even steps.
    pub(super) fn holes(
        &self,
        seen: &Seen,
        maps: &IndexMaps,
        facet_of: impl Fn(u32) -> (u32, u32) + Sync,
    ) -> [f64; 2] {
        let step = maps.texels().div_ceil(EXAMINED).max(1) | 1;
        let examined: Vec<usize> = (0..maps.texels()).step_by(step).collect();
        let judge = |&texel: &usize| {
            let (map, direction) = maps.direction_of(texel);
            let reflector = &seen.reflectors[map];
            let direction = direction.normalize();
            let begin = reflector.begin(direction);
            let met = begin.and_then(|begin| {
                self.past(reflector.center + direction * begin, direction, reflector.instance)
            });
            match (met, maps.get(texel)) {
                (Some(_), None) => [1, 0],
                (Some(hit), Some((id, _))) => [0, u32::from(facet_of(id) != (hit.instance, hit.triangle))],
                _ => [0, 0],
            }
        };
        let sums = examined.par_iter().map(judge).reduce(|| [0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
        sums.map(|sum| f64::from(sum) / examined.len().max(1) as f64)
    }
}

impl Truth {
    /// Errors of a way's image, and of where it says that central rays end.
    pub(super) fn errors(&self, seen: &Seen, image: &RgbImage, met: &[Option<DVec3>]) -> Result<Errors> {
        let rmse_fine = self.fine.as_ref().map(|fine| rmse(fine, image));
        Ok(Errors { right: self.right(seen, met), rmse_fine, ..of_images(seen, &self.image, image)? })
    }

    /// Sets the paper's reference, an image of the same size.
    pub(super) fn set_fine(&mut self, fine: RgbImage) {
        self.fine = Some(fine);
    }

    /// The paper's reference.
    pub(super) fn fine(&self) -> Option<&RgbImage> {
        self.fine.as_ref()
    }

    /// Share of reflective pixels whose central ray ends within 1° and 5% of the range of the truth.
    pub(super) fn right(&self, seen: &Seen, met: &[Option<DVec3>]) -> f64 {
        let is_right = |((pixel, truth), found): &((&ReflectivePixel, &Option<DVec3>), &Option<DVec3>)| {
            let (Some(truth), Some(found)) = (truth, found) else {
                return truth.is_none() == found.is_none();
            };
            let (truth, found) = (*truth - pixel.position, *found - pixel.position);
            let cosine = truth.normalize_or_zero().dot(found.normalize_or_zero());
            cosine >= 1f64.to_radians().cos() && (found.length() / truth.length() - 1.0).abs() <= 0.05
        };
        let right = seen.pixels.iter().zip(&self.met).zip(met).filter(is_right).count();
        right as f64 / seen.pixels.len().max(1) as f64
    }

    /// The true image.
    pub(super) fn image(&self) -> &RgbImage {
        &self.image
    }
}

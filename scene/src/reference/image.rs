//! Whole images, supersampled.

use glam::{DVec2, DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::{Indirect, Tracer};
use crate::camera::CameraRays;
use crate::tone::display_from_radiance;
use crate::{Camera, ImagePlane};

/// The exact image of a view.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear radiance, averaged over each pixel; row 0 first. Black where a lens has no ray.
    pub radiance: Vec<Vec3>,
    /// Distance from the eye to the surface on the ray through the pixel's centre, metres; +inf without a surface.
    pub range: Vec<f32>,
}

impl ReferenceImage {
    /// The image of a display: exposure, clamp, sRGB. Pass the scene's [`crate::Lighting::exposure`].
    pub fn display(&self, exposure: f32) -> RgbImage {
        let bytes = self.radiance.iter().flat_map(|&radiance| display_from_radiance(radiance, exposure));
        let bytes: Vec<u8> = bytes.collect();
        RgbImage::from_raw(self.width, self.height, bytes)
            .unwrap_or_else(|| RgbImage::new(self.width, self.height))
    }
}

/// What a view's central rays see, one value a pixel, row 0 first; zero without a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceImage {
    /// Linear diffuse albedo.
    pub albedo: Vec<Vec3>,
    /// Unit shading normal on the visible side, world space.
    pub normal: Vec<Vec3>,
}

/// The side of the regular grid of samples in a pixel: the smallest whose square is at least `samples_per_pixel`.
pub(super) fn grid_side(samples_per_pixel: u32) -> u32 {
    let root = samples_per_pixel.isqrt();
    (if root * root < samples_per_pixel { root + 1 } else { root }).max(1)
}

impl Tracer {
    /// The view of a camera that passed [`Camera::validate`], on all of rayon's threads.
    ///
    /// A pixel is the mean of the radiance along `samples_per_pixel` rays on a regular grid (1, 4, 9, 16, …; other
    /// numbers are rounded up). Textures are filtered for the spacing of that grid, not of the pixels. `progress` is
    /// called from any thread with the share of finished rows.
    pub fn render(
        &self,
        camera: &Camera,
        width: u32,
        height: u32,
        samples_per_pixel: u32,
        progress: impl Fn(f64) + Sync,
    ) -> ReferenceImage {
        self.render_with(camera, [width, height], samples_per_pixel, None, progress)
    }

    /// [`Tracer::render`] with optional indirect diffuse light, which is shadowed. Direct light is shadowed if the tracer was
    /// made by [`Tracer::with_direct_light`].
    pub fn render_with(
        &self,
        camera: &Camera,
        [width, height]: [u32; 2],
        samples_per_pixel: u32,
        indirect: Option<Indirect>,
        progress: impl Fn(f64) + Sync,
    ) -> ReferenceImage {
        let pixels = width as usize * height as usize;
        let mut radiance = vec![Vec3::ZERO; pixels];
        let mut range = vec![f32::INFINITY; pixels];
        if pixels > 0 {
            let rays = ImageRays::new(camera, width, height, grid_side(samples_per_pixel));
            let done = AtomicUsize::new(0);
            let row_of = width as usize;
            let rows = radiance.par_chunks_mut(row_of).zip(range.par_chunks_mut(row_of)).enumerate();
            rows.for_each(|(y, (radiance, range))| {
                for (x, (radiance, range)) in radiance.iter_mut().zip(range).enumerate() {
                    (*radiance, *range) = {
                        let seed = (y * row_of + x) as u64;
                        self.pixel(&rays, DVec2::new(x as f64, y as f64), indirect.map(|i| (i, seed)))
                    };
                }
                let rows_done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(rows_done as f64 / f64::from(height));
            });
        }
        ReferenceImage { width, height, radiance, range }
    }

    /// Albedo and normal of the surfaces on the central rays of a view's pixels. The camera must have passed
    /// [`Camera::validate`].
    pub fn surfaces(&self, camera: &Camera, width: u32, height: u32) -> SurfaceImage {
        let rays = ImageRays::new(camera, width, height, 1);
        let pixels = u64::from(width) * u64::from(height);
        let seen = (0..pixels).into_par_iter().map(|pixel| {
            let corner = DVec2::new((pixel % u64::from(width)) as f64, (pixel / u64::from(width)) as f64);
            let surface = rays.through(corner + 0.5).and_then(|(direction, dx, dy)| {
                self.trace(rays.eye, direction).map(|hit| self.surface(&hit, direction, dx, dy))
            });
            surface.map_or((Vec3::ZERO, Vec3::ZERO), |surface| (surface.albedo, surface.normal))
        });
        let (albedo, normal) = seen.unzip();
        SurfaceImage { albedo, normal }
    }

    /// Mean radiance, and range on the central ray, of the pixel whose top left corner is `corner`.
    fn pixel(&self, rays: &ImageRays, corner: DVec2, indirect: Option<(Indirect, u64)>) -> (Vec3, f32) {
        let mut sum = Vec3::ZERO;
        let mut range = None;
        for i in 0..rays.side * rays.side {
            let cell = DVec2::new(f64::from(i % rays.side), f64::from(i / rays.side));
            let Some((direction, dx, dy)) = rays.through(corner + (cell + 0.5) / f64::from(rays.side)) else {
                continue;
            };
            let seen = self.see(rays.eye, direction);
            for (hit, share) in seen.shares() {
                sum += self.radiance_of(hit, direction, dx, dy) * share;
                if let (Some((indirect, pixel)), Some(hit)) = (indirect, hit) {
                    let (surface, _) = self.without_transmitted(hit, &self.surface(hit, direction, dx, dy));
                    let seed = pixel << 16 | u64::from(i);
                    let by_pi = self.indirect_by_pi(hit, &surface, direction, indirect, seed);
                    sum += surface.albedo * by_pi * share;
                }
            }
            // Only a grid of odd side has a sample at the pixel's centre.
            if 2 * i + 1 == rays.side * rays.side {
                range = Some(seen.shown());
            }
        }
        let trace = || self.trace(rays.eye, rays.through(corner + 0.5)?.0);
        let central = range.unwrap_or_else(trace);
        let range = central.map_or(f32::INFINITY, |hit| hit.range as f32);
        (sum / (rays.side * rays.side) as f32, range)
    }
}

/// A camera's rays.
struct ImageRays {
    eye: DVec3,
    /// Samples along each side of a pixel.
    side: u32,
    kind: RayKind,
}

enum RayKind {
    Pinhole {
        /// From the eye to the image's top left corner, on the plane at depth 1.
        top_left: DVec3,
        /// From one pixel to the next on that plane.
        right: DVec3,
        down: DVec3,
    },
    Lens(CameraRays),
}

impl ImageRays {
    fn new(camera: &Camera, width: u32, height: u32, side: u32) -> Self {
        let kind = match camera.is_pinhole() {
            true => {
                let world_from_view = camera.view_from_world().transpose();
                let ImagePlane { half, center } = camera.plane(width, height);
                RayKind::Pinhole {
                    top_left: world_from_view * DVec3::new(center.x - half.x, half.y - center.y, -1.0),
                    right: world_from_view.x_axis * (2.0 * half.x / f64::from(width)),
                    down: world_from_view.y_axis * (-2.0 * half.y / f64::from(height)),
                }
            }
            false => RayKind::Lens(camera.rays(width, height)),
        };
        Self { eye: camera.eye, side, kind }
    }

    /// Unit direction through an image position in pixels, and the differences to the next samples to the right and
    /// below. `None` where the lens has no ray.
    fn through(&self, pixel: DVec2) -> Option<(DVec3, DVec3, DVec3)> {
        match &self.kind {
            RayKind::Pinhole { top_left, right, down } => {
                let on_plane = *top_left + *right * pixel.x + *down * pixel.y;
                let scale = on_plane.length_recip();
                let spacing = scale / f64::from(self.side);
                Some((on_plane * scale, *right * spacing, *down * spacing))
            }
            RayKind::Lens(rays) => {
                let along = rays.direction(pixel)?;
                let step = f64::from(self.side).recip();
                let next = |by: DVec2| rays.direction(pixel + by).map_or(DVec3::ZERO, |next| next - along);
                Some((along, next(DVec2::X * step), next(DVec2::Y * step)))
            }
        }
    }
}

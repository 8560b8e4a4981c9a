//! A view lit by particles, with shadows from rays or from the particles' maps.

use argus_scene::particles::Particle;
use argus_scene::reference::Tracer;
use argus_scene::tone::display_from_radiance;
use argus_scene::{Camera, paraboloid};
use glam::{DVec2, DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;

/// The surface that a pixel shows.
struct Receiver {
    position: DVec3,
    normal: DVec3,
    albedo: Vec3,
}

/// The pixels of a view, as receivers of light.
pub(super) struct Lit {
    size: [u32; 2],
    /// One per pixel; `None` for the sky.
    receivers: Vec<Option<Receiver>>,
    /// Distance in metres below which a particle's light does not increase.
    least_distance: f64,
}

/// Whether each particle lights each pixel; pixel by pixel.
pub(super) struct Visible(Vec<bool>);

/// A particle's map: inverse ranges, and the point from which it is rendered.
pub(super) struct ParticleMap {
    pub(super) texels: Vec<[u32; 2]>,
    pub(super) middle: DVec3,
}

impl Lit {
    pub(super) fn new(tracer: &Tracer, camera: &Camera, size: [u32; 2], diagonal: f64) -> Self {
        let [width, height] = size;
        let ray = |x: f64, y: f64| camera.direction(DVec2::new(x, y), width, height);
        let receiver = |pixel: u32| {
            let (x, y) = (f64::from(pixel % width) + 0.5, f64::from(pixel / width) + 0.5);
            let direction = ray(x, y);
            let hit = tracer.trace(camera.eye, direction)?;
            let (dx, dy) = (ray(x + 1.0, y) - direction, ray(x, y + 1.0) - direction);
            let surface = tracer.surface(&hit, direction, dx, dy);
            Some(Receiver {
                position: hit.position,
                normal: surface.normal.as_dvec3(),
                albedo: surface.albedo,
            })
        };
        let receivers = (0..width * height).into_par_iter().map(receiver).collect();
        Self { size, receivers, least_distance: 0.01 * diagonal }
    }

    /// Evaluates `sees` for every pixel and every particle that faces it.
    fn ask(
        &self,
        particles: &[Particle],
        sees: impl Fn(usize, &Particle, &Receiver) -> bool + Sync,
    ) -> Visible {
        let of = |receiver: &Option<Receiver>| -> Vec<bool> {
            let Some(receiver) = receiver else { return vec![false; particles.len()] };
            let faces = |p: &Particle| receiver.normal.dot(p.position - receiver.position) > 0.0;
            particles.iter().enumerate().map(|(i, p)| faces(p) && sees(i, p, receiver)).collect()
        };
        Visible(self.receivers.par_iter().flat_map_iter(of).collect())
    }

    /// No shadows: everything that faces is lit.
    pub(super) fn everything(&self, particles: &[Particle]) -> Visible {
        self.ask(particles, |_, _, _| true)
    }

    /// Shadows by rays.
    pub(super) fn by_rays(&self, particles: &[Particle], tracer: &Tracer) -> Visible {
        let off = 1e-6 * self.least_distance;
        self.ask(particles, |_, particle, receiver| {
            let origin = receiver.position + receiver.normal * off;
            let to = particle.position - origin;
            tracer.trace(origin, to).is_none_or(|hit| hit.range >= to.length())
        })
    }

    /// Shadows by one map per particle. A surface up to `slack` metres behind the map's range counts as lit, as in
    /// the lookup of `papers/virtual-lights/shaders/gather.wgsl`.
    pub(super) fn by_maps(&self, particles: &[Particle], maps: &[ParticleMap], slack: f64) -> Visible {
        self.ask(particles, |index, _, receiver| {
            let map = &maps[index];
            let side = ((map.texels.len() / 2) as f64).sqrt();
            let d = receiver.position - map.middle;
            let distance = d.length().max(1e-20);
            let texel = map.texels[paraboloid::texel_of(d, side as u32) as usize];
            let nearest = 1.0 / f64::from(f32::from_bits(texel[0])).max(1e-30);
            let width = 2.0 / side * (1.0 + d.x.abs() / distance) * distance;
            let cosine = receiver.normal.dot(d).abs() / distance;
            let slope = ((1.0 - cosine * cosine).max(0.0).sqrt() / cosine.max(1e-3)).min(4.0);
            distance <= nearest + 0.5 * width * slope.max(0.1) + slack * slope.max(1.0)
        })
    }

    /// Radiance of the pixels; each particle stands for `share` particles.
    pub(super) fn shade(&self, particles: &[Particle], visible: &Visible, share: f64) -> Vec<Vec3> {
        let pixel = |(receiver, visible): (&Option<Receiver>, &[bool])| {
            let Some(receiver) = receiver else { return Vec3::ZERO };
            let lit = particles.iter().zip(visible).filter(|(_, visible)| **visible);
            let irradiance: Vec3 = lit
                .map(|(particle, _)| {
                    let d = particle.position - receiver.position;
                    let distance = d.length().max(1e-20);
                    let cosine = receiver.normal.dot(d) / distance;
                    let spread = 4.0 * std::f64::consts::PI * distance.max(self.least_distance).powi(2);
                    particle.flux * (cosine * share / spread) as f32
                })
                .sum();
            receiver.albedo * irradiance * std::f32::consts::FRAC_1_PI
        };
        self.receivers.iter().zip(visible.0.chunks(particles.len().max(1))).map(pixel).collect()
    }

    /// Share of tests that differ from `truth`, among particles that face a pixel.
    pub(super) fn wrong(&self, particles: &[Particle], truth: &Visible, told: &Visible) -> f64 {
        let facing = self.everything(particles);
        let asked = facing.0.iter().filter(|facing| **facing).count();
        let wrong = truth.0.iter().zip(&told.0).filter(|(a, b)| a != b).count();
        wrong as f64 / asked as f64
    }

    /// The displayed image.
    pub(super) fn image(&self, radiance: &[Vec3], exposure: f32) -> RgbImage {
        let bytes: Vec<u8> = radiance.iter().flat_map(|&r| display_from_radiance(r, exposure)).collect();
        let [width, height] = self.size;
        RgbImage::from_raw(width, height, bytes).unwrap_or_else(|| RgbImage::new(width, height))
    }
}

/// The exposure that maps the geometric mean of lit pixels to middle grey.
pub(super) fn exposure(radiance: &[Vec3]) -> f32 {
    let lit = radiance.iter().map(|r| f64::from(r.element_sum()) / 3.0).filter(|l| *l > 1e-9);
    let logs: Vec<f64> = lit.map(f64::ln).collect();
    let mean = (logs.iter().sum::<f64>() / logs.len().max(1) as f64).exp();
    (0.18 / mean) as f32
}

//! Traces paths from the lights, which leave VPLs (Keller, "Instant Radiosity", 1997).
//!
//! Paths are unbiased: sources are sampled by power, flux is multiplied by albedo, and paths end by Russian roulette. A
//! VPL is the diffuse reflection at a hit.

use argus_scene::Bounds;
use argus_scene::light_sampling::{cosine_direction, disc_point};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::emitters::Emitters;
use super::sequence::Path;
use argus_sampler::plug::{PacketTracer, Surfaces};
use argus_scene::indirect::VplSettings;

/// A virtual point light: a surface point with cosine-distributed flux.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Vpl {
    /// World space, metres; slightly off its surface.
    pub(crate) position: DVec3,
    /// Unit normal of the lit side; zero for a particle, which is omnidirectional.
    pub(crate) normal: Vec3,
    /// Watts.
    pub(crate) flux: Vec3,
    /// Number of reflections so far; 0 on an emissive surface.
    pub(crate) bounces: u32,
}

/// Paths traced in parallel at a time. They are consumed in order.
const BATCH: u32 = 1024;
/// Most paths for each wanted VPL, for lights that miss the scene.
const MOST_ATTEMPTS: u32 = 16;
/// Limit of the shading-normal correction, which is unbounded otherwise.
const STEEPEST: f32 = 4.0;

/// Traces paths until there are `wanted` VPLs, or too few paths hit. Paths continue `off` metres off their surfaces.
pub(crate) fn trace(
    tracer: &PacketTracer,
    surfaces: &Surfaces,
    emitters: &Emitters,
    settings: &VplSettings,
    bounds: Bounds,
) -> Vec<Vpl> {
    if emitters.len() == 0 {
        return Vec::new();
    }
    let off = off_surface(bounds);
    let wanted = settings.vpls as usize;
    let most = settings.vpls.saturating_mul(MOST_ATTEMPTS).max(BATCH);
    let (mut vpls, mut paths) = (Vec::with_capacity(wanted), 0);
    while vpls.len() < wanted && paths < most {
        let of_batch: Vec<Vec<Vpl>> = (paths..paths + BATCH)
            .into_par_iter()
            .map(|index| follow(tracer, surfaces, emitters, settings, off, Path::new(index, settings.seed)))
            .collect();
        for of_path in of_batch {
            vpls.extend(of_path);
            paths += 1;
            if vpls.len() >= wanted {
                break;
            }
        }
    }
    // Divides the flux by the number of paths.
    let share = 1.0 / paths.max(1) as f32;
    vpls.iter_mut().for_each(|vpl| vpl.flux *= share);
    vpls
}

/// Distance off a surface at which rays start, so that they do not hit it again: more than the error of f32 corners.
/// Metres.
pub(crate) fn off_surface(bounds: Bounds) -> f64 {
    bounds.size().length() * (-22f64).exp2()
}

/// The VPLs of one path. Their flux is not yet divided by the number of paths.
fn follow(
    tracer: &PacketTracer,
    surfaces: &Surfaces,
    emitters: &Emitters,
    settings: &VplSettings,
    off: f64,
    mut path: Path,
) -> Vec<Vpl> {
    let mut vpls = Vec::new();
    let Some(emission) = emitters.sample(surfaces, &mut path) else { return vpls };
    let (mut origin, mut direction, mut flux) = (emission.origin, emission.direction, emission.flux);
    if let Some(normal) = emission.surface {
        origin += normal * off;
        vpls.push(Vpl { position: origin, normal: normal.as_vec3(), flux, bounces: 0 });
    }
    for bounce in 1..=settings.bounces {
        let Some(hit) = tracer.nearest(origin, direction, f64::INFINITY) else { break };
        let Some(point) = surfaces.hit(&hit, direction) else { break };
        if bounce == 1 {
            flux *= emission.left_at(hit.t);
        }
        let (by_shading, by_triangle) = (-direction.dot(point.normal), -direction.dot(point.side));
        // Light below either normal is not reflected. The ratio is Veach's correction for light paths ("Robust Monte
        // Carlo Methods", 1997, section 5.3).
        let correction = (by_shading.max(0.0) / by_triangle.max(1e-9)) as f32;
        let reflected = flux * point.albedo * correction.min(STEEPEST);
        if !(reflected.max_element() > 0.0 && reflected.is_finite()) {
            break;
        }
        origin += direction * hit.t + point.side * off;
        vpls.push(Vpl { position: origin, normal: point.side.as_vec3(), flux: reflected, bounces: bounce });
        // Russian roulette by albedo, so that surviving paths keep about the same flux.
        let survives = (f64::from(point.albedo.element_sum()) / 3.0).clamp(0.05, 1.0);
        if bounce == settings.bounces || path.next() >= survives {
            break;
        }
        flux = reflected / survives as f32;
        direction = cosine_direction(point.side, disc_point(DVec2::new(path.next(), path.next())));
    }
    vpls
}

/// Total flux of VPLs, watts.
pub(crate) fn total_flux(vpls: &[Vpl]) -> Vec3 {
    let sum: DVec3 = vpls.iter().map(|vpl| vpl.flux.as_dvec3()).sum();
    sum.as_vec3()
}

//! Paths from the lights, and the VPLs that they leave (Keller, "Instant Radiosity", 1997).
//!
//! Every path carries flux that is unbiased for the whole of the light: chosen by power, thinned by albedo, ended by
//! Russian roulette. A VPL is what a surface reflects of it, diffusely: its flux leaves by the cosine of the normal.

use argus_scene::Bounds;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Vpl;
use super::emitters::{Emitters, by_cosine};
use super::sequence::Path;
use super::surfaces::Surfaces;
use crate::VplKnobs;
use crate::packets::PacketTracer;

/// Paths are traced so many at a time, in parallel, and counted in order.
const BATCH: u32 = 1024;
/// Paths for each VPL that is wanted, at most: where lights miss the scene.
const MOST_ATTEMPTS: u32 = 16;
/// Shading normals far off the triangle's would let a path of light grow without bound.
const STEEPEST: f32 = 4.0;

/// Traces paths until there are as many VPLs as wanted; fewer where light hits too little. `off` metres is how far
/// off their surfaces paths continue.
pub(crate) fn trace(
    tracer: &PacketTracer,
    surfaces: &Surfaces,
    emitters: &Emitters,
    knobs: &VplKnobs,
    bounds: Bounds,
) -> Vec<Vpl> {
    if emitters.len() == 0 {
        return Vec::new();
    }
    let off = off_surface(bounds);
    let wanted = knobs.vpls as usize;
    let most = knobs.vpls.saturating_mul(MOST_ATTEMPTS).max(BATCH);
    let (mut vpls, mut paths) = (Vec::with_capacity(wanted), 0);
    while vpls.len() < wanted && paths < most {
        let of_batch: Vec<Vec<Vpl>> = (paths..paths + BATCH)
            .into_par_iter()
            .map(|index| follow(tracer, surfaces, emitters, knobs, off, Path::new(index, knobs.seed)))
            .collect();
        for of_path in of_batch {
            vpls.extend(of_path);
            paths += 1;
            if vpls.len() >= wanted {
                break;
            }
        }
    }
    // Each of them is one of so many paths.
    let share = 1.0 / paths.max(1) as f32;
    vpls.iter_mut().for_each(|vpl| vpl.flux *= share);
    vpls
}

/// How far off a surface a ray must start not to meet it again: more than the f32 corners of a hierarchy are off.
pub(crate) fn off_surface(bounds: Bounds) -> f64 {
    bounds.size().length() * (-22f64).exp2()
}

/// The VPLs of one path, for flux that is not divided by the number of paths yet.
fn follow(
    tracer: &PacketTracer,
    surfaces: &Surfaces,
    emitters: &Emitters,
    knobs: &VplKnobs,
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
    for bounce in 1..=knobs.bounces {
        let Some(met) = tracer.nearest(origin, direction, f64::INFINITY) else { break };
        let Some(point) = surfaces.met(&met, direction) else { break };
        if bounce == 1 {
            flux *= emission.left_at(met.t);
        }
        let (by_shading, by_triangle) = (-direction.dot(point.normal), -direction.dot(point.side));
        // Light that grazes below either normal is not reflected; the ratio is what Veach ("Robust Monte Carlo
        // Methods", 1997, section 5.3) corrects light paths by.
        let correction = (by_shading.max(0.0) / by_triangle.max(1e-9)) as f32;
        let reflected = flux * point.albedo * correction.min(STEEPEST);
        if !(reflected.max_element() > 0.0 && reflected.is_finite()) {
            break;
        }
        origin += direction * met.t + point.side * off;
        vpls.push(Vpl { position: origin, normal: point.side.as_vec3(), flux: reflected, bounces: bounce });
        // A path goes on as often as its surface reflects, so that those that do carry about as much as before.
        let survives = (f64::from(point.albedo.element_sum()) / 3.0).clamp(0.05, 1.0);
        if bounce == knobs.bounces || path.next() >= survives {
            break;
        }
        flux = reflected / survives as f32;
        direction = by_cosine(point.side, path.next(), path.next());
    }
    vpls
}

/// Sum of what VPLs send out, watts.
pub(crate) fn total_flux(vpls: &[Vpl]) -> Vec3 {
    let sum: DVec3 = vpls.iter().map(|vpl| vpl.flux.as_dvec3()).sum();
    sum.as_vec3()
}

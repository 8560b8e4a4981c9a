//! Rays per second of each tracer: coherent rays of an image, and incoherent rays.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use argus_gpu::Gpu;
use argus_sampler::{DeviceRayBatch, DeviceRayTimes, DeviceRays, GpuSampler, RayKind};
use argus_scene::reference::Tracer;
use argus_scene::{Bounds, Camera, RenderError, Scene, Visibility};
use glam::DVec3;
use rand::rngs::SmallRng;
use rand::{Rng as _, SeedableRng as _};
use rayon::prelude::*;

use super::measure::Measure;
use super::options::Options;
use crate::device::targets::SCATTERED_RAYS;
use crate::median::median;

pub(super) fn measure(gpu: &Arc<Gpu>, options: &Options) -> Result<Vec<Measure>> {
    let scene = Arc::new(argus_scene::open(&options.scene)?);
    let mut sampler = GpuSampler::new(Arc::clone(gpu), Arc::clone(&scene))?;
    let camera = scene.cameras.first().map_or_else(|| scene.default_camera(), |named| named.camera);
    let mut rows = Vec::new();
    let side = options.rays_side;
    for backend in Visibility::ALL {
        let (name, variant) = ("coherent rays", format!("{}, {side}x{side}", backend_name(backend)));
        let mut rates = Vec::new();
        let mut refused = None;
        // The first round also compiles pipelines.
        for round in 0..=options.rounds {
            match sampler.identify(&camera, [side; 2], 1, backend) {
                Ok((ids, took)) if round > 0 => rates.push(ids.len() as f64 / took.as_secs_f64() * 1e-6),
                Ok(_) => {}
                Err(RenderError::Invalid(why)) => {
                    refused = Some(why.to_string());
                    break;
                }
                Err(error) => return Err(error.into()),
            }
        }
        rows.push(match refused {
            Some(why) => Measure::absent(name, variant, "M/s", why),
            None => Measure::new(name, variant, median(&rates), "M/s").noting("submission included"),
        });
    }
    rows.extend(on_device(gpu, &scene, &camera, options)?);
    let rays = scattered(&scene.bounds(), options.scattered_rays);
    let tracer = Tracer::new(Arc::clone(&scene));
    let [name, _] = SCATTERED_RAYS;
    rows.push(rate(name, "tracer of light paths, all cores", options, &rays, |rays| {
        sampler.follow_rays(rays).iter().flatten().count()
    }));
    rows.push(rate(name, "reference tracer, all cores", options, &rays, |rays| {
        rays.par_iter().filter(|[origin, direction]| tracer.trace(*origin, *direction).is_some()).count()
    }));
    Ok(rows)
}

fn backend_name(backend: Visibility) -> &'static str {
    match backend {
        Visibility::Raster => "raster (fragments)",
        Visibility::Trace => "trace (compute)",
        Visibility::Cpu => "cpu (packets, all cores)",
    }
}

/// Rays of the device's tracer: uniform ones, and those that leave visible points.
fn on_device(gpu: &Arc<Gpu>, scene: &Arc<Scene>, camera: &Camera, options: &Options) -> Result<Vec<Measure>> {
    let [name, device] = SCATTERED_RAYS;
    let mut rays = match DeviceRays::new(gpu, scene) {
        Ok(rays) => rays,
        Err(error) => return Ok(vec![Measure::absent(name, device, "M/s", error.to_string())]),
    };
    let count =
        if gpu.is_software() { options.scattered_rays.min(MOST_BY_SOFTWARE) } else { options.device_rays };
    let uniform = rays.batch(&scattered(&scene.bounds(), count))?;
    let side = (count as f64).sqrt() as u32;
    let bounces = rays.seen(camera, [side; 2], RayKind::Bounce)?;
    let mut rows = vec![
        row(device, &rays, &uniform, false, options)?,
        row(&format!("{device}, bounces from visible points"), &rays, &bounces, false, options)?,
        row(&format!("{device}, any hit"), &rays, &uniform, true, options)?,
    ];
    for kind in [RayKind::Sky, RayKind::Sun, RayKind::Point] {
        let batch = rays.seen(camera, [side; 2], kind)?;
        let variant = format!("{device}, {} rays from visible points, any hit", kind.name());
        rows.push(row(&variant, &rays, &batch, true, options)?);
    }
    Ok(rows)
}

/// Most rays of a software driver.
const MOST_BY_SOFTWARE: usize = 1 << 15;

fn row(
    variant: &str,
    rays: &DeviceRays,
    batch: &DeviceRayBatch,
    ends: bool,
    options: &Options,
) -> Result<Measure> {
    let DeviceRayTimes { device_secs, secs, rays: count, hit_fraction, is_cut } =
        rays.trace(batch, ends, options.rounds)?;
    let rate = |secs: &[f64]| count as f64 / median(secs) * 1e-6;
    let whole = rate(&secs);
    let figure = if device_secs.is_empty() { whole } else { rate(&device_secs) };
    let cut = if is_cut { "; INVALID: some walks were cut off" } else { "" };
    let note = format!("{:.0}% meet a surface; {whole:.0} M/s with submission{cut}", 100.0 * hit_fraction);
    Ok(Measure::new(SCATTERED_RAYS[0], variant, figure, "M/s").noting(note))
}

fn rate(
    name: &str,
    variant: &str,
    options: &Options,
    rays: &[[DVec3; 2]],
    mut follow: impl FnMut(&[[DVec3; 2]]) -> usize,
) -> Measure {
    let mut met = follow(rays);
    let rates: Vec<f64> = (0..options.rounds)
        .map(|_| {
            let begin = Instant::now();
            met = follow(rays);
            rays.len() as f64 / begin.elapsed().as_secs_f64() * 1e-6
        })
        .collect();
    let share = 100.0 * met as f64 / rays.len().max(1) as f64;
    Measure::new(name, variant, median(&rates), "M/s").noting(format!("{share:.0}% meet a surface"))
}

/// Incoherent rays: uniform origins within the bounds and uniform directions. Equal counts give equal rays.
fn scattered(bounds: &Bounds, count: usize) -> Vec<[DVec3; 2]> {
    let mut random = SmallRng::seed_from_u64(1);
    let ray = |_| {
        let unit = |random: &mut SmallRng| DVec3::from_array(std::array::from_fn(|_| random.random::<f64>()));
        let origin = bounds.center() + bounds.size() * (unit(&mut random) - 0.5);
        // A uniform direction: a point of the cube that lies within the unit sphere, normalised.
        loop {
            let direction = unit(&mut random) * 2.0 - 1.0;
            if (1e-6..=1.0).contains(&direction.length_squared()) {
                return [origin, direction.normalize()];
            }
        }
    };
    (0..count).map(ray).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scattered_rays_are_uniform_and_repeatable() {
        let bounds = Bounds { min: DVec3::new(-1.0, 2.0, 3.0), max: DVec3::new(1.0, 2.0, 9.0) };
        let rays = scattered(&bounds, 2000);
        assert_eq!(rays, scattered(&bounds, 2000));
        let mean = rays.iter().map(|[_, direction]| *direction).sum::<DVec3>() / 2000.0;
        assert!(mean.length() < 0.1, "{mean}");
        for [origin, direction] in rays {
            assert!(origin.cmpge(bounds.min).all() && origin.cmple(bounds.max).all(), "{origin}");
            assert!((direction.length() - 1.0).abs() < 1e-12);
        }
    }
}

//! Chooses between the rays of the CPU and those of the device.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{Bounds, RenderError};
use argus_shaders::layout::sampler::ScatteredRay;
use glam::Vec3;
use rayon::prelude::*;
use tracing::{info, warn};

use super::DeviceLight;
use crate::light_rays::LightRays;
use crate::mixed::mixed;
use crate::packets::PacketTracer;
use crate::passes::{Sought, Tracing};
use crate::resident::Features;
use crate::settings::LightTracer;

/// Rays that are timed on the device, and on the CPU.
const RAYS: [usize; 2] = [1 << 17, 1 << 14];

/// The device's light if it is asked for, or if nothing is and its rays are the faster ones. A software driver's never are.
///
/// # Errors
/// Those of building it where it is asked for.
pub(in crate::light) fn chosen(
    gpu: &Arc<Gpu>,
    features: Features,
    tracer: &PacketTracer,
    rays: &LightRays,
    asked: LightTracer,
) -> Result<Option<DeviceLight>, RenderError> {
    if asked == LightTracer::Cpu || asked == LightTracer::Auto && gpu.is_software() {
        return Ok(None);
    }
    let device = DeviceLight::new(gpu, features, tracer);
    if asked == LightTracer::Device {
        return device.map(Some);
    }
    let mut device = match device {
        Err(RenderError::OutOfMemory(reason)) => {
            warn!(reason, "rays of light stay on the CPU");
            return Ok(None);
        }
        device => device?,
    };
    let [on_device, on_cpu] = rates(gpu, &device, tracer, rays)?;
    info!(on_device, on_cpu, "rays of light per millisecond");
    device.tracer.bound_by(on_device);
    Ok((on_device > on_cpu).then_some(device))
}

/// Rays per millisecond of the device, submission included, and of the CPU.
fn rates(
    gpu: &Arc<Gpu>,
    device: &DeviceLight,
    tracer: &PacketTracer,
    rays: &LightRays,
) -> Result<[f64; 2], RenderError> {
    let hierarchy = tracer.hierarchy();
    let mut bounds = Bounds::EMPTY;
    for (min, max) in hierarchy.placed.iter().map(|placed| hierarchy.world_box(placed)) {
        bounds.extend(min);
        bounds.extend(max);
    }
    let eye = bounds.center();
    let all = scattered((bounds.size() * 0.5).as_vec3());
    let usage = wgpu::BufferUsages::STORAGE;
    let buffer = gpu.upload("rays that are timed", &all, usage);
    let passed = gpu.buffer("light that passes", RAYS[0] as u64 * 4, usage);
    let placed = device.trees.about(gpu, eye)?;
    let mut on_device = f64::INFINITY;
    // The first round also compiles the program.
    for _ in 0..3 {
        let begin = Instant::now();
        let mut commands = gpu.commands("time rays of light");
        let tracing = Tracing { rays: &device.tracer, trees: &device.trees, placed: &placed };
        let sought = Sought::Passed(&passed);
        tracing.record_as("time rays", &mut commands, gpu, &buffer, RAYS[0] as u32, sought);
        commands.submit().wait()?;
        on_device = on_device.min(begin.elapsed().as_secs_f64() * 1e3);
    }
    let about = rays.about(eye);
    let begin = Instant::now();
    let light: f32 = all[..RAYS[1]]
        .par_iter()
        .with_min_len(256)
        .map(|ray| about.passed(Vec3::from_array(ray.origin), Vec3::from_array(ray.direction), ray.most))
        .sum();
    // Without it the compiler could leave the rays out.
    black_box(light);
    let on_cpu = begin.elapsed().as_secs_f64() * 1e3;
    Ok([RAYS[0] as f64 / on_device, RAYS[1] as f64 / on_cpu])
}

/// Rays in all directions within a box about zero.
fn scattered(half: Vec3) -> Vec<ScatteredRay> {
    let number = |ray: usize, k: u64| (mixed((ray as u64) << 3 | k) * 2.0 - 1.0) as f32;
    let vector = |ray: usize, k: u64| Vec3::new(number(ray, k), number(ray, k + 1), number(ray, k + 2));
    let ray = |at: usize| ScatteredRay {
        origin: (vector(at, 0) * half).to_array(),
        most: f32::MAX,
        direction: vector(at, 3).to_array(),
        flags: 0,
    };
    (0..RAYS[0]).map(ray).collect()
}

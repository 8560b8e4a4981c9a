//! Measures the tracers of the CPU and of the device on the rays that light needs, for studies.

mod device;
mod views;

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::Gpu;
use argus_scene::{Camera, RenderError, Scene};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::draws;
use crate::light_rays::{CullMode, LightRays};
use crate::packets::PacketTracer;
use crate::resident::placed;
pub use device::{DeviceRayBatch, DeviceRayTimes, DeviceRays};
pub use views::RayKind;
use views::View;

/// A tracer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayTracer {
    /// One ray at a time against eight boxes, f32.
    Wide,
    /// Packets of rays with a common origin, f32: primary rays, and point lights from the light.
    Packets,
    /// One ray at a time through the binary tree, f64.
    Single,
    /// One ray an invocation of the device, f32.
    Device,
}

impl RayTracer {
    /// The tracers of the CPU.
    pub const OF_CPU: [Self; 3] = [Self::Wide, Self::Packets, Self::Single];

    /// Its name in a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wide => "wide",
            Self::Packets => "packets",
            Self::Single => "single",
            Self::Device => "device",
        }
    }

    fn traces(self, kind: RayKind) -> bool {
        self != Self::Packets || matches!(kind, RayKind::Primary | RayKind::Point)
    }
}

/// What is measured.
#[derive(Debug, Clone)]
pub struct RayWork {
    /// Viewpoints whose pixels give the rays.
    pub cameras: Vec<Camera>,
    /// Pixels of a view.
    pub size: [u32; 2],
    /// Measured rounds, after one that is not counted. Tracers alternate within a round.
    pub rounds: usize,
}

/// What tracing one kind of rays costs.
#[derive(Debug, Clone)]
pub struct RayCost {
    /// The kind of rays.
    pub kind: RayKind,
    /// The tracer.
    pub tracer: RayTracer,
    /// Threads of the CPU; 0 for the device.
    pub threads: usize,
    /// Rays of a round.
    pub rays: usize,
    /// Share of the rays that hit something.
    pub hit_fraction: f64,
    /// Seconds of each round.
    pub secs: Vec<f64>,
}

/// Traces all kinds of rays with each tracer that supports them, on one thread and on all. Also returns the milliseconds
/// in which the trees of [`RayTracer::Wide`] were built, and their bytes.
///
/// # Errors
/// [`RenderError::OutOfMemory`] if the scene is too large for [`RayTracer::Wide`].
pub fn ray_costs(scene: &Arc<Scene>, work: &RayWork) -> Result<(Vec<RayCost>, f64, usize), RenderError> {
    let placements = placed(scene, &scene.instances);
    let tracer = PacketTracer::new(scene, &placements, draws::near(&scene.bounds()));
    let begin = Instant::now();
    let rays = LightRays::new(&tracer, CullMode::None)
        .ok_or_else(|| RenderError::OutOfMemory("too many triangles for rays of light".to_owned()))?;
    let build_ms = begin.elapsed().as_secs_f64() * 1e3;
    let views: Vec<View> =
        work.cameras.iter().map(|camera| View::new(scene, &rays, camera, work.size)).collect();
    let all = rayon::current_num_threads();
    let mut pools = Vec::new();
    for threads in if all > 1 { vec![1, all] } else { vec![1] } {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        pools.push(pool.map_err(|error| RenderError::Internal(error.to_string()))?);
    }
    let mut costs = Vec::new();
    for round in 0..=work.rounds {
        let mut at = 0;
        for pool in &pools {
            for kind in RayKind::ALL {
                for tracer_kind in RayTracer::OF_CPU.into_iter().filter(|tracer| tracer.traces(kind)) {
                    let cost = measure(pool, &rays, &tracer, &views, kind, tracer_kind);
                    if round == 0 {
                        costs.push(RayCost { secs: Vec::new(), ..cost });
                    } else {
                        costs[at].secs.extend(cost.secs);
                    }
                    at += 1;
                }
            }
        }
    }
    Ok((costs, build_ms, rays.bytes()))
}

/// Traces all kinds of rays on a device.
///
/// # Errors
/// [`RenderError::OutOfMemory`] if the scene is too large for the device; a fault of the device.
pub fn device_ray_costs(
    gpu: &Arc<Gpu>,
    scene: &Arc<Scene>,
    work: &RayWork,
) -> Result<Vec<RayCost>, RenderError> {
    let mut device = DeviceRays::new(gpu, scene)?;
    let mut costs = Vec::new();
    for kind in RayKind::ALL {
        let (mut rays, mut hits, mut secs) = (0, 0.0, vec![0.0; work.rounds]);
        for camera in &work.cameras {
            let batch = device.seen(camera, work.size, kind)?;
            let times = device.trace(&batch, kind.ends_at_any_hit(), work.rounds)?;
            rays += times.rays;
            hits += times.hit_fraction * times.rays as f64;
            let measured = if times.device_secs.is_empty() { &times.secs } else { &times.device_secs };
            secs.iter_mut().zip(measured).for_each(|(sum, secs)| *sum += secs);
        }
        let hit_fraction = hits / rays.max(1) as f64;
        costs.push(RayCost { kind, tracer: RayTracer::Device, threads: 0, rays, hit_fraction, secs });
    }
    Ok(costs)
}

fn measure(
    pool: &ThreadPool,
    rays: &LightRays,
    tracer: &PacketTracer,
    views: &[View],
    kind: RayKind,
    by: RayTracer,
) -> RayCost {
    let (mut count, mut hit, mut secs) = (0, 0, 0.0);
    for view in views {
        let batch = view.batch(kind);
        let begin = Instant::now();
        hit += pool.install(|| match by {
            RayTracer::Wide => batch.wide(&rays.about(view.eye), kind),
            RayTracer::Packets => view.packets(tracer, kind),
            RayTracer::Single => batch.single(tracer, view.eye),
            // Measured by `DeviceRays`.
            RayTracer::Device => 0,
        });
        secs += begin.elapsed().as_secs_f64();
        count += batch.directions.len();
    }
    let hit_fraction = hit as f64 / count.max(1) as f64;
    RayCost {
        kind,
        tracer: by,
        threads: pool.current_num_threads(),
        rays: count,
        hit_fraction,
        secs: vec![secs],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_tracers_are_measured_on_the_terrain_and_hit_about_as_much() {
        let scene = Arc::new(argus_scene::open("terrain:20000").unwrap());
        let cameras: Vec<Camera> = scene.cameras.iter().take(2).map(|named| named.camera).collect();
        let work = RayWork { cameras, size: [64, 48], rounds: 2 };
        let (costs, build_ms, bytes) = ray_costs(&scene, &work).unwrap();
        assert!(build_ms > 0.0 && bytes > 20_000 * 36);
        for kind in RayKind::ALL {
            let of = |tracer| costs.iter().find(|c| c.kind == kind && c.tracer == tracer);
            let wide = of(RayTracer::Wide).unwrap();
            assert!(wide.rays > 1000 && wide.secs.len() == 2 && wide.hit_fraction > 0.0, "{wide:?}");
            for other in [RayTracer::Packets, RayTracer::Single].into_iter().filter_map(of) {
                assert_eq!(other.rays, wide.rays);
                // The others pass through backs of single-sided triangles.
                assert!(other.hit_fraction <= wide.hit_fraction + 0.01, "{other:?} {wide:?}");
                assert!(other.hit_fraction >= wide.hit_fraction - 0.2, "{other:?} {wide:?}");
            }
        }
    }
}

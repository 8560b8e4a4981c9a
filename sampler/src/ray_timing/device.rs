//! Measures the tracer of a device, for studies.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_gpu::{Gpu, wgpu};
use argus_scene::{Camera, RenderError, Scene};
use argus_shaders::layout::sampler::{ScatteredHit, ScatteredRay};
use glam::DVec3;

use super::views::{Batch, RayKind, View};
use crate::draws;
use crate::light_rays::device::{DevicePlaced, DeviceTrees};
use crate::light_rays::{CullMode, LightRays};
use crate::packets::PacketTracer;
use crate::passes::{ScatteredRays, Sought, Tracing};
use crate::resident::placed;

/// Rays of the round that is not counted, by whose rate dispatches are bounded.
const FIRST_ROUND: u32 = 1 << 14;

/// Time in which a GPU traces before it is measured.
const WARM_UP: Duration = Duration::from_millis(300);

/// A scene's trees on a device.
pub struct DeviceRays {
    gpu: Arc<Gpu>,
    scene: Arc<Scene>,
    tracer: PacketTracer,
    trees: DeviceTrees,
    /// Built when views are first asked for.
    on_cpu: Option<LightRays>,
    /// Milliseconds in which the trees were built and uploaded.
    pub build_ms: f64,
}

/// Rays on a device, all about one eye.
pub struct DeviceRayBatch {
    placed: DevicePlaced,
    rays: wgpu::Buffer,
    hits: wgpu::Buffer,
    passed: wgpu::Buffer,
    count: u32,
}

/// What tracing a batch takes.
#[derive(Debug, Clone, Default)]
pub struct DeviceRayTimes {
    /// Seconds of each round by the device's clock; empty if it has none.
    pub device_secs: Vec<f64>,
    /// Seconds of each round from recording until the device is done.
    pub secs: Vec<f64>,
    /// Number of rays.
    pub rays: usize,
    /// Share of the rays that hit something; of any hits, the mean share of light that is lost.
    pub hit_fraction: f64,
    /// Whether a walk was cut off, so that results are invalid.
    pub is_cut: bool,
}

impl DeviceRays {
    /// Uploads a scene.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if it is larger than the device can bind.
    pub fn new(gpu: &Arc<Gpu>, scene: &Arc<Scene>) -> Result<Self, RenderError> {
        let tracer = PacketTracer::new(scene, &placed(scene, &scene.instances), draws::near(&scene.bounds()));
        let begin = Instant::now();
        let trees = DeviceTrees::new(gpu, &tracer)?;
        let build_ms = begin.elapsed().as_secs_f64() * 1e3;
        Ok(Self { gpu: Arc::clone(gpu), scene: Arc::clone(scene), tracer, trees, on_cpu: None, build_ms })
    }

    /// Bytes of the trees.
    pub fn bytes(&self) -> u64 {
        self.trees.bytes()
    }

    /// Uploads rays (origin, direction; world space) without an end.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they are larger than the device can bind.
    pub fn batch(&self, rays: &[[DVec3; 2]]) -> Result<DeviceRayBatch, RenderError> {
        let eye = self.scene.bounds().center();
        let origins = rays.iter().map(|[origin, _]| (*origin - eye).as_vec3()).collect();
        let directions = rays.iter().map(|[_, direction]| direction.as_vec3()).collect();
        self.upload(eye, &Batch { origins, directions, most: f32::MAX })
    }

    /// Uploads the rays of a kind from the points that a camera sees.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they or the scene are larger than the device can bind.
    pub fn seen(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        kind: RayKind,
    ) -> Result<DeviceRayBatch, RenderError> {
        let on_cpu = match self.on_cpu.take() {
            Some(rays) => rays,
            None => LightRays::new(&self.tracer, CullMode::None)
                .ok_or_else(|| RenderError::OutOfMemory("too many triangles for rays of light".to_owned()))?,
        };
        let view = View::new(&self.scene, self.on_cpu.insert(on_cpu), camera, size);
        self.upload(view.eye, view.batch(kind))
    }

    pub(super) fn upload(&self, eye: DVec3, batch: &Batch) -> Result<DeviceRayBatch, RenderError> {
        let ray = |(origin, direction): (&glam::Vec3, &glam::Vec3)| ScatteredRay {
            origin: origin.to_array(),
            most: batch.most,
            direction: direction.to_array(),
            flags: 0,
        };
        let rays: Vec<ScatteredRay> = batch.origins.iter().zip(&batch.directions).map(ray).collect();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let count = rays.len() as u64;
        Ok(DeviceRayBatch {
            placed: self.trees.about(&self.gpu, eye)?,
            rays: crate::resident::upload(&self.gpu, "scattered rays", &rays, usage)?,
            hits: self.gpu.buffer("scattered hits", count * size_of::<ScatteredHit>() as u64, usage),
            passed: self.gpu.buffer("light that passes", count * 4, usage),
            count: count as u32,
        })
    }

    /// Traces a batch in rounds, after one that is not counted. `ends`: any hit ends a ray.
    ///
    /// # Errors
    /// A fault of the device.
    pub fn trace(
        &self,
        batch: &DeviceRayBatch,
        ends: bool,
        rounds: usize,
    ) -> Result<DeviceRayTimes, RenderError> {
        let mut pass = ScatteredRays::new(&self.gpu);
        let sought = if ends { Sought::Passed(&batch.passed) } else { Sought::Nearest(&batch.hits) };
        let mut times = DeviceRayTimes { rays: batch.count as usize, ..DeviceRayTimes::default() };
        // The first compiles the pipeline, the second gives the rate.
        for _ in 0..2 {
            let count = batch.count.min(FIRST_ROUND);
            let (secs, on_device, is_cut) = self.round(&pass, batch, count, sought)?;
            pass.bound_by(f64::from(count) / (on_device.unwrap_or(secs) * 1e3).max(1e-6));
            times.is_cut |= is_cut;
        }
        // A GPU takes tenths of a second to raise its clocks.
        let begin = Instant::now();
        while begin.elapsed() < WARM_UP && !self.gpu.is_software() {
            self.round(&pass, batch, batch.count, sought)?;
        }
        for round in 0..=rounds {
            let (secs, on_device, is_cut) = self.round(&pass, batch, batch.count, sought)?;
            times.is_cut |= is_cut;
            if round > 0 {
                times.secs.push(secs);
                times.device_secs.extend(on_device);
            }
        }
        times.hit_fraction = self.hit_fraction(batch, sought)?;
        Ok(times)
    }

    /// Seconds of one round, those on the device, and whether a walk was cut off.
    fn round(
        &self,
        pass: &ScatteredRays,
        batch: &DeviceRayBatch,
        count: u32,
        sought: Sought<'_>,
    ) -> Result<(f64, Option<f64>, bool), RenderError> {
        let begin = Instant::now();
        let mut commands = self.gpu.commands("scattered rays");
        pass.clear_unfinished(&mut commands);
        let tracing = Tracing { rays: pass, trees: &self.trees, placed: &batch.placed };
        tracing.record_as("trace scattered rays", &mut commands, &self.gpu, &batch.rays, count, sought);
        let unfinished = pass.read_unfinished(&mut commands);
        let mut finished = commands.submit().wait()?;
        let secs = begin.elapsed().as_secs_f64();
        let on_device =
            self.gpu.has_timestamps().then(|| finished.stages.iter().map(|s| s.ms).sum::<f64>() * 1e-3);
        let is_cut = finished.take(unfinished).iter().any(|&byte| byte != 0);
        Ok((secs, on_device.filter(|&secs| secs > 0.0), is_cut))
    }

    fn hit_fraction(&self, batch: &DeviceRayBatch, sought: Sought<'_>) -> Result<f64, RenderError> {
        let mut commands = self.gpu.commands("read scattered rays");
        let (buffer, each) = match sought {
            Sought::Nearest(hits) => (hits, size_of::<ScatteredHit>()),
            Sought::Passed(passed) => (passed, 4),
        };
        let pending = commands.read_buffer(buffer, 0..u64::from(batch.count) * each as u64);
        let found = commands.submit().wait()?.take(pending);
        let lost = |result: &[u8]| {
            let word = u32::from_le_bytes([result[0], result[1], result[2], result[3]]);
            match sought {
                Sought::Nearest(_) => f64::from(u8::from(word != 0)),
                Sought::Passed(_) => 1.0 - f64::from(f32::from_bits(word)),
            }
        };
        let lost: f64 = found.chunks_exact(each).map(lost).sum();
        Ok(lost / f64::from(batch.count.max(1)))
    }
}

//! Reflections of direct views, deferred to what the view's own pixels see: no reflection probe is rendered for them.
//!
//! Shading leaves the surface of each reflective sub-sample and the number of its reflector. This stage finds what the
//! sub-samples reflect, shades that, and adds it. There are two ways ([`argus_scene::ProbeSource`]):
//!
//! - Rays: each reflected ray is traced. The definition is the reference's (`scene/src/reference/reflection.rs`).
//! - Points (Gavane and Watson, "Eye-Based Point Rendering for Dynamic Multiview Effects", 2022, section 4.1): the view
//!   fills indexed maps around the reflectors that it sees, looks them up, and shades each point that a lookup met once.
//!
//! # Steps of a view
//!
//! 1. With points: [`indexed`] finds the reflectors in the view and fills their maps, once.
//! 2. For each tile, [`lobes`]: the rays of what the tile's sub-samples reflect. Sharp reflections have rays of their own.
//!    Blurred ones have a ray a pixel, and neighbours share them.
//! 3. What rays meet is shaded, without what depends on the viewer (`passes/shade_points.rs`).
//! 4. `passes/add_reflections.rs` adds it, weighted by the surfaces' lobes.

mod indexed;
mod lobes;

use std::time::Instant;

use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::shading::sky_radiance;
use argus_scene::{Cancel, Lighting, ProbeSource, ReflectionProbeSet, RenderError, Scene, Stage, ViewJob};
use argus_shaders::layout::sampler::ProbePoint;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::indirect::{IndirectLight, LightSharing};
use crate::light::DirectLight;
use crate::passes::{AddReflections, Shade, ShadePoints, TileContext};
use crate::point_shading::PointShading;
use crate::probe_renderer::{ProbeBindings, probe_point};
use crate::reflected_scene::FoundBy;
use crate::resident::{GuideUse, Resident, upload};
use crate::scratch::Scratch;
use crate::{SamplerKnobs, timing};
pub(crate) use indexed::IndexedMaps;
use lobes::{Lobes, Ray};

/// Taps of a pixel into maps of points, as in the paper.
const TAPS: u32 = 25;

/// The programs that find reflections of direct views, for one scene on one device.
pub(crate) struct ViewReflections {
    pub(crate) set: ReflectionProbeSet,
    /// Instances that reflect.
    reflectors: Vec<u32>,
    /// Shades without reflections, and notes which reflector a sub-sample shows.
    pub(crate) shade: Shade,
    /// No probes, and the number of each instance's reflector.
    pub(crate) bindings: ProbeBindings,
    points: ShadePoints,
    add: AddReflections,
    scratch: Scratch,
}

/// What rays met, to be shaded.
struct Met {
    points: Vec<ProbePoint>,
    /// For each ray the index of its point; `None` for the sky.
    of_ray: Vec<Option<u32>>,
}

impl ViewReflections {
    /// The programs of a scene.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the device cannot bind a word for each instance.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        resident: &Resident,
        knobs: &SamplerKnobs,
        set: ReflectionProbeSet,
    ) -> Result<Self, RenderError> {
        let reflectors = scene.reflectors(set.knobs.most);
        let mut numbers = vec![0u32; resident.instance_count.max(1)];
        for (number, &instance) in (1..).zip(&reflectors) {
            numbers[instance as usize] = number;
        }
        let numbers = upload(gpu, "numbers of reflectors", &numbers, wgpu::BufferUsages::STORAGE)?;
        let of_points = GuideUse::of(knobs);
        Ok(Self {
            set,
            reflectors,
            shade: Shade::deferring(gpu, resident.features, of_points.at_least_kept()),
            bindings: ProbeBindings { probe_of_instance: numbers, ..ProbeBindings::none(gpu) },
            points: ShadePoints::new(gpu, resident.features, of_points),
            add: AddReflections::new(gpu),
            scratch: Scratch::default(),
        })
    }

    /// The maps of the reflectors that a view sees; `None` if reflections are traced. `ids` finds the view's visibility.
    pub(crate) fn see(
        &self,
        (by, scene): (&FoundBy, &Scene),
        (view, time_secs): (&ViewJob, f64),
        ids: impl FnOnce() -> Vec<[u32; 2]>,
    ) -> Option<IndexedMaps> {
        let (ProbeSource::Points { budget }, FoundBy::Points(points)) = (self.set.knobs.source, by) else {
            return None;
        };
        Some(IndexedMaps::new(points, scene, &self.reflectors, &ids(), (view, time_secs, budget)))
    }

    /// Finds what a tile's sub-samples reflect, and records its addition. `commands` must have shaded the tile by
    /// [`Self::shade`]. Returns the commands that later passes are recorded into.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn add(
        &mut self,
        mut commands: Commands,
        context: &TileContext<'_>,
        (by, maps): (&FoundBy, Option<&IndexedMaps>),
        (lights, lighting): ((&Option<DirectLight>, &mut Option<IndirectLight>), &Lighting),
        cancel: &Cancel,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError> {
        let (Some(guides), Some(reflectors)) = (&context.targets.guides, &context.targets.reflectors) else {
            return Ok(commands);
        };
        let [width, height] = context.tile.sub_samples();
        let count = u64::from(width) * u64::from(height);
        let pending = [(&guides.surfaces, 16), (&guides.materials, 16), (reflectors, 4)]
            .map(|(buffer, bytes)| commands.read_buffer(buffer, 0..count * bytes));
        let mut finished = commands.submit().wait()?;
        timing::add(stages, std::mem::take(&mut finished.stages));
        let begin = Instant::now();
        let [surfaces, materials, words] = pending.map(|pending| finished.take(pending));
        let taps = if maps.is_some() { TAPS.div_ceil(context.tile.side.pow(2)) } else { 1 };
        let eye = context.eye.position;
        let read = [&surfaces[..], &materials, &words];
        let lobes = Lobes::new(read, (context.tile, taps), offset_about(by, eye), &self.reflectors);
        let met = meet((by, maps), eye, &lobes.rays);
        timing::add_since(stages, "find reflections", begin);
        let gpu = context.gpu.clone();
        if lobes.rays.is_empty() {
            return Ok(gpu.commands("render colour"));
        }
        let mut shading = PointShading {
            gpu: &gpu,
            resident: context.resident,
            eye: context.eye,
            lights,
            sharing: LightSharing::Reflected,
            programs: &self.points,
            scratch: &mut self.scratch,
            cancel,
        };
        let shaded = shading.shade(&met.points, stages)?;
        let begin = Instant::now();
        let arriving: Vec<Vec3> = lobes
            .rays
            .par_iter()
            .zip(&met.of_ray)
            .with_min_len(1024)
            .map(|(ray, point)| match point {
                Some(point) => shaded[*point as usize],
                None => sky_radiance(&lighting.sky, ray.direction),
            })
            .collect();
        let words = lobes.gather(&arriving, count as usize);
        let arriving = upload(&gpu, "arriving reflections", &words, wgpu::BufferUsages::STORAGE)?;
        timing::add_since(stages, "find reflections", begin);
        let mut commands = gpu.commands("render colour");
        self.add.record(&mut commands, context, (guides, reflectors), &arriving);
        Ok(commands)
    }
}

/// How far off a surface rays begin, metres, by its place about an eye.
fn offset_about(by: &FoundBy, eye: DVec3) -> impl Fn(Vec3) -> f32 + Sync {
    let about = match by {
        FoundBy::Rays(tracer) => Some(tracer.about(eye)),
        // Lookups hit no surface.
        FoundBy::Points(_) => None,
    };
    move |position| about.as_ref().map_or(0.0, |about| about.offset(position, position.length()))
}

/// What rays meet that begin about an eye. Points are looked up in the maps of the view.
fn meet((by, maps): (&FoundBy, Option<&IndexedMaps>), eye: DVec3, rays: &[Ray]) -> Met {
    let tracer = match (by, maps) {
        (FoundBy::Points(points), Some(maps)) => return maps.meet(points, eye, rays),
        (FoundBy::Points(_), None) => return Met { points: Vec::new(), of_ray: vec![None; rays.len()] },
        (FoundBy::Rays(tracer), _) => tracer,
    };
    let along = rays.par_iter().map(|ray| (ray.start, ray.direction, ray.past));
    let met = tracer.follow(eye, along);
    let mut points = Vec::with_capacity(rays.len());
    let of_ray = met.iter().zip(rays).map(|(met, ray)| {
        let met = met.as_ref()?;
        let width = ray.width + ray.spread * met.range as f32;
        points.push(probe_point(&tracer.shading_of(met, f64::from(width)), eye));
        Some(points.len() as u32 - 1)
    });
    let of_ray = of_ray.collect();
    Met { points, of_ray }
}

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
//! 1. With points: the method that is plugged in finds the reflectors in the view and fills their maps, once.
//! 2. For each tile, [`lobes`]: the rays of what the tile's sub-samples reflect. Sharp reflections have rays of their own.
//!    Blurred ones have a ray a pixel, and neighbours share them.
//! 3. [`Bounces`]: what rays meet is shaded, without what depends on the viewer (`passes/shade_points.rs`), and rays that meet
//!    reflectors go on.
//! 4. `passes/add_reflections.rs` adds it, weighted by the surfaces' lobes.

mod lobes;
mod taps;

use std::time::Instant;

use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::{Cancel, Lighting, ProbeSource, ReflectionProbeSet, RenderError, Scene, Stage, ViewJob};

use crate::indirect::IndirectLight;
use crate::light::DirectLight;
use crate::passes::{AddReflections, Shade, ShadePoints, TileContext};
use crate::plug::ViewMaps;
use crate::point_shading::PointShading;
use crate::probe_renderer::ProbeBindings;
use crate::reflected_light::{Bounces, ReflectionSource, Reflectors, offset_about};
use crate::resident::{GuideUse, Resident, upload};
use crate::scratch::Scratch;
use crate::{SamplerKnobs, timing};
use lobes::Lobes;
pub use taps::taps;

/// Taps of a pixel into maps of points, as in the paper.
const TAPS: u32 = 25;

/// The programs that find reflections of direct views, for one scene on one device.
pub(crate) struct ViewReflections {
    pub(crate) set: ReflectionProbeSet,
    reflectors: Reflectors,
    /// Shades without reflections, and notes which reflector a sub-sample shows.
    pub(crate) shade: Shade,
    /// No probes, and the number of each instance's reflector.
    pub(crate) bindings: ProbeBindings,
    points: ShadePoints,
    add: AddReflections,
    scratch: Scratch,
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
        let reflectors = Reflectors::new(scene, set.knobs.most);
        let numbers = upload(gpu, "numbers of reflectors", &reflectors.numbers, wgpu::BufferUsages::STORAGE)?;
        let guides = GuideUse::of(knobs).at_least_kept();
        Ok(Self {
            set,
            reflectors,
            shade: Shade::deferring(gpu, resident.features, guides),
            bindings: ProbeBindings { probe_of_instance: numbers, ..ProbeBindings::none(gpu) },
            points: ShadePoints::new(gpu, resident.features, guides),
            add: AddReflections::new(gpu),
            scratch: Scratch::default(),
        })
    }

    /// The maps of the reflectors that a view sees; `None` if reflections are traced. `ids` finds the view's visibility.
    pub(crate) fn see(
        &self,
        (by, scene): (&ReflectionSource, &Scene),
        (view, time_secs): (&ViewJob, f64),
        ids: impl FnOnce() -> Vec<[u32; 2]>,
    ) -> Option<Box<dyn ViewMaps>> {
        let (ProbeSource::Points { budget }, ReflectionSource::Points(points)) = (self.set.knobs.source, by)
        else {
            return None;
        };
        let view = (view, time_secs, budget);
        Some(points.clone().maps_of_view(scene, &self.reflectors.instances, &ids(), view))
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
        (by, maps): (&ReflectionSource, Option<&dyn ViewMaps>),
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
        let lobes = Lobes::new(read, (context.tile, taps), offset_about(by, eye), &self.reflectors.instances);
        let gpu = context.gpu.clone();
        if lobes.rays.is_empty() {
            timing::add_since(stages, "find reflections", begin);
            return Ok(gpu.commands("render colour"));
        }
        let mut shading = PointShading {
            gpu: &gpu,
            resident: context.resident,
            eye: context.eye,
            lights,
            programs: &self.points,
            scratch: &mut self.scratch,
            cancel,
        };
        let (tile, sky) = (context.tile, &lighting.sky);
        let bounces = Bounces { by, maps, reflectors: &self.reflectors, sky, eye, tile };
        let mut shaded = Vec::new();
        let arriving = bounces.arriving(&lobes.rays, &mut shading, &mut shaded)?;
        let words = lobes.gather(&arriving, count as usize);
        let arriving = upload(&gpu, "arriving reflections", &words, wgpu::BufferUsages::STORAGE)?;
        let all = begin.elapsed().as_secs_f64() * 1e3;
        let rest = all - shaded.iter().map(|stage| stage.ms).sum::<f64>();
        timing::add(stages, vec![Stage::new("find reflections", rest.max(0.0))]);
        timing::add(stages, shaded);
        let mut commands = gpu.commands("render colour");
        self.add.record(&mut commands, context, (guides, reflectors), &arriving);
        Ok(commands)
    }
}

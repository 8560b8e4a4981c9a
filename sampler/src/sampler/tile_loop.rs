//! The loop over the parts of a job.

use std::time::Instant;

use argus_gpu::Submitted;
use argus_scene::{Cancel, Images, Output, Outputs, RenderError, Stage};
use bytes::Bytes;

use super::gpu_sampler::GpuSampler;
use super::ready_scene::ReadyScene;
use super::surface_programs::{ReflectionLookup, SurfacePrograms};
use crate::frame::{Frame, check_wanted};
use crate::layers::RayLayers;
use crate::ray_tile::RayTile;
use crate::scratch::{Extras, Scratch};
use crate::stages::{self, Part, PartJob, PartOutput, RenderedPart, ViewReflecting};
use crate::timing;

impl GpuSampler {
    /// Renders parts one after another. `take` gets each part once it is submitted.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`], the errors of the device, and those of `take`.
    pub(super) fn render_parts(
        &mut self,
        scene: &mut ReadyScene,
        parts: &[Part],
        output: PartOutput<'_>,
        cancel: &Cancel,
        mut take: impl FnMut(&mut Self, &mut ReadyScene, RenderedPart) -> Result<(), RenderError>,
    ) -> Result<(), RenderError> {
        for part in parts {
            check_wanted(cancel)?;
            let rendered = self.render_part(scene, part, output, cancel)?;
            take(self, scene, rendered)?;
        }
        Ok(())
    }

    /// Renders parts of an image one after another. `place` gets the pixels of each, rows tightly packed.
    ///
    /// # Errors
    /// The errors of [`GpuSampler::render_parts`].
    pub(super) fn render_image(
        &mut self,
        scene: &mut ReadyScene,
        parts: &[Part],
        output: PartOutput<'_>,
        cancel: &Cancel,
        mut place: impl FnMut(&Part, Images),
    ) -> Result<(), RenderError> {
        let mut done = parts.iter();
        self.render_parts(scene, parts, output, cancel, |sampler, scene, rendered| {
            let Some(part) = done.next() else { return Ok(()) };
            let (mut pixels, outcome) = pixels_of(rendered, &mut scene.stages)?;
            if outcome.is_some_and(|outcome| !sampler.accept_cells(&outcome)) {
                // Cells lacked. They are filled while the part is rendered again, or rays light it.
                let again = sampler.render_part(scene, part, output, cancel)?;
                (pixels, _) = pixels_of(again, &mut scene.stages)?;
            }
            place(part, pixels);
            Ok(())
        })
    }

    /// Renders one part by the list of stages.
    fn render_part(
        &mut self,
        scene: &mut ReadyScene,
        part: &Part,
        output: PartOutput<'_>,
        cancel: &Cancel,
    ) -> Result<RenderedPart, RenderError> {
        let layers = self.layers_of(part, output, scene);
        let ReadyScene { eye, backend, stages, lighting, reflections, maps, .. } = scene;
        let defers = matches!(reflections, ReflectionLookup::View(_));
        let g_buffer = self.lights.any();
        let (label, extras) = match output {
            PartOutput::Texels(_) => {
                let (gloss, reflectors) = (self.glossy, *reflections != ReflectionLookup::Nothing);
                ("render sample", Extras { gloss, reflectors, g_buffer })
            }
            PartOutput::Pixels(_) if output.is_shaded() => (
                "render colour",
                Extras { g_buffer: g_buffer || defers, reflectors: defers, ..Extras::default() },
            ),
            PartOutput::Pixels(_) => ("render range", Extras::default()),
        };
        let SurfacePrograms { of_views, reflected, .. } = &self.surface_programs;
        let reflecting = match (defers, of_views, reflected) {
            (true, Some(programs), Some(reflected)) => Some(ViewReflecting {
                programs,
                by: &reflected.found_by,
                maps: maps.as_deref(),
                lighting,
                scratch: &mut self.point_scratch,
                cancel,
            }),
            _ => None,
        };
        let context = part.context(&self.gpu, &self.resident, eye, &mut self.scratch, extras);
        let is_view = !matches!(output, PartOutput::Texels(_));
        // Only the last submission of a part is followed by nothing.
        let may_wait = is_view && layers.is_empty() && reflecting.is_none();
        let frame = Frame { is_view, may_wait, ..Frame::new(context, output.sharing(part), label, stages) };
        let mut job = PartJob {
            part,
            output,
            extras,
            layers: &layers,
            layer_scratch: &mut self.layer_scratch,
            visibility: &self.visibility,
            backend: *backend,
            programs: self.surface_programs.of(*reflections),
            reflecting,
            lights: &mut self.lights,
            exposure: lighting.exposure,
            blend: self.blend.as_ref(),
            resolve_view: &self.resolve_view,
            settings: &self.settings,
            cancel,
        };
        stages::part(frame, &mut job)
    }

    /// The layers of a part's rays: of its sub-samples, or for a sample of its texels' central rays.
    fn layers_of(&mut self, part: &Part, output: PartOutput<'_>, scene: &mut ReadyScene) -> Vec<RayLayers> {
        if !self.visibility.has_layers() {
            return Vec::new();
        }
        let begin = Instant::now();
        let eye = scene.eye.position;
        let found = match (part, output) {
            (Part::Pixels(list), _) => self.visibility.layers_of_list(&self.resident, eye, list),
            (Part::Rays(RayTile { tile, directions }), _) => {
                self.visibility.layers_of_rays(&self.resident, eye, directions, tile.sub_samples()[0])
            }
            (Part::Tile(tile), PartOutput::Texels(_)) => {
                self.visibility.layers_of_tile(&self.resident, eye, &tile.of_texels().rays())
            }
            (Part::Tile(tile), _) => self.visibility.layers_of_tile(&self.resident, eye, &tile.rays()),
        };
        timing::add_since(&mut scene.stages, "trace layers", begin);
        found
    }
}

/// A list of pixels of one of several jobs, and what is rendered of it.
pub(super) struct ListOf {
    /// Index of the job.
    pub(super) job: usize,
    pub(super) part: Part,
    pub(super) outputs: Outputs,
}

impl GpuSampler {
    /// Renders lists of pixels of several jobs beside each other: the device shades them all while the CPU finds the light of the first.
    /// The scenes are those of the jobs, at one moment and in one light, without transparent surfaces. `place` gets the pixels of each.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`], or the errors of the device.
    pub(super) fn render_lists_of(
        &mut self,
        scenes: &mut [ReadyScene],
        lists: &[ListOf],
        cancel: &Cancel,
        mut place: impl FnMut(&ListOf, Images),
    ) -> Result<(), RenderError> {
        if self.list_scratch.len() < lists.len() {
            self.list_scratch.resize_with(lists.len(), Scratch::default);
        }
        let g_buffer = self.lights.any();
        let Self { gpu, resident, surface_programs, lights, list_scratch, .. } = self;
        let mut stages: Vec<Vec<Stage>> = lists.iter().map(|_| Vec::new()).collect();
        let SurfacePrograms { of_views, reflected, .. } = &*surface_programs;
        let (layer_scratch, point_scratch) = (&mut self.layer_scratch, &mut self.point_scratch);
        let mut frames = Vec::with_capacity(lists.len());
        let mut rendered = Vec::with_capacity(lists.len());
        // A macro, because what it borrows is given back between two lists.
        macro_rules! job_of {
            ($list:expr) => {{
                let ListOf { job, part, outputs } = $list;
                let scene = &scenes[*job];
                let output = PartOutput::Pixels(*outputs);
                let defers = matches!(scene.reflections, ReflectionLookup::View(_)) && output.is_shaded();
                let extras = match output.is_shaded() {
                    true => Extras { g_buffer: g_buffer || defers, reflectors: defers, ..Extras::default() },
                    false => Extras::default(),
                };
                let reflecting = match (defers, of_views, reflected) {
                    (true, Some(programs), Some(reflected)) => Some(ViewReflecting {
                        programs,
                        by: &reflected.found_by,
                        maps: None,
                        lighting: &scene.lighting,
                        scratch: &mut *point_scratch,
                        cancel,
                    }),
                    _ => None,
                };
                PartJob {
                    part,
                    output,
                    extras,
                    layers: &[],
                    layer_scratch: &mut *layer_scratch,
                    visibility: &self.visibility,
                    backend: scene.backend,
                    programs: surface_programs.of(scene.reflections),
                    reflecting,
                    lights: &mut *lights,
                    exposure: scene.lighting.exposure,
                    blend: None,
                    resolve_view: &self.resolve_view,
                    settings: &self.settings,
                    cancel,
                }
            }};
        }
        for ((list, scratch), stages) in lists.iter().zip(list_scratch).zip(&mut stages) {
            check_wanted(cancel)?;
            let job = job_of!(list);
            let context = list.part.context(gpu, resident, &scenes[list.job].eye, scratch, job.extras);
            let sharing = job.output.sharing(&list.part);
            let mut frame = Frame { is_view: true, ..Frame::new(context, sharing, "render list", stages) };
            let begun = stages::begin_list(&mut frame, &job)?;
            frames.push((frame, begun));
        }
        for (list, (frame, begun)) in lists.iter().zip(frames) {
            check_wanted(cancel)?;
            let mut job = job_of!(list);
            rendered.push(stages::end_list(frame, &mut job, begun)?);
        }
        for ((list, rendered), mut stages) in lists.iter().zip(rendered).zip(stages) {
            let (pixels, _) = pixels_of(rendered, &mut stages)?;
            timing::add(&mut scenes[list.job].stages, stages);
            place(list, pixels);
        }
        Ok(())
    }
}

/// Waits for a part. Returns its pixels, and what it found of light cells if that is not known yet.
fn pixels_of(
    rendered: RenderedPart,
    stages: &mut Vec<Stage>,
) -> Result<(Images, Option<Bytes>), RenderError> {
    let RenderedPart { submitted, images, outcome, ranges } = rendered;
    let mut finished = submitted.wait()?;
    timing::add(stages, std::mem::take(&mut finished.stages));
    let mut images: Images =
        images.into_iter().map(|(output, image)| (output, finished.take(image))).collect();
    images[Output::Range] = images[Output::Range].take().map(|range| with_ranges(range, &ranges));
    Ok((images, outcome.map(|outcome| finished.take(outcome))))
}

/// Bytes of ranges, an f32 a pixel, with some replaced.
fn with_ranges(pixels: Bytes, ranges: &[(u32, f32)]) -> Bytes {
    if ranges.is_empty() {
        return pixels;
    }
    let mut pixels = Vec::from(pixels);
    for &(at, range) in ranges {
        if let Some(bytes) = pixels.as_chunks_mut::<4>().0.get_mut(at as usize) {
            *bytes = range.to_le_bytes();
        }
    }
    pixels.into()
}

/// Waits for submissions and adds the times of their stages.
pub(super) fn wait(submitted: &mut Vec<Submitted>, stages: &mut Vec<Stage>) -> Result<(), RenderError> {
    for submitted in submitted.drain(..) {
        timing::add(stages, submitted.wait()?.stages);
    }
    Ok(())
}

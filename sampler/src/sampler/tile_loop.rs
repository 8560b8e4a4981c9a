//! What the three render functions share: a scene made ready for a job, and the loop over the job's tiles.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Commands, Gpu, PendingReadback, Submitted, wgpu};
use argus_scene::{Cancel, LightLevel, Lighting, RenderError, Stage, Visibility};
use argus_shaders::layout::sampler::Rays;
use bytes::Bytes;
use glam::DVec3;

use super::part_shading::{Layered, PartShading};
use super::probes::ReflectionLookup;
use super::{BetweenTiles, GpuSampler};
use crate::eye::Eye;
use crate::indirect::{IndirectLight, LightSharing};
use crate::light::{CellUse, DirectLight};
use crate::passes::{PlaneBuffers, TileContext};
use crate::pixel_list::PixelList;
use crate::plug::ViewMaps;
use crate::resident::Resident;
use crate::scratch::{Extras, Scratch};
use crate::tile::Tile;
use crate::timing;
use crate::view::ViewParts;

/// What a job needs of the scene.
pub(super) struct JobScene<'a> {
    /// Centre of the camera, metres, world space.
    pub(super) position: DVec3,
    pub(super) time_secs: f64,
    /// `None` for the scene's own lighting at that time.
    pub(super) lighting: Option<&'a Lighting>,
    pub(super) light: LightLevel,
    /// Texels of an image cast one of so many of their rays of light.
    pub(super) ray_divisor: u32,
    pub(super) reflections: ReflectionLookup,
    pub(super) visibility: Visibility,
    /// What it asks of light cells, where indirect light is found by them.
    pub(super) cells: CellUse,
    /// Whether surfaces are shaded; otherwise neither indirect light nor reflections are prepared.
    pub(super) is_shaded: bool,
}

/// A scene that is ready for a job: posed, lit and uploaded about the job's camera.
pub(super) struct ReadyScene {
    begin: Instant,
    pub(super) time_secs: f64,
    pub(super) lighting: Lighting,
    light: LightLevel,
    ray_divisor: u32,
    cells: CellUse,
    pub(super) reflections: ReflectionLookup,
    /// Maps of what a view's reflectors see, if it is looked up there.
    pub(super) maps: Option<Box<dyn ViewMaps>>,
    pub(super) eye: Eye,
    pub(super) backend: Visibility,
    /// Times of the job's stages so far.
    pub(super) stages: Vec<Stage>,
}

impl ReadyScene {
    /// Times of all stages. The time that no stage accounts for is a stage of its own.
    pub(super) fn into_stages(mut self) -> Vec<Stage> {
        timing::add_rest(&mut self.stages, self.begin);
        self.stages
    }
}

/// What is rendered in one submission.
pub(super) enum Part {
    /// All pixels of a tile.
    Tile(Tile),
    /// Some pixels of a tile.
    Pixels(PixelList),
}

impl Part {
    /// Each tile as a part.
    pub(super) fn of_tiles(tiles: Vec<Tile>) -> Vec<Self> {
        tiles.into_iter().map(Self::Tile).collect()
    }

    /// The tile, or the tile that the pixels lie in.
    pub(super) fn tile(&self) -> &Tile {
        match self {
            Self::Tile(tile) => tile,
            Self::Pixels(list) => &list.tile,
        }
    }

    pub(super) fn context<'a>(
        &'a self,
        gpu: &'a Arc<Gpu>,
        resident: &'a Resident,
        eye: &'a Eye,
        scratch: &mut Scratch,
        extras: Extras,
    ) -> TileContext<'a> {
        match self {
            Self::Tile(tile) => TileContext::new(gpu, resident, eye, tile, scratch, extras),
            // The listed pixels are an image of their own, with the rays of the tile.
            Self::Pixels(list) => {
                let [width, height] = list.compact.sub_samples();
                let rays = Rays { width, height, ..list.tile.rays() };
                let rays = gpu.upload("rays", &[rays], wgpu::BufferUsages::UNIFORM);
                let places = gpu.upload("places", &list.words(), wgpu::BufferUsages::STORAGE);
                let context = TileContext::new(gpu, resident, eye, &list.compact, scratch, extras);
                TileContext { rays, places: Some(places), ..context }
            }
        }
    }
}

/// What the passes of a tile end in.
#[derive(Clone, Copy)]
pub(super) enum Output<'a> {
    /// Texels of a sample, stored in its planes.
    Texels(&'a PlaneBuffers),
    /// Three sRGB bytes a pixel.
    Color,
    /// Metres, an f32 a pixel.
    Range,
    /// Both, of one sub-sample a pixel: what the rays see is found once.
    ColorAndRange,
}

/// A part that was submitted.
pub(super) struct RenderedPart {
    pub(super) submitted: Submitted,
    color: Option<PendingReadback>,
    range: Option<PendingReadback>,
    /// Ranges of pixels that show a transparent surface: index, metres.
    ranges: Vec<(u32, f32)>,
}

impl GpuSampler {
    /// Makes the scene ready for a job: pose, indirect light, reflection probes, visibility backend, uploads.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`], or the errors of the device.
    pub(super) fn make_ready(
        &mut self,
        job: JobScene<'_>,
        cancel: &Cancel,
    ) -> Result<ReadyScene, RenderError> {
        let begin = Instant::now();
        self.check_alive()?;
        let JobScene {
            position,
            time_secs,
            lighting,
            light,
            ray_divisor,
            reflections,
            visibility,
            cells,
            is_shaded,
        } = job;
        let mut stages = self.pose(time_secs)?;
        let lighting = lighting.unwrap_or(&self.lighting).clone();
        if is_shaded {
            stages.extend(self.light(&lighting, light, time_secs)?);
            stages.extend(self.prepare_reflections(reflections, (&lighting, light), time_secs, cancel)?);
        }
        self.divide_rays(ray_divisor);
        self.begin_cells(cells);
        let eye = self.eye(position, &lighting)?;
        let backend = self.available_backend(visibility);
        let maps = None;
        Ok(ReadyScene {
            begin,
            time_secs,
            lighting,
            light,
            ray_divisor,
            cells,
            reflections,
            maps,
            eye,
            backend,
            stages,
        })
    }

    /// Renders parts one after another. `take` gets each part once it is submitted.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`], the errors of the device, and those of `take`.
    pub(super) fn render_parts(
        &mut self,
        scene: &mut ReadyScene,
        parts: &[Part],
        output: Output<'_>,
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
        output: Output<'_>,
        cancel: &Cancel,
        mut place: impl FnMut(&Part, ViewParts),
    ) -> Result<(), RenderError> {
        let mut done = parts.iter();
        self.render_parts(scene, parts, output, cancel, |_, scene, rendered| {
            let mut finished = rendered.submitted.wait()?;
            timing::add(&mut scene.stages, std::mem::take(&mut finished.stages));
            if let Some(part) = done.next() {
                let color = rendered.color.map(|color| finished.take(color));
                let range = rendered.range.map(|range| with_ranges(finished.take(range), &rendered.ranges));
                place(part, ViewParts { color, range });
            }
            Ok(())
        })
    }

    /// Renders one part: what it sees, the shading of that, the resolve.
    fn render_part(
        &mut self,
        scene: &mut ReadyScene,
        part: &Part,
        output: Output<'_>,
        cancel: &Cancel,
    ) -> Result<RenderedPart, RenderError> {
        let layers = self.layers_of(part, output, scene);
        let ReadyScene { eye, backend, stages, lighting, reflections, maps, .. } = scene;
        let defers = matches!(reflections, ReflectionLookup::View(_));
        let (label, extras) = match output {
            Output::Texels(_) => {
                let (gloss, reflectors) = (self.glossy, *reflections != ReflectionLookup::Nothing);
                ("render sample", Extras { gloss, reflectors, guides: self.keeps_guides() })
            }
            Output::Color | Output::ColorAndRange => {
                let guides = self.keeps_guides() || defers;
                ("render colour", Extras { guides, reflectors: defers, ..Extras::default() })
            }
            Output::Range => ("render range", Extras::default()),
        };
        let mut commands = self.gpu.commands(label);
        let texels;
        let arriving;
        let context = part.context(&self.gpu, &self.resident, eye, &mut self.scratch, extras);
        let sharing = match part {
            Part::Tile(_) => {
                self.visibility.record(&mut commands, &context, *backend, stages)?;
                LightSharing::Image
            }
            Part::Pixels(list) => {
                self.visibility.record_list(&context, list, stages)?;
                LightSharing::Pixels
            }
        };
        let mut shading = PartShading {
            programs: &mut self.surface_programs,
            lights: (&self.direct, &mut self.indirect),
            lighting,
            reflections: *reflections,
            maps: maps.as_deref(),
            blend: self.blend.as_ref(),
            cancel,
        };
        let over = Layered { layers: &layers, scratch: &mut self.layer_scratch, extras };
        let (mut color, mut range) = (None, None);
        match output {
            Output::Texels(planes) => {
                let sharing = LightSharing::Texels { side: context.tile.side };
                texels = context.tile.of_texels();
                let context = context.of_texels(&texels);
                (commands, arriving) = shading.texels(commands, &context, sharing, stages)?;
                commands =
                    shading.blend(commands, (part, sharing), (&context, arriving.as_ref()), over, stages)?;
                let resolve = self.surface_programs.of(*reflections).resolve;
                resolve.record(&mut commands, &context, &self.knobs, planes, arriving.as_ref());
            }
            Output::Color | Output::ColorAndRange => {
                commands = shading.view(commands, &context, sharing, stages)?;
                commands = shading.blend(commands, (part, sharing), (&context, None), over, stages)?;
                color = Some(self.resolve_view.record_color(&mut commands, &context, lighting.exposure));
                if matches!(output, Output::ColorAndRange) {
                    range = Some(self.resolve_view.record_range(&mut commands, &context));
                }
            }
            Output::Range => range = Some(self.resolve_view.record_range(&mut commands, &context)),
        }
        let ranges = match range {
            Some(_) => layers.iter().filter_map(|ray| Some((ray.at, ray.shown()?.1 as f32))).collect(),
            None => Vec::new(),
        };
        Ok(RenderedPart { submitted: commands.submit(), color, range, ranges })
    }

    /// Runs other work between two parts of a job. Its time is none of the job's.
    ///
    /// # Errors
    /// The errors of the device.
    pub(super) fn run_between(
        &mut self,
        scene: &mut ReadyScene,
        between: BetweenTiles<'_>,
        done: f64,
    ) -> Result<(), RenderError> {
        let began = Instant::now();
        between(self, done);
        if self.animated {
            // The other work may have posed the scene at another time.
            self.pose(scene.time_secs)?;
            scene.eye = self.eye(scene.eye.position, &scene.lighting)?;
        }
        // It may also have shown another level of light.
        self.light(&scene.lighting, scene.light, scene.time_secs)?;
        self.divide_rays(scene.ray_divisor);
        self.begin_cells(scene.cells);
        scene.begin += began.elapsed();
        Ok(())
    }
}

/// Adds a tile's direct light by rays and its indirect light, as far as there are any. `is_view` adds what glossy surfaces
/// reflect of lights and sky, too. Returns the commands that later passes are recorded into, and the direct light.
pub(crate) fn add_light(
    (direct, indirect): (&Option<DirectLight>, &mut Option<IndirectLight>),
    mut commands: Commands,
    context: &TileContext<'_>,
    (sharing, is_view): (LightSharing, bool),
    stages: &mut Vec<Stage>,
) -> Result<(Commands, Option<wgpu::Buffer>), RenderError> {
    let mut arriving = None;
    if let Some(light) = direct {
        let neighbours = sharing.neighbours(context.tile);
        (commands, arriving) = {
            let paths = indirect.as_ref().and_then(IndirectLight::paths);
            // The level of light cells follows from pixels. Points of reflections and of octrees are seen from elsewhere.
            let uses_cells = is_view || matches!(sharing, LightSharing::Texels { .. });
            light.add(commands, context, neighbours, (paths, uses_cells, is_view), stages)?
        };
    }
    if let Some(light) = indirect {
        commands = light.add(commands, context, sharing, stages)?;
    }
    Ok((commands, arriving))
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

/// Fails once a job is cancelled.
pub(crate) fn check_wanted(cancel: &Cancel) -> Result<(), RenderError> {
    if cancel.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(()) }
}

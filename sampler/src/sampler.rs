//! The frame, top to bottom.

mod mapped;
mod mirrored;
mod rays;

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_gpu::{Commands, Gpu, GpuError, Submitted, wgpu};
use argus_scene::{
    Camera, Cancel, Frame, InvalidField, Lighting, PixelJob, Pixels, Plan, Plane, PlaneData, RenderError,
    Sample, SampleCamera, SampleId, SampleJob, SampleSetInfo, Sampler, Sampling, Scene, Specification, Stage,
    ViewJob, Visibility,
};
use argus_shaders::layout::sampler::Rays;
use glam::DVec3;
use tracing::warn;

use self::mirrored::{Look, Looks};
use crate::eye::Eye;
use crate::indirect::{IndirectLight, Spreading, ToLight};
use crate::omni_maps::OmniMaps;
use crate::passes::{PlaneBuffers, ResolveView, TileContext};
use crate::pixels::{Listing, listings};
use crate::plan::{PassPlan, plan};
use crate::point_based::PointReport;
use crate::radiosity::IndirectReport;
use crate::resident::Resident;
use crate::scratch::{Extras, Scratch};
use crate::seeing::Seeing;
use crate::tile::{Tile, tiles};
use crate::view::{Image, ViewParts, frame, grid_side};
use crate::{Indirect, SamplerKnobs, timing};

/// Sub-samples of a part of a sample whose rays the CPU follows: some 20 ms of a core, with their shading by a software
/// driver.
const PART: u32 = 1 << 16;

/// What others do with the sampler between two parts of a sample that nobody waits for.
type GiveWay<'a> = &'a mut dyn FnMut(&mut dyn Sampler);

/// Renders a scene from its triangles, on one device.
///
/// The scene is uploaded when this is made. Samples and views need only what depends on their cameras, and the
/// places of instances where their epoch is another than the last one's. After a loss of the device every render
/// fails with [`RenderError::DeviceLost`]; make another one, on another [`Gpu`].
pub struct GpuSampler {
    gpu: Arc<Gpu>,
    scene: Arc<Scene>,
    knobs: SamplerKnobs,
    glossy: bool,
    animated: bool,
    /// What depends on time, as it is at `posed_secs`.
    lighting: Lighting,
    posed_secs: f64,
    resident: Resident,
    seeing: Seeing,
    looks: Looks,
    resolve_view: ResolveView,
    scratch: Scratch,
    /// Light from surface to surface, made when it is first needed.
    indirect: Option<IndirectLight>,
    /// Maps of an octree, made when samples are first to come from them.
    maps: Option<OmniMaps>,
}

impl GpuSampler {
    /// Uploads a scene and makes the pipelines that it calls for.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if a part of the scene is larger than the device can bind,
    /// [`RenderError::Internal`] if the device cannot number triangles.
    pub fn new(gpu: Arc<Gpu>, scene: Arc<Scene>) -> Result<Self, RenderError> {
        Self::with_knobs(gpu, scene, SamplerKnobs::default())
    }

    /// Makes a sampler with these knobs.
    ///
    /// # Errors
    /// As [`Self::new`], and [`RenderError::Invalid`] for a knob that is out of range.
    pub fn with_knobs(gpu: Arc<Gpu>, scene: Arc<Scene>, knobs: SamplerKnobs) -> Result<Self, RenderError> {
        knobs.validate()?;
        if !gpu.device.features().contains(wgpu::Features::PRIMITIVE_INDEX) {
            let message = format!("{} does not number triangles in fragments", gpu.kind());
            return Err(RenderError::Internal(message));
        }
        let resident = Resident::new(&gpu, &scene)?;
        let glossy = resident.features.specular;
        Ok(Self {
            seeing: Seeing::new(&gpu, &scene, &resident),
            looks: Looks::new(&gpu, &resident, &knobs),
            indirect: None,
            maps: None,
            resolve_view: ResolveView::new(&gpu),
            scratch: Scratch::default(),
            animated: scene.is_animated(),
            lighting: scene.at(0.0).lighting,
            posed_secs: 0.0,
            gpu,
            scene,
            knobs,
            glossy,
            resident,
        })
    }

    /// What it was made with.
    pub fn knobs(&self) -> &SamplerKnobs {
        &self.knobs
    }

    /// Which passes this scene calls for, and why.
    pub fn plan(&self) -> Vec<PassPlan> {
        plan(&self.scene, &self.resident, &self.knobs)
    }

    /// The samples of a job; with `give_way`, others get a turn between parts of them.
    fn render_set(
        &mut self,
        job: &SampleJob,
        cancel: &Cancel,
        mut give_way: Option<GiveWay<'_>>,
    ) -> Vec<Result<Sample, RenderError>> {
        let (around, of_rig): (Vec<_>, Vec<_>) = job.ids.iter().copied().partition(SampleId::is_surroundings);
        let job_of_rig = SampleJob { ids: of_rig, ..job.clone() };
        let of_rig = match job.info.sampling {
            Sampling::Triangles => {
                job_of_rig.ids.iter().map(|&id| self.render_sample(job, id, cancel, &mut give_way)).collect()
            }
            Sampling::MegaViews(knobs) => self.render_mapped(&job_of_rig, knobs, cancel),
        };
        let around: Vec<_> = around.into_iter().map(|id| self.render_surroundings(job, id, cancel)).collect();
        // In the order that they were asked for.
        let (mut of_rig, mut around) = (of_rig.into_iter(), around.into_iter());
        let missing = || Err(RenderError::Internal("a sample was neither rendered nor refused".to_owned()));
        let next = |id: &SampleId| if id.is_surroundings() { around.next() } else { of_rig.next() };
        job.ids.iter().map(next).map(|sample| sample.unwrap_or_else(missing)).collect()
    }

    /// One sample: per tile, find what is visible, shade the dominant surface of each texel, store it. Where nobody waits for it,
    /// each tile is done before the next one begins, and others get a turn in between.
    fn render_sample(
        &mut self,
        job: &SampleJob,
        id: SampleId,
        cancel: &Cancel,
        give_way: &mut Option<GiveWay<'_>>,
    ) -> Result<Sample, RenderError> {
        let mut begin = Instant::now();
        self.check_job(job)?;
        let camera = job.info.camera(id.camera)?;
        let mut tiles = sample_tiles(&camera, self.knobs.side())?;
        let mut stages = self.pose(job.info.time_secs());
        stages.extend(self.light(&job.info.lighting, job.info.time_secs())?);
        stages.extend(self.mirror(job.info.reflections, &job.info.lighting, job.info.time_secs(), cancel)?);
        let mut eye = self.eye(camera.center(), &job.info.lighting)?;
        let way = self.ready(job.info.visibility);
        // Rays cost the same in parts, which a rasteriser has all triangles to look at for. Indirect light at points is
        // spread within a tile. All samples are rendered so, whether or not anybody waits: their bytes are the same.
        if way == Visibility::Cpu && self.indirect.is_none() {
            tiles = tiles.into_iter().flat_map(|tile| tile.bands(PART)).collect();
        }
        let resolve = self.looks.of(job.info.reflections).resolve;
        let planes = resolve.planes(&self.gpu, &self.knobs, camera.size(), job.to_host);

        let mut under_way: Vec<Submitted> = Vec::new();
        for tile in &tiles {
            check_wanted(cancel)?;
            let Look { shade_sample, resolve, mirrored, .. } = self.looks.of(job.info.reflections);
            let mut commands = self.gpu.commands("render sample");
            let reflectors = job.info.reflections.is_some();
            let texels = tile.of_texels();
            let extras = Extras { gloss: self.glossy, reflectors, guides: self.indirect.is_some() };
            let context = TileContext::new(&self.gpu, &self.resident, &eye, tile, &mut self.scratch, extras);
            self.seeing.see(&mut commands, &context, way, &mut stages)?;
            let context = context.of_texels(&texels);
            shade_sample.record(&mut commands, &context, mirrored);
            let spreading = Spreading::Texels { side: tile.side };
            let mut commands = add_light(&mut self.indirect, commands, &context, spreading, &mut stages)?;
            resolve.record(&mut commands, &context, &self.knobs, &planes);
            under_way.push(commands.submit());
            if let Some(give_way) = give_way {
                wait(&mut under_way, &mut stages)?;
                let began = Instant::now();
                give_way(self);
                if self.animated {
                    // Others may have looked at another time.
                    self.pose(job.info.time_secs());
                    eye = self.eye(camera.center(), &job.info.lighting)?;
                }
                begin += began.elapsed();
            }
        }
        wait(&mut under_way, &mut stages)?;

        let planes = self.hand_over(&planes, camera.size(), job.to_host)?;
        timing::add_rest(&mut stages, begin);
        Ok(Sample { id, camera, planes, stages })
    }

    /// Whether samples of a set can be rendered here.
    fn check_job(&self, job: &SampleJob) -> Result<(), RenderError> {
        self.check_alive()?;
        if job.info.scene != self.scene.hash {
            let reason = format!("this process holds scene {}, not {}", self.scene.hash, job.info.scene);
            return Err(InvalidField::new("sample.scene", reason).into());
        }
        self.knobs.check_set(&job.info)?;
        Ok(job.info.sampling.validate(&job.info.rig)?)
    }

    /// The planes of a sample that is done: read back, or as textures of their own.
    fn hand_over(
        &self,
        planes: &PlaneBuffers,
        size: [u32; 2],
        to_host: bool,
    ) -> Result<Vec<Plane>, RenderError> {
        let mut commands = self.gpu.commands("hand sample over");
        if !to_host {
            let planes = planes.to_textures(&self.gpu, &mut commands);
            commands.submit().wait()?;
            return Ok(planes);
        }
        let tickets = planes.read(&mut commands);
        let mut finished = commands.submit().wait()?;
        let host = |(kind, format, ticket)| {
            let data = PlaneData::Host(finished.take(ticket));
            Plane { kind, format, size, data }
        };
        Ok(tickets.into_iter().map(host).collect())
    }

    /// One direct view: per tile, find what is visible, shade it, average each pixel; and once more with one
    /// ray a pixel where ranges are asked for.
    fn render_view(&mut self, view: &ViewJob, cancel: &Cancel) -> Result<Frame, RenderError> {
        let begin = Instant::now();
        self.check_alive()?;
        let side = grid_side(&view.plan)?;
        if view.width == 0 || view.height == 0 {
            return Err(InvalidField::new("width", "width and height must be at least 1").into());
        }
        let (width, height) = (view.width, view.height);
        let faces = SampleCamera::Perspective { camera: view.camera, width, height }.faces();
        let mut stages = self.pose(view.time_secs);
        let lighting = self.lighting.clone();
        if view.outputs.color {
            stages.extend(self.light(&lighting, view.time_secs)?);
            stages.extend(self.mirror(view.reflections, &lighting, view.time_secs, cancel)?);
        }
        let eye = self.eye(view.camera.eye, &lighting)?;

        let color_tiles = tiles(&faces, side);
        let way = self.ready(view.visibility);
        let Look { shade, mirrored, .. } = self.looks.of(view.reflections);
        let mut parts = ViewParts::default();
        if view.outputs.color {
            let mut image = Image::new([width, height], 3);
            for tile in color_tiles {
                check_wanted(cancel)?;
                let mut commands = self.gpu.commands("render view");
                let extras = Extras { guides: self.indirect.is_some(), ..Extras::default() };
                let context =
                    TileContext::new(&self.gpu, &self.resident, &eye, &tile, &mut self.scratch, extras);
                self.seeing.see(&mut commands, &context, way, &mut stages)?;
                shade.record(&mut commands, &context, mirrored);
                let mut commands =
                    add_light(&mut self.indirect, commands, &context, Spreading::Image, &mut stages)?;
                let ticket = self.resolve_view.record_color(&mut commands, &context, lighting.exposure);
                image.finish(&tile, commands, ticket, &mut stages)?;
            }
            parts.color = Some(image.into_bytes());
        }
        if view.outputs.range {
            let mut image = Image::new([width, height], 4);
            for tile in tiles(&faces, 1) {
                check_wanted(cancel)?;
                let mut commands = self.gpu.commands("render range");
                let context = TileContext::new(
                    &self.gpu,
                    &self.resident,
                    &eye,
                    &tile,
                    &mut self.scratch,
                    Extras::default(),
                );
                self.seeing.see(&mut commands, &context, way, &mut stages)?;
                let ticket = self.resolve_view.record_range(&mut commands, &context);
                image.finish(&tile, commands, ticket, &mut stages)?;
            }
            parts.range = Some(image.into_bytes());
        }
        timing::add_rest(&mut stages, begin);
        let specification = Specification {
            visibility: way,
            sampling: Sampling::Triangles,
            sub_samples: self.knobs.sub_samples,
            indirect: self.knobs.indirect,
            reflections: view.reflections,
            exposure: lighting.exposure,
        };
        Ok(frame(view, &self.scene, (specification, self.gpu.kind()), parts, stages))
    }

    /// Puts everything where it is at a time; what that cost, if it was elsewhere. A scene that stands still is never
    /// posed again.
    fn pose(&mut self, time_secs: f64) -> Vec<Stage> {
        if !self.animated || time_secs == self.posed_secs {
            return Vec::new();
        }
        let begin = Instant::now();
        let pose = self.scene.at(time_secs);
        self.resident.place(&self.scene, &pose.instances);
        self.seeing.pose(&self.resident);
        if let Some(indirect) = &mut self.indirect {
            indirect.place(&self.resident.instances);
        }
        if let Some(maps) = &mut self.maps {
            maps.forget_pose();
        }
        if let Some(mirrors) = &mut self.looks.mirrors {
            mirrors.forget_pose();
        }
        self.lighting = pose.lighting;
        self.posed_secs = time_secs;
        vec![Stage::new("pose", begin.elapsed().as_secs_f64() * 1e3)]
    }

    /// Makes ready what a way needs; where the device does not have it, triangles are rasterised.
    fn ready(&mut self, way: Visibility) -> Visibility {
        match self.seeing.ready(&self.gpu, &self.resident, way) {
            Ok(()) => way,
            Err(reason) => {
                warn!(reason, "this device cannot see triangles by {}, they are rasterised", way.name());
                Visibility::Raster
            }
        }
    }

    /// Makes the indirect light ready, if it is asked for; what that cost.
    fn light(&mut self, lighting: &Lighting, time_secs: f64) -> Result<Vec<Stage>, RenderError> {
        let (gpu, scene, resident) = (&self.gpu, &self.scene, &self.resident);
        if self.indirect.is_none() {
            self.indirect = IndirectLight::new(gpu, scene, resident, self.knobs.indirect);
        }
        let Some(indirect) = &mut self.indirect else { return Ok(Vec::new()) };
        let tracer = self.seeing.ready_packets(resident);
        indirect.ready(&ToLight { gpu, scene, resident, tracer, lighting, time_secs }, &mut self.scratch)
    }

    /// What is known of the indirect light by VPLs, and what was culled since the last call; none before it was needed.
    ///
    /// # Errors
    /// A lost device.
    pub fn indirect(&self) -> Result<Option<IndirectReport>, RenderError> {
        match &self.indirect {
            Some(IndirectLight::Vpls(light)) => light.report(&self.gpu),
            _ => Ok(None),
        }
    }

    /// What is known of the indirect light by points; none before it was needed.
    pub fn points(&self) -> Option<PointReport> {
        match &self.indirect {
            Some(IndirectLight::Points(light)) => light.report(),
            _ => None,
        }
    }

    /// Gathers indirect light by other knobs from now on.
    ///
    /// # Errors
    /// A knob that is out of range; a sampler that was made without indirect light.
    pub fn set_indirect(&mut self, knobs: Indirect) -> Result<(), RenderError> {
        let knobs = SamplerKnobs { indirect: knobs, ..self.knobs };
        knobs.validate()?;
        if [self.knobs.indirect, knobs.indirect].contains(&Indirect::Off) {
            return Err(
                InvalidField::new("indirect", "a sampler is made with indirect light or without").into()
            );
        }
        self.knobs = knobs;
        if !self.indirect.as_mut().is_some_and(|light| light.set_knobs(knobs.indirect)) {
            self.indirect = None;
        }
        if let Some(maps) = &mut self.maps {
            maps.octree.forget_light();
        }
        if let Some(mirrors) = &mut self.looks.mirrors {
            mirrors.forget_light();
        }
        Ok(())
    }

    /// What each sub-sample of a view sees, row by row, found in a given way: instance + 1 and triangle of its mesh, 0
    /// for the sky; and how long it took, with the tracer built and what the device needs compiled.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for a view larger than a tile, and for a way that this device does not have; a lost
    /// device.
    pub fn identify(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        side: u32,
        visibility: Visibility,
    ) -> Result<(Vec<[u32; 2]>, Duration), RenderError> {
        self.check_alive()?;
        let [width, height] = size;
        let faces = SampleCamera::Perspective { camera: *camera, width, height }.faces();
        let [tile] = tiles(&faces, side)[..] else {
            return Err(InvalidField::new("width", "the view must fit a tile").into());
        };
        self.seeing
            .ready(&self.gpu, &self.resident, visibility)
            .map_err(|reason| InvalidField::new("visibility", reason))?;
        let eye = self.eye(camera.eye, &self.lighting)?;
        let (gpu, resident) = (&self.gpu, &self.resident);
        let context = TileContext::new(gpu, resident, &eye, &tile, &mut self.scratch, Extras::default());
        let begin = Instant::now();
        let mut commands = self.gpu.commands("identify");
        self.seeing.see(&mut commands, &context, visibility, &mut Vec::new())?;
        commands.submit().wait()?;
        let took = begin.elapsed();
        let mut commands = self.gpu.commands("read ids");
        let ticket = commands.read_texture(context.targets.visibility.texture());
        let bytes = commands.submit().wait()?.take(ticket);
        let ids = bytes.as_chunks::<8>().0.iter().map(|b| bytemuck::pod_read_unaligned(b)).collect();
        Ok((ids, took))
    }

    /// Some pixels of a direct view: traced, and shaded as a list, so that they cost as many as they are.
    fn render_list(&mut self, job: &PixelJob, cancel: &Cancel) -> Result<Pixels, RenderError> {
        let begin = Instant::now();
        self.check_alive()?;
        let side = grid_side(&Plan::Direct { samples_per_pixel: job.samples_per_pixel })?;
        let (width, height) = (job.width, job.height);
        if width == 0 || height == 0 {
            return Err(InvalidField::new("width", "width and height must be at least 1").into());
        }
        let mut stages = self.pose(job.time_secs);
        self.seeing.ready_packets(&self.resident);
        let faces = SampleCamera::Perspective { camera: job.camera, width, height }.faces();
        let lighting = self.lighting.clone();
        stages.extend(self.light(&lighting, job.time_secs)?);
        stages.extend(self.mirror(job.reflections, &lighting, job.time_secs, cancel)?);
        let eye = self.eye(job.camera.eye, &lighting)?;
        let Look { shade, mirrored, .. } = self.looks.of(job.reflections);
        let mut color = vec![0; job.pixels.len() * 3];
        let mut range = vec![0; job.pixels.len() * 4];
        for (side, images) in [(side, true), (1, false)] {
            for listing in faces
                .iter()
                .map(|face| listings(face, side, &job.pixels))
                .collect::<Result<Vec<_>, _>>()?
                .iter()
                .flatten()
            {
                check_wanted(cancel)?;
                let mut commands = self.gpu.commands("render pixels");
                let extras = Extras { guides: images && self.indirect.is_some(), ..Extras::default() };
                let context =
                    list_context(&self.gpu, &self.resident, &eye, listing, &mut self.scratch, extras);
                self.seeing.see_list(&context, listing, &mut stages)?;
                let (ticket, out, bytes) = if images {
                    shade.record(&mut commands, &context, mirrored);
                    commands =
                        add_light(&mut self.indirect, commands, &context, Spreading::Pixels, &mut stages)?;
                    let ticket = self.resolve_view.record_color(&mut commands, &context, lighting.exposure);
                    (ticket, &mut color, 3)
                } else {
                    (self.resolve_view.record_range(&mut commands, &context), &mut range, 4)
                };
                let mut finished = commands.submit().wait()?;
                timing::add(&mut stages, std::mem::take(&mut finished.stages));
                let found = finished.take(ticket);
                for (&asked, texel) in listing.asked.iter().zip(found.chunks_exact(bytes)) {
                    let at = asked as usize * bytes;
                    out[at..at + bytes].copy_from_slice(texel);
                }
            }
        }
        timing::add_rest(&mut stages, begin);
        Ok(Pixels { color: color.into(), range: range.into(), stages })
    }

    fn eye(&self, position: DVec3, lighting: &Lighting) -> Result<Eye, RenderError> {
        Eye::new(&self.gpu, &self.resident, position, lighting)
    }

    fn check_alive(&self) -> Result<(), RenderError> {
        self.gpu.lost().map_or(Ok(()), |reason| Err(GpuError::Lost(reason).into()))
    }
}

impl Sampler for GpuSampler {
    fn device(&self) -> &str {
        self.gpu.kind()
    }

    fn usual_visibility(&self) -> Visibility {
        // Packets of rays are the cheapest on processors, at every size and scene that was measured.
        if self.gpu.is_software() { Visibility::Cpu } else { Visibility::Raster }
    }

    fn ways(&mut self, info: &SampleSetInfo) -> Result<Vec<(Visibility, f64)>, RenderError> {
        self.check_alive()?;
        let camera = info.rig.camera(0)?;
        let tiles = sample_tiles(&camera, self.knobs.side())?;
        let Some(tile) = tiles.first() else { return Ok(vec![(Visibility::Raster, 0.0)]) };
        let eye = self.eye(camera.center(), &info.lighting)?;
        let (gpu, resident) = (&self.gpu, &self.resident);
        let context = TileContext::new(gpu, resident, &eye, tile, &mut self.scratch, Extras::default());
        self.seeing.measure(&context)
    }

    fn render_samples(&mut self, job: &SampleJob, cancel: &Cancel) -> Vec<Result<Sample, RenderError>> {
        self.render_set(job, cancel, None)
    }

    fn render_samples_in_slices(
        &mut self,
        job: &SampleJob,
        cancel: &Cancel,
        give_way: GiveWay<'_>,
    ) -> Vec<Result<Sample, RenderError>> {
        self.render_set(job, cancel, Some(give_way))
    }

    fn render_views(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        views.iter().map(|view| self.render_view(view, cancel)).collect()
    }

    fn render_pixels(&mut self, jobs: &[PixelJob], cancel: &Cancel) -> Vec<Result<Pixels, RenderError>> {
        jobs.iter().map(|job| self.render_list(job, cancel)).collect()
    }
}

/// A list of a tile's pixels as an image of its own: the tile's rays, for an image of the list's size.
fn list_context<'a>(
    gpu: &'a Arc<Gpu>,
    resident: &'a Resident,
    eye: &'a Eye,
    listing: &'a Listing,
    scratch: &mut Scratch,
    extras: Extras,
) -> TileContext<'a> {
    let [width, height] = listing.compact.sub_samples();
    let rays = Rays { width, height, ..listing.tile.rays() };
    let rays = gpu.upload("rays", &[rays], wgpu::BufferUsages::UNIFORM);
    let places = gpu.upload("places", &listing.words(), wgpu::BufferUsages::STORAGE);
    let context = TileContext::new(gpu, resident, eye, &listing.compact, scratch, extras);
    TileContext { rays, places: Some(places), ..context }
}

/// Adds a tile's indirect light, if there is any.
fn add_light(
    indirect: &mut Option<IndirectLight>,
    commands: Commands,
    context: &TileContext<'_>,
    spreading: Spreading,
    stages: &mut Vec<Stage>,
) -> Result<Commands, RenderError> {
    match indirect {
        Some(light) => light.add(commands, context, spreading, stages),
        None => Ok(commands),
    }
}

/// Waits for what is under way; how long its stages took.
fn wait(under_way: &mut Vec<Submitted>, stages: &mut Vec<Stage>) -> Result<(), RenderError> {
    for submitted in under_way.drain(..) {
        timing::add(stages, submitted.wait()?.stages);
    }
    Ok(())
}

fn check_wanted(cancel: &Cancel) -> Result<(), RenderError> {
    if cancel.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(()) }
}

/// The tiles of a sample camera.
fn sample_tiles(camera: &SampleCamera, side: u32) -> Result<Vec<Tile>, RenderError> {
    let faces = camera.faces();
    if faces.is_empty() {
        let reason = "triangles are not rasterised into dual paraboloids; use cube faces";
        return Err(InvalidField::new("sample.camera", reason).into());
    }
    Ok(tiles(&faces, side))
}

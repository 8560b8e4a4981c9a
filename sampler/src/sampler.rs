//! The frame, top to bottom.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_gpu::{Commands, Gpu, GpuError, Submitted, wgpu};
use argus_scene::frame::{INDIRECT_BY, TRIANGLES_BY};
use argus_scene::{
    Camera, Cancel, Frame, InvalidField, Lighting, PixelJob, Pixels, Plan, Plane, PlaneData, RenderError,
    Sample, SampleCamera, SampleId, SampleJob, Sampler, Scene, Stage, ViewJob,
};
use argus_shaders::layout::sampler::Rays;
use glam::DVec3;

use crate::draws::DrawList;
use crate::eye::Eye;
use crate::packets::PacketTracer;
use crate::passes::{
    IndirectScratch, Rasteriser, ResolveSample, ResolveView, Shade, Shading, TileContext, Trace,
};
use crate::pixels::{Listing, listings};
use crate::plan::{PassPlan, plan};
use crate::radiosity::{Indirect, IndirectReport, Radiosity, VplKnobs};
use crate::resident::{Resident, upload};
use crate::scratch::{Scratch, Targets};
use crate::tile::{Tile, tiles};
use crate::view::{Image, ViewParts, frame, grid_side};
use crate::ways::{self, Building, Choice, Choices, Way};
use crate::{SamplerKnobs, Visibility, draws, timing};

/// Renders a scene from its triangles, on one device.
///
/// The scene is uploaded when this is made. Samples and views need only what depends on their cameras, and the
/// places of instances where their epoch is another than the last one's. After a loss of the device every render fails with [`RenderError::DeviceLost`]; make another
/// one, on another [`Gpu`].
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
    rasteriser: Rasteriser,
    shade: Shade,
    resolve_sample: ResolveSample,
    resolve_view: ResolveView,
    scratch: Scratch,
    choices: Choices,
    packets: Option<PacketTracer>,
    /// The tracer on the device, or why there is none.
    trace: Option<Result<Trace, String>>,
    building: Option<Building>,
    /// Light from surface to surface, made when it is first needed.
    radiosity: Option<Radiosity>,
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

    /// The same, with other than the default knobs.
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
            // What may be needed at first use is built while the scene's first order is on its way.
            building: (knobs.visibility != Visibility::Raster)
                .then(|| Building::start(&scene, &resident.instances, draws::near(&resident.bounds))),
            packets: None,
            trace: None,
            choices: Choices::default(),
            rasteriser: Rasteriser::new(&gpu, &resident),
            shade: Shade::new(&gpu, resident.features, knobs.indirect != Indirect::Off),
            radiosity: None,
            resolve_sample: ResolveSample::new(&gpu, glossy, knobs.side()),
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

    /// Which passes this scene calls for, and why.
    pub fn plan(&self) -> Vec<PassPlan> {
        plan(&self.scene, &self.resident, &self.knobs, &self.choices)
    }

    /// One sample: per tile, find what is visible, shade it, choose a surface for each texel.
    fn render_sample(
        &mut self,
        job: &SampleJob,
        id: SampleId,
        cancel: &Cancel,
    ) -> Result<Sample, RenderError> {
        let begin = Instant::now();
        self.check_alive()?;
        if job.info.scene != self.scene.hash {
            let reason = format!("this process holds scene {}, not {}", self.scene.hash, job.info.scene);
            return Err(InvalidField::new("sample.scene", reason).into());
        }
        let camera = job.info.rig.camera(id.index)?;
        let tiles = sample_tiles(&camera, self.knobs.side())?;
        let mut stages = self.pose(job.info.time_secs());
        stages.extend(self.light(&job.info.lighting)?);
        let eye = self.eye(camera.center(), &job.info.lighting)?;
        let planes = self.resolve_sample.planes(&self.gpu, &self.knobs, camera.size(), job.to_host);
        let way = self.way_of_samples(&eye, &tiles)?;

        let mut under_way: Vec<Submitted> = Vec::new();
        for tile in &tiles {
            check_wanted(cancel)?;
            let mut commands = self.gpu.commands("render sample");
            let targets = self.scratch.targets(&self.gpu, tile.sub_samples(), self.glossy);
            let indirect = self.indirect_scratch(tile);
            let context = TileContext { indirect, ..self.context(&eye, tile, targets) };
            self.see(&mut commands, &context, way, &mut stages)?;
            self.shade(&mut commands, &context, Shading::Sample);
            self.resolve_sample.record(&mut commands, &context, &self.knobs, &planes);
            under_way.push(commands.submit());
        }
        for submitted in under_way {
            timing::add(&mut stages, submitted.wait()?.stages);
        }

        let mut commands = self.gpu.commands("hand sample over");
        let planes = if job.to_host {
            let tickets = planes.read(&mut commands);
            let mut finished = commands.submit().wait()?;
            let host = |(kind, format, ticket)| {
                let data = PlaneData::Host(finished.take(ticket));
                Plane { kind, format, size: camera.size(), data }
            };
            tickets.into_iter().map(host).collect()
        } else {
            let planes = planes.to_textures(&self.gpu, &mut commands);
            commands.submit().wait()?;
            planes
        };
        timing::add_rest(&mut stages, begin);
        Ok(Sample { id, camera, planes, stages })
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
            stages.extend(self.light(&lighting)?);
        }
        let eye = self.eye(view.camera.eye, &lighting)?;

        let color_tiles = tiles(&faces, side);
        let way = self.way_of_views(&eye, &color_tiles)?;
        let mut parts = ViewParts::default();
        if view.outputs.color {
            let mut image = Image::new([width, height], 3);
            for tile in color_tiles {
                check_wanted(cancel)?;
                let mut commands = self.gpu.commands("render view");
                let targets = self.scratch.targets(&self.gpu, tile.sub_samples(), false);
                let indirect = self.indirect_scratch(&tile);
                let context = TileContext { indirect, ..self.context(&eye, &tile, targets) };
                self.see(&mut commands, &context, way, &mut stages)?;
                self.shade(&mut commands, &context, Shading::View);
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
                let targets = self.scratch.targets(&self.gpu, tile.sub_samples(), false);
                let context = self.context(&eye, &tile, targets);
                self.see(&mut commands, &context, way, &mut stages)?;
                let ticket = self.resolve_view.record_range(&mut commands, &context);
                image.finish(&tile, commands, ticket, &mut stages)?;
            }
            parts.range = Some(image.into_bytes());
        }
        timing::add_rest(&mut stages, begin);
        let device = self.device_seeing_by(way);
        Ok(frame(view, &self.scene, &device, parts, stages))
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
        if let Some(packets) = &mut self.packets {
            packets.pose(&self.scene, &self.resident.instances);
        }
        if let Some(radiosity) = &mut self.radiosity {
            radiosity.place(&self.resident.instances);
        }
        self.lighting = pose.lighting;
        self.posed_secs = time_secs;
        vec![Stage::new("pose", begin.elapsed().as_secs_f64() * 1e3)]
    }

    /// Makes the indirect light ready, if it is asked for; what that cost.
    fn light(&mut self, lighting: &Lighting) -> Result<Vec<Stage>, RenderError> {
        let Indirect::Vpl(knobs) = self.knobs.indirect else { return Ok(Vec::new()) };
        self.ready_packets();
        let (gpu, scene, placements) = (&self.gpu, &self.scene, &self.resident.instances);
        let radiosity = self.radiosity.get_or_insert_with(|| Radiosity::new(gpu, scene, placements, knobs));
        let Some(packets) = &self.packets else { return Ok(Vec::new()) };
        radiosity.ready(gpu, packets, lighting)
    }

    /// What is known of the indirect light, and what was culled since the last call; none before it was needed.
    ///
    /// # Errors
    /// A lost device.
    pub fn indirect(&self) -> Result<Option<IndirectReport>, RenderError> {
        self.radiosity.as_ref().map_or(Ok(None), |radiosity| radiosity.report(&self.gpu))
    }

    /// Gathers indirect light by other knobs from now on.
    ///
    /// # Errors
    /// A knob that is out of range; a sampler that was made without indirect light.
    pub fn set_indirect(&mut self, knobs: VplKnobs) -> Result<(), RenderError> {
        knobs.validate()?;
        if self.knobs.indirect == Indirect::Off {
            return Err(InvalidField::new("indirect", "this sampler was made without indirect light").into());
        }
        self.knobs.indirect = Indirect::Vpl(knobs);
        if let Some(radiosity) = &mut self.radiosity {
            radiosity.set_knobs(knobs);
        }
        Ok(())
    }

    /// Memory for a tile's indirect light, if it has any.
    fn indirect_scratch(&mut self, tile: &Tile) -> Option<IndirectScratch> {
        let gpu = &self.gpu;
        self.radiosity.as_mut().map(|radiosity| radiosity.scratch(gpu, tile.sub_samples()))
    }

    /// Shades what a tile sees, and adds indirect light.
    fn shade(&self, commands: &mut Commands, context: &TileContext<'_>, shading: Shading) {
        self.shade.record(commands, context, shading);
        if let Some(radiosity) = &self.radiosity {
            radiosity.record(commands, context);
        }
    }

    fn context<'a>(&'a self, eye: &'a Eye, tile: &'a Tile, targets: Targets) -> TileContext<'a> {
        let rays = self.gpu.upload("rays", &[tile.rays()], wgpu::BufferUsages::UNIFORM);
        TileContext {
            gpu: &self.gpu,
            resident: &self.resident,
            eye,
            tile,
            rays,
            places: None,
            targets,
            indirect: None,
        }
    }

    /// Finds what a tile sees.
    fn see(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        way: Way,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        match way {
            Way::Raster => self.rasterise(commands, context, stages),
            Way::Trace => self.trace(commands, context, stages),
            Way::Cpu => {
                let begin = Instant::now();
                let ids = self.packets()?.trace(context.eye.position, &context.tile.rays());
                self.write_ids(&context.targets, context.tile.sub_samples(), &ids);
                timing::add(stages, vec![Stage::new("trace on the CPU", elapsed_ms(begin))]);
                Ok(())
            }
        }
    }

    /// Finds what a tile sees by compute. The software driver ends a program whose loops go on for long, without a
    /// word: there it is asked whether the tile is whole, and one that is not is rasterised.
    fn trace(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let hierarchy = self.packets()?.hierarchy();
        let Some(Ok(trace)) = &self.trace else {
            return self.rasterise(commands, context, stages);
        };
        if !self.gpu.is_software() {
            return trace.record(commands, context, hierarchy);
        }
        let mut own = self.gpu.commands("trace");
        trace.record(&mut own, context, hierarchy)?;
        let ticket = trace.read_unfinished(&mut own);
        let mut finished = own.submit().wait()?;
        timing::add(stages, std::mem::take(&mut finished.stages));
        if Trace::is_whole(&finished.take(ticket)) {
            return Ok(());
        }
        self.rasterise(commands, context, stages)
    }

    /// Hands what was found on the CPU to the device, before its next submission.
    fn write_ids(&self, targets: &Targets, size: [u32; 2], ids: &[[u32; 2]]) {
        let [width, height] = size;
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 8), rows_per_image: None };
        let extent = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let to = targets.visibility.texture().as_image_copy();
        self.gpu.queue.write_texture(to, bytemuck::cast_slice(ids), layout, extent);
    }

    /// The tracer of packets; [`Self::ready_packets`] comes first.
    fn packets(&self) -> Result<&PacketTracer, RenderError> {
        self.packets.as_ref().ok_or_else(|| RenderError::Internal("the tracer was not built".to_owned()))
    }

    /// Waits for the tracer of packets, or builds it.
    fn ready_packets(&mut self) {
        if self.packets.is_none() {
            let near = draws::near(&self.resident.bounds);
            let build = || ways::build(&self.scene, &self.resident.instances, near);
            let mut packets = self.building.take().map_or_else(build, Building::finish);
            if self.animated {
                packets.pose(&self.scene, &self.resident.instances);
            }
            self.packets = Some(packets);
        }
    }

    /// Hands the hierarchy to the device, once, or says why that cannot be.
    fn ready_trace(&mut self) -> Result<(), String> {
        self.ready_packets();
        if let (None, Some(packets)) = (&self.trace, &self.packets) {
            let near = draws::near(&self.resident.bounds);
            self.trace = Some(Trace::new(&self.gpu, packets.hierarchy(), near));
        }
        match &self.trace {
            Some(Err(reason)) => Err(reason.clone()),
            _ => Ok(()),
        }
    }

    /// How samples see triangles; measured on the first tile of the first one if the user leaves it open.
    fn way_of_samples(&mut self, eye: &Eye, tiles: &[Tile]) -> Result<Way, RenderError> {
        if self.choices.samples.is_none() {
            self.choices.samples = Some(self.choose("samples", eye, tiles)?);
        }
        Ok(self.choices.samples.as_ref().map_or(Way::Raster, |choice| choice.way))
    }

    /// The same of direct views.
    fn way_of_views(&mut self, eye: &Eye, tiles: &[Tile]) -> Result<Way, RenderError> {
        if self.choices.views.is_none() {
            self.choices.views = Some(self.choose("direct views", eye, tiles)?);
        }
        Ok(self.choices.views.as_ref().map_or(Way::Raster, |choice| choice.way))
    }

    fn choose(&mut self, what: &str, eye: &Eye, tiles: &[Tile]) -> Result<Choice, RenderError> {
        match Way::wished(self.knobs.visibility) {
            Some(Way::Trace) => {
                if let Err(reason) = self.ready_trace() {
                    let why = format!("this device cannot trace: {reason}");
                    return Ok(Choice { way: Way::Raster, why });
                }
            }
            Some(Way::Cpu) => self.ready_packets(),
            Some(Way::Raster) | None => (),
        }
        if let Some(way) = Way::wished(self.knobs.visibility) {
            return Ok(Choice { way, why: "asked for".to_owned() });
        }
        let Some(tile) = tiles.first() else {
            return Ok(Choice { way: Way::Raster, why: "there is nothing to measure".to_owned() });
        };
        self.ready_packets();
        let mut ways = vec![Way::Raster, Way::Cpu];
        if self.ready_trace().is_ok() {
            ways.push(Way::Trace);
        }
        let targets = self.scratch.targets(&self.gpu, tile.sub_samples(), false);
        ways::choose(what, &ways, |way| {
            let mut commands = self.gpu.commands("measure");
            let context = self.context(eye, tile, targets.clone());
            self.see(&mut commands, &context, way, &mut Vec::new())?;
            commands.submit().wait()?;
            Ok(())
        })
    }

    /// Kind of device as the provenance of direct views has it: with the way, unless it is the rasteriser, since ids
    /// may differ along edges, and with the knobs of indirect light, if there is any.
    fn device_seeing_by(&self, way: Way) -> String {
        let seen = match way {
            Way::Raster => self.gpu.kind().to_owned(),
            _ => format!("{}{TRIANGLES_BY}{}", self.gpu.kind(), way.name()),
        };
        match &self.knobs.indirect {
            Indirect::Off => seen,
            Indirect::Vpl(knobs) => format!("{seen}{INDIRECT_BY}{knobs}"),
        }
    }

    /// What each sub-sample of a view sees, row by row, found in a given way: instance + 1 and triangle of its mesh, 0
    /// for the sky; and how long it took, with the tracer built and what the device needs compiled.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for [`Visibility::Auto`], for a view larger than a tile, and for a way that this
    /// device does not have; a lost device.
    pub fn identify(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        side: u32,
        visibility: Visibility,
    ) -> Result<(Vec<[u32; 2]>, Duration), RenderError> {
        self.check_alive()?;
        let way = Way::wished(visibility)
            .ok_or_else(|| InvalidField::new("visibility", "one way must be named"))?;
        let [width, height] = size;
        let faces = SampleCamera::Perspective { camera: *camera, width, height }.faces();
        let [tile] = tiles(&faces, side)[..] else {
            return Err(InvalidField::new("width", "the view must fit a tile").into());
        };
        match way {
            Way::Raster => (),
            Way::Trace => self.ready_trace().map_err(|reason| InvalidField::new("visibility", reason))?,
            Way::Cpu => self.ready_packets(),
        }
        let eye = self.eye(camera.eye, &self.lighting)?;
        let targets = self.scratch.targets(&self.gpu, tile.sub_samples(), false);
        let context = self.context(&eye, &tile, targets);
        let begin = Instant::now();
        let mut commands = self.gpu.commands("identify");
        self.see(&mut commands, &context, way, &mut Vec::new())?;
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
        self.ready_packets();
        let faces = SampleCamera::Perspective { camera: job.camera, width, height }.faces();
        let lighting = self.lighting.clone();
        stages.extend(self.light(&lighting)?);
        let eye = self.eye(job.camera.eye, &lighting)?;
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
                let targets = self.scratch.targets(&self.gpu, listing.compact.sub_samples(), false);
                let indirect = if images { self.indirect_scratch(&listing.compact) } else { None };
                let context = TileContext { indirect, ..self.list_context(&eye, listing, targets) };
                self.trace_list(&context, listing, &mut stages)?;
                let (ticket, out, bytes) = if images {
                    self.shade(&mut commands, &context, Shading::View);
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

    fn list_context<'a>(&'a self, eye: &'a Eye, listing: &'a Listing, targets: Targets) -> TileContext<'a> {
        // The tile's rays, for an image of the list's size.
        let [width, height] = listing.compact.sub_samples();
        let rays = Rays { width, height, ..listing.tile.rays() };
        let rays = self.gpu.upload("rays", &[rays], wgpu::BufferUsages::UNIFORM);
        let places = self.gpu.upload("places", &listing.words(), wgpu::BufferUsages::STORAGE);
        let (gpu, resident, tile) = (&self.gpu, &self.resident, &listing.compact);
        TileContext { gpu, resident, eye, tile, rays, places: Some(places), targets, indirect: None }
    }

    /// Finds what the pixels of a list see.
    fn trace_list(
        &self,
        context: &TileContext<'_>,
        listing: &Listing,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let begin = Instant::now();
        let rays = listing.tile.rays();
        let found = self.packets()?.trace_some(context.eye.position, &rays, &listing.sub_samples());
        self.write_ids(&context.targets, context.tile.sub_samples(), &listing.image(&found));
        timing::add(stages, vec![Stage::new("trace rays", elapsed_ms(begin))]);
        Ok(())
    }

    /// Finds what a tile sees: culls, uploads what is left, draws it.
    fn rasterise(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let begin = Instant::now();
        let list = DrawList::new(&self.resident, context.eye.position, context.tile);
        let draws = upload(&self.gpu, "draws", &list.draws, wgpu::BufferUsages::STORAGE)?;
        timing::add(stages, vec![Stage::new("cull", elapsed_ms(begin))]);
        self.rasteriser.record(commands, context, &list, &draws);
        Ok(())
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

    fn render_samples(&mut self, job: &SampleJob, cancel: &Cancel) -> Vec<Result<Sample, RenderError>> {
        job.ids.iter().map(|&id| self.render_sample(job, id, cancel)).collect()
    }

    fn render_views(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>> {
        views.iter().map(|view| self.render_view(view, cancel)).collect()
    }

    fn render_pixels(&mut self, jobs: &[PixelJob], cancel: &Cancel) -> Vec<Result<Pixels, RenderError>> {
        jobs.iter().map(|job| self.render_list(job, cancel)).collect()
    }
}

fn elapsed_ms(begin: Instant) -> f64 {
    begin.elapsed().as_secs_f64() * 1e3
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

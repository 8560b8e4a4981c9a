//! Renders samples, direct views and lists of pixels.

mod light;
mod light_cells;
mod method_samples;
mod part_shading;
mod point_probes;
mod prepared;
mod probes;
mod rays;
mod role;
mod tile_loop;

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_gpu::{Gpu, GpuError, wgpu};
use argus_scene::camera::Face;
use argus_scene::{
    Camera, Cancel, Detail, FaceMask, Frame, InvalidField, Lighting, Outputs, PixelJob, Pixels, Plan,
    RenderError, Sample, SampleCamera, SampleId, SampleJob, SampleSetInfo, Sampler, Sampling, Scene,
    Specification, Stage, ViewJob, Visibility,
};
use bytes::Bytes;
use glam::DVec3;
use tracing::warn;

pub use self::prepared::PreparedSampler;
use self::probes::{ReflectionLookup, SurfacePrograms};
use self::tile_loop::{JobScene, Output, Part, wait};
pub(crate) use self::tile_loop::{add_light, check_wanted};
use crate::enlarge::enlarged;
use crate::eye::Eye;
use crate::indirect::IndirectLight;
use crate::light::DirectLight;
use crate::pass_plan::{PassPlan, pass_plan};
use crate::passes::{Blend, ResolveView, TileContext};
use crate::pixel_list::pixel_lists;
use crate::plug::{Methods, SampleMethod};
use crate::resident::Resident;
use crate::scratch::{Extras, Scratch};
use crate::tile::{Tile, tiles};
use crate::view::{Image, ViewParts, frame, grid_side};
use crate::visibility::VisibilityBackends;
use crate::{SamplerKnobs, timing};

/// Sub-samples of a band of a sample that is traced on the CPU: about 20 ms of a core, with shading by a software driver.
const BAND_SUB_SAMPLES: u32 = 1 << 16;

/// Sub-samples of a band of a view that finds its own reflections: rays of all take up to 400 MB.
const REFLECTING_SUB_SAMPLES: u32 = 1 << 20;

/// Other work that runs between two tiles of a sample; it is told which share of the job is done.
type BetweenTiles<'a> = &'a mut dyn FnMut(&mut dyn Sampler, f64);

/// Renders a scene from its triangles, on one device.
///
/// The scene is uploaded once. A job uploads only what depends on its camera, and the transforms of instances and the
/// vertices of meshes that deform if its epoch differs from the last job's. After a loss of the device every job fails with [`RenderError::DeviceLost`]; make
/// another sampler on another [`Gpu`].
pub struct GpuSampler {
    gpu: Arc<Gpu>,
    /// With its meshes in their shapes at `posed_secs`.
    scene: Arc<Scene>,
    knobs: SamplerKnobs,
    glossy: bool,
    animated: bool,
    /// Lighting at `posed_secs`.
    lighting: Lighting,
    posed_secs: f64,
    resident: Resident,
    visibility: VisibilityBackends,
    surface_programs: SurfacePrograms,
    resolve_view: ResolveView,
    /// Programs that blend transparent surfaces; `None` for a scene without them.
    blend: Option<Blend>,
    scratch: Scratch,
    layer_scratch: Scratch,
    /// Direct light by rays, made when it is first needed; `None` without effects of light.
    direct: Option<DirectLight>,
    /// Indirect light, made when it is first needed.
    indirect: Option<IndirectLight>,
    methods: Methods,
    /// Renders samples otherwise than from triangles; made when a set first asks for it.
    samples: Option<Box<dyn SampleMethod>>,
}

impl GpuSampler {
    /// Uploads a scene and makes the pipelines that it needs.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if a part of the scene is larger than the device can bind,
    /// [`RenderError::Internal`] if fragment programs of the device cannot read the primitive index.
    pub fn new(gpu: Arc<Gpu>, scene: Arc<Scene>) -> Result<Self, RenderError> {
        Self::with_knobs(gpu, scene, SamplerKnobs::default())
    }

    /// Makes a sampler with these knobs.
    ///
    /// # Errors
    /// The errors of [`Self::with_methods`].
    pub fn with_knobs(gpu: Arc<Gpu>, scene: Arc<Scene>, knobs: SamplerKnobs) -> Result<Self, RenderError> {
        Self::with_methods(gpu, scene, knobs, Methods::default())
    }

    /// Makes a sampler with these knobs that has these methods beside its own.
    ///
    /// # Errors
    /// The errors of [`Self::new`], and [`RenderError::Invalid`] for a knob out of range, or that asks for another method.
    pub fn with_methods(
        gpu: Arc<Gpu>,
        scene: Arc<Scene>,
        knobs: SamplerKnobs,
        methods: Methods,
    ) -> Result<Self, RenderError> {
        knobs.validate()?;
        methods.check_indirect(knobs.indirect)?;
        if !gpu.device.features().contains(wgpu::Features::PRIMITIVE_INDEX) {
            let message = format!("{} does not number triangles in fragments", gpu.kind());
            return Err(RenderError::Internal(message));
        }
        let resident = Resident::new(&gpu, &scene)?;
        let glossy = resident.features.specular;
        let visibility = VisibilityBackends::new(&gpu, &scene, &resident);
        Ok(Self {
            blend: visibility.has_layers().then(|| Blend::new(&gpu, glossy && knobs.effects.any())),
            visibility,
            surface_programs: SurfacePrograms::new(&gpu, &resident, &knobs),
            direct: None,
            indirect: None,
            methods,
            samples: None,
            resolve_view: ResolveView::new(&gpu),
            scratch: Scratch::default(),
            layer_scratch: Scratch::default(),
            animated: scene.is_animated(),
            lighting: exposed(scene.at(0.0).lighting, &knobs),
            posed_secs: 0.0,
            gpu,
            scene,
            knobs,
            glossy,
            resident,
        })
    }

    /// The knobs that the sampler was made with.
    pub fn knobs(&self) -> &SamplerKnobs {
        &self.knobs
    }

    /// The device that it renders on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The passes of this scene, and why each is on or off.
    pub fn plan(&self) -> Vec<PassPlan> {
        pass_plan(&self.scene, &self.resident, &self.knobs, self.visibility.has_layers())
    }

    /// Renders the samples of a job. With `between`, other work runs between tiles.
    fn render_set(
        &mut self,
        job: &SampleJob,
        cancel: &Cancel,
        mut between: Option<BetweenTiles<'_>>,
    ) -> Vec<Result<Sample, RenderError>> {
        let (of_probes, of_rig): (Vec<_>, Vec<_>) =
            job.ids.iter().copied().partition(SampleId::is_reflection_probe);
        let job_of_rig = SampleJob { ids: of_rig, ..job.clone() };
        let of_rig = match job.info.sampling {
            Sampling::Triangles => {
                let count = job_of_rig.ids.len() as f64;
                let mut rendered = Vec::new();
                for &id in &job_of_rig.ids {
                    let before = rendered.len() as f64;
                    // Each sample is an equal share of the job.
                    let mut between = between.as_mut().map(|between| {
                        |sampler: &mut dyn Sampler, share: f64| between(sampler, (before + share) / count)
                    });
                    let between = between.as_mut().map(|between| between as BetweenTiles<'_>);
                    rendered.push(self.render_sample(job, id, cancel, between));
                }
                rendered
            }
            Sampling::MegaViews(knobs) => self.render_by_method(&job_of_rig, knobs, cancel),
        };
        let of_probes: Vec<_> =
            of_probes.into_iter().map(|id| self.render_probe_sample(job, id, cancel)).collect();
        // In the order of the job's ids.
        let (mut of_rig, mut of_probes) = (of_rig.into_iter(), of_probes.into_iter());
        let missing = || Err(RenderError::Internal("a sample was neither rendered nor refused".to_owned()));
        let next = |id: &SampleId| if id.is_reflection_probe() { of_probes.next() } else { of_rig.next() };
        job.ids.iter().map(next).map(|sample| sample.unwrap_or_else(missing)).collect()
    }

    /// Renders one sample. With `between`, other work runs between its tiles.
    fn render_sample(
        &mut self,
        job: &SampleJob,
        id: SampleId,
        cancel: &Cancel,
        mut between: Option<BetweenTiles<'_>>,
    ) -> Result<Sample, RenderError> {
        self.check_job(job)?;
        let SampleSetInfo { ref lighting, reflections, visibility, .. } = *job.info;
        let camera = job.info.camera(id.camera)?;
        let faces = job.faces_of(id).of_camera(&camera);
        let before = job.extended(id);
        let missing = faces.without(before.map_or(FaceMask::NONE, |sample| sample.faces));
        let mut tiles = tiles_of_faces(&camera, missing, self.knobs.side())?;
        let job_scene = JobScene {
            position: camera.center(),
            time_secs: job.info.time_secs(),
            lighting: Some(lighting),
            light: job.info.version.state.light,
            ray_divisor: 1,
            cells: self.cells_of_samples(),
            reflections: ReflectionLookup::probes(reflections),
            visibility,
            is_shaded: true,
        };
        let mut scene = self.make_ready(job_scene, cancel)?;
        // Rays cost the same in bands; the rasteriser would process all triangles for each band. Point-based light is shared
        // within a tile. All samples are cut alike, with and without `between`, so that their bytes are equal.
        if scene.backend == Visibility::Cpu && self.indirect.is_none() {
            tiles = tiles.into_iter().flat_map(|tile| tile.bands(BAND_SUB_SAMPLES)).collect();
        }
        let planes = self.surface_programs.of(ReflectionLookup::probes(reflections)).resolve.planes(
            &self.gpu,
            &self.knobs,
            camera.size(),
            job.to_host,
        );
        if let Some(before) = before {
            planes.take_over(&self.gpu, before)?;
        }
        let mut submitted = Vec::new();
        let (parts, output) = (Part::of_tiles(tiles), Output::Texels(&planes));
        let mut done = 0;
        self.render_parts(&mut scene, &parts, output, cancel, |sampler, scene, part| {
            submitted.push(part.submitted);
            done += 1;
            if let Some(between) = &mut between {
                wait(&mut submitted, &mut scene.stages)?;
                sampler.run_between(scene, between, f64::from(done) / parts.len() as f64)?;
            }
            Ok(())
        })?;
        wait(&mut submitted, &mut scene.stages)?;
        let planes = planes.hand_over(&self.gpu, job.to_host)?;
        Ok(Sample { id, camera, faces, planes, stages: scene.into_stages() })
    }

    /// Checks that samples of a set can be rendered here.
    fn check_job(&self, job: &SampleJob) -> Result<(), RenderError> {
        self.check_alive()?;
        if job.info.scene != self.scene.hash {
            let reason = format!("this process holds scene {}, not {}", self.scene.hash, job.info.scene);
            return Err(InvalidField::new("sample.scene", reason).into());
        }
        self.knobs.check_set(&job.info)?;
        self.methods.check_sampling(job.info.sampling)?;
        self.methods.check_reflections(job.info.reflections.as_ref())?;
        Ok(job.info.sampling.validate(&job.info.rig)?)
    }

    /// Renders one direct view in its plan's detail. All images but the colours have all of their pixels.
    fn render_view(&mut self, view: &ViewJob, cancel: &Cancel) -> Result<Frame, RenderError> {
        let (detail, size) = (detail_of(&view.plan), checked_size(view.width, view.height)?);
        let [width, height] = detail.size(size);
        if [width, height] == size || !view.outputs.color {
            return self.render_all_pixels(view, cancel);
        }
        let camera = detail.camera(view.camera, size);
        let small = ViewJob { camera, width, height, outputs: Outputs::COLOR, ..view.clone() };
        let small = self.render_all_pixels(&small, cancel)?;
        let outputs = Outputs { color: false, ..view.outputs };
        let mut frame = self.render_all_pixels(&ViewJob { outputs, ..view.clone() }, cancel)?;
        timing::add(&mut frame.stages, small.stages);
        let begin = Instant::now();
        frame.color = small.color.map(|color| enlarged(&color, detail, size).into());
        timing::add_since(&mut frame.stages, "enlarge", begin);
        Ok(frame)
    }

    /// Renders each pixel of a direct view. Range has one ray a pixel, through the pixel's centre.
    fn render_all_pixels(&mut self, view: &ViewJob, cancel: &Cancel) -> Result<Frame, RenderError> {
        let side = grid_side(&view.plan)?;
        let size = checked_size(view.width, view.height)?;
        let faces = faces_of(view.camera, size);
        let job_scene = JobScene {
            position: view.camera.eye,
            time_secs: view.time_secs,
            lighting: None,
            light: view.state.light,
            ray_divisor: detail_of(&view.plan).ray_divisor(),
            cells: self.cells_of_view(view)?,
            reflections: ReflectionLookup::of_view(view.reflections),
            visibility: view.visibility,
            is_shaded: view.outputs.color,
        };
        let mut scene = self.make_ready(job_scene, cancel)?;
        if view.outputs.color {
            self.see_reflectors(view, &faces, &mut scene);
        }
        let defers = matches!(scene.reflections, ReflectionLookup::View(_));
        let mut images = |side, output| -> Result<[Bytes; 2], RenderError> {
            let (mut color, mut range) = (Image::new(size, 3), Image::new(size, 4));
            // Rays of reflections are in memory, a tile's at once.
            let bands =
                |tile: Tile| if defers { tile.bands(REFLECTING_SUB_SAMPLES).collect() } else { vec![tile] };
            let parts = Part::of_tiles(tiles(&faces, side).into_iter().flat_map(bands).collect());
            self.render_image(&mut scene, &parts, output, cancel, |part, pixels| {
                pixels.color.into_iter().for_each(|pixels| color.place(part.tile(), pixels));
                pixels.range.into_iter().for_each(|pixels| range.place(part.tile(), pixels));
            })?;
            Ok([color.into_bytes(), range.into_bytes()])
        };
        let (mut color, mut range) = (None, None);
        match (view.outputs.color, view.outputs.range) {
            (true, true) if side == 1 => [color, range] = images(1, Output::ColorAndRange)?.map(Some),
            (has_color, has_range) => {
                if has_color {
                    color = images(side, Output::Color)?.into_iter().next();
                }
                if has_range {
                    range = images(1, Output::Range)?.into_iter().nth(1);
                }
            }
        }
        let specification = Specification {
            visibility: scene.backend,
            sampling: Sampling::Triangles,
            sub_samples: self.knobs.sub_samples,
            effects: self.knobs.effects,
            indirect: self.knobs.indirect,
            reflections: view.reflections,
            exposure: self.lighting.exposure,
        };
        let made_by = (specification, self.gpu.kind());
        let lit = self.says_light(view);
        Ok(frame(&lit, &self.scene, made_by, ViewParts { color, range }, scene.into_stages()))
    }

    /// Renders some pixels of a direct view. They are traced and shaded as a list, so that the cost is that of the list.
    fn render_list(&mut self, job: &PixelJob, cancel: &Cancel) -> Result<Pixels, RenderError> {
        let side = grid_side(&Plan::direct(job.samples_per_pixel))?;
        let faces = faces_of(job.camera, checked_size(job.width, job.height)?);
        let job_scene = JobScene {
            position: job.camera.eye,
            time_secs: job.time_secs,
            lighting: None,
            light: job.state.light,
            ray_divisor: 1,
            cells: self.cells_of_samples(),
            // As views from samples, into which the pixels go.
            reflections: ReflectionLookup::probes(job.reflections),
            // Lists are traced on the CPU.
            visibility: Visibility::Cpu,
            is_shaded: true,
        };
        let mut scene = self.make_ready(job_scene, cancel)?;
        let mut images = |side, output| -> Result<[Bytes; 2], RenderError> {
            let (mut color, mut range) = (vec![0; job.pixels.len() * 3], vec![0; job.pixels.len() * 4]);
            for face in &faces {
                let parts: Vec<Part> =
                    pixel_lists(face, side, &job.pixels)?.into_iter().map(Part::Pixels).collect();
                self.render_image(&mut scene, &parts, output, cancel, |part, pixels| {
                    let Part::Pixels(list) = part else { return };
                    for (image, pixels, bytes) in
                        [(&mut color, pixels.color, 3), (&mut range, pixels.range, 4)]
                    {
                        let pixels = pixels.unwrap_or_default();
                        for (&asked, pixel) in list.asked.iter().zip(pixels.chunks_exact(bytes)) {
                            let at = asked as usize * bytes;
                            image[at..at + bytes].copy_from_slice(pixel);
                        }
                    }
                })?;
            }
            Ok([color.into(), range.into()])
        };
        let [color, range] = match side {
            1 => images(1, Output::ColorAndRange)?,
            _ => {
                let ([color, _], [_, range]) = (images(side, Output::Color)?, images(1, Output::Range)?);
                [color, range]
            }
        };
        Ok(Pixels { color, range, stages: scene.into_stages() })
    }

    /// Poses the scene at a time. Returns the cost, if it was posed at another time. A static scene is never posed again.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if light cannot be traced in the scene.
    fn pose(&mut self, time_secs: f64) -> Result<Vec<Stage>, RenderError> {
        if !self.animated || time_secs == self.posed_secs {
            return Ok(Vec::new());
        }
        let begin = Instant::now();
        let scene = self.scene.posed(time_secs);
        if !Arc::ptr_eq(&scene, &self.scene) {
            self.resident.reshape(&self.gpu, &scene);
            self.scene = scene;
            // Its trees are those of the shapes before.
            self.surface_programs.reflected = None;
        }
        let pose = self.scene.at(time_secs);
        self.resident.place(&self.scene, &pose.instances);
        self.visibility.pose(&self.gpu, &self.scene, &self.resident);
        if let Some(indirect) = &mut self.indirect {
            indirect.place(&self.scene, &self.resident.instances);
        }
        if let Some(direct) = &mut self.direct {
            direct.pose(
                &self.gpu,
                &self.scene,
                self.visibility.prepare_packets(&self.resident),
                time_secs,
            )?;
        }
        if let Some(samples) = &mut self.samples {
            samples.forget_pose();
        }
        if let Some(probes) = &mut self.surface_programs.probes {
            probes.forget_pose();
        }
        if let Some(reflected) = &mut self.surface_programs.reflected {
            reflected.forget_pose();
        }
        self.lighting = exposed(pose.lighting, &self.knobs);
        self.posed_secs = time_secs;
        Ok(vec![Stage::new("pose", begin.elapsed().as_secs_f64() * 1e3)])
    }

    /// Prepares a visibility backend. Returns the rasteriser if the device does not support it.
    fn available_backend(&mut self, backend: Visibility) -> Visibility {
        match self.visibility.prepare(&self.gpu, &self.resident, backend) {
            Ok(()) => backend,
            Err(reason) => {
                warn!(reason, "this device cannot see triangles by {}, they are rasterised", backend.name());
                Visibility::Raster
            }
        }
    }

    /// The visibility buffer of a view, row by row: instance + 1 and triangle of its mesh for each sub-sample, 0 for the
    /// sky. Also the time it took, without building hierarchies and compiling.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for a view larger than a tile, or a backend that this device does not support; or the
    /// device is lost.
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
        self.visibility
            .prepare(&self.gpu, &self.resident, visibility)
            .map_err(|reason| InvalidField::new("visibility", reason))?;
        let eye = self.eye(camera.eye, &self.lighting)?;
        let (gpu, resident) = (&self.gpu, &self.resident);
        let context = TileContext::new(gpu, resident, &eye, &tile, &mut self.scratch, Extras::default());
        let begin = Instant::now();
        let mut commands = self.gpu.commands("identify");
        self.visibility.record(&mut commands, &context, visibility, &mut Vec::new())?;
        commands.submit().wait()?;
        let mut took = begin.elapsed();
        let mut commands = self.gpu.commands("read ids");
        let pending = commands.read_texture(context.targets.visibility.texture());
        let bytes = commands.submit().wait()?.take(pending);
        let mut ids: Vec<[u32; 2]> =
            bytes.as_chunks::<8>().0.iter().map(|b| bytemuck::pod_read_unaligned(b)).collect();
        if self.visibility.has_layers() {
            let begin = Instant::now();
            for ray in self.visibility.layers_of_tile(&self.resident, camera.eye, &tile.rays()) {
                if let (Some(id), Some((shown, _))) = (ids.get_mut(ray.at as usize), ray.shown()) {
                    *id = shown;
                }
            }
            took += begin.elapsed();
        }
        Ok((ids, took))
    }

    /// Whether later passes add light to what is shaded.
    fn keeps_guides(&self) -> bool {
        self.direct.is_some() || self.indirect.is_some()
    }

    fn eye(&self, position: DVec3, lighting: &Lighting) -> Result<Eye, RenderError> {
        Eye::new(&self.gpu, &self.resident, position, lighting)
    }

    fn check_alive(&self) -> Result<(), RenderError> {
        self.gpu.lost().map_or(Ok(()), |reason| Err(GpuError::Lost(reason).into()))
    }
}

/// The size of an image, columns and rows.
///
/// # Errors
/// A size without pixels.
fn checked_size(width: u32, height: u32) -> Result<[u32; 2], InvalidField> {
    match width == 0 || height == 0 {
        true => Err(InvalidField::new("width", "width and height must be at least 1")),
        false => Ok([width, height]),
    }
}

/// How much of a view from triangles its plan has rendered.
fn detail_of(plan: &Plan) -> Detail {
    match plan {
        Plan::Direct { detail, .. } => *detail,
        Plan::Warp(_) => Detail::Full,
    }
}

/// A view's camera as the faces of a sample camera.
fn faces_of(camera: Camera, [width, height]: [u32; 2]) -> Vec<Face> {
    SampleCamera::Perspective { camera, width, height }.faces()
}

/// The tiles of a sample camera.
pub(crate) fn sample_tiles(camera: &SampleCamera, side: u32) -> Result<Vec<Tile>, RenderError> {
    tiles_of_faces(camera, FaceMask::ALL, side)
}

/// The tiles of some faces of a sample camera.
fn tiles_of_faces(camera: &SampleCamera, mask: FaceMask, side: u32) -> Result<Vec<Tile>, RenderError> {
    let faces = camera.faces();
    if faces.is_empty() {
        let reason = "triangles are not rasterised into dual paraboloids; use cube faces";
        return Err(InvalidField::new("sample.camera", reason).into());
    }
    let wanted = faces.into_iter().enumerate().filter(|(face, _)| mask.has(*face));
    Ok(tiles(&wanted.map(|(_, face)| face).collect::<Vec<Face>>(), side))
}

/// Lights and sky with the exposure that the sampler was made with.
fn exposed(lighting: Lighting, knobs: &SamplerKnobs) -> Lighting {
    Lighting { exposure: knobs.exposure.unwrap_or(lighting.exposure), ..lighting }
}

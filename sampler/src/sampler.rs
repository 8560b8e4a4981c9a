//! The frame, top to bottom.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Commands, Gpu, GpuError, Submitted, wgpu};
use argus_scene::{
    Cancel, Frame, InvalidField, Lighting, Plane, PlaneData, RenderError, Sample, SampleCamera, SampleId,
    SampleJob, Sampler, Scene, Stage, ViewJob,
};
use glam::DVec3;

use crate::draws::DrawList;
use crate::eye::Eye;
use crate::passes::{ResolveSample, ResolveView, Shade, Shading, TileContext, Visibility};
use crate::plan::{PassPlan, plan};
use crate::resident::{Resident, upload};
use crate::scratch::{Scratch, Targets};
use crate::tile::{Tile, tiles};
use crate::view::{Image, ViewParts, frame, grid_side};
use crate::{SamplerKnobs, timing};

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
    visibility: Visibility,
    shade: Shade,
    resolve_sample: ResolveSample,
    resolve_view: ResolveView,
    scratch: Scratch,
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
            visibility: Visibility::new(&gpu, &resident),
            shade: Shade::new(&gpu, resident.features),
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
        plan(&self.scene, &self.resident, &self.knobs)
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
        let eye = self.eye(camera.center(), &job.info.lighting)?;
        let planes = self.resolve_sample.planes(&self.gpu, &self.knobs, camera.size(), job.to_host);

        let mut under_way: Vec<Submitted> = Vec::new();
        for tile in &tiles {
            check_wanted(cancel)?;
            let mut commands = self.gpu.commands("render sample");
            let targets = self.scratch.targets(&self.gpu, tile.sub_samples(), self.glossy);
            let context = self.context(&eye, tile, targets);
            self.rasterise(&mut commands, &context, &mut stages)?;
            self.shade.record(&mut commands, &context, Shading::Sample);
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
        let eye = self.eye(view.camera.eye, &lighting)?;

        let mut parts = ViewParts::default();
        if view.outputs.color {
            let mut image = Image::new([width, height], 3);
            for tile in tiles(&faces, side) {
                check_wanted(cancel)?;
                let mut commands = self.gpu.commands("render view");
                let targets = self.scratch.targets(&self.gpu, tile.sub_samples(), false);
                let context = self.context(&eye, &tile, targets);
                self.rasterise(&mut commands, &context, &mut stages)?;
                self.shade.record(&mut commands, &context, Shading::View);
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
                self.rasterise(&mut commands, &context, &mut stages)?;
                let ticket = self.resolve_view.record_range(&mut commands, &context);
                image.finish(&tile, commands, ticket, &mut stages)?;
            }
            parts.range = Some(image.into_bytes());
        }
        timing::add_rest(&mut stages, begin);
        Ok(frame(view, &self.scene, self.gpu.kind(), parts, stages))
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
        self.lighting = pose.lighting;
        self.posed_secs = time_secs;
        vec![Stage::new("pose", begin.elapsed().as_secs_f64() * 1e3)]
    }

    fn context<'a>(&'a self, eye: &'a Eye, tile: &'a Tile, targets: Targets) -> TileContext<'a> {
        let rays = self.gpu.upload("rays", &[tile.rays()], wgpu::BufferUsages::UNIFORM);
        TileContext { gpu: &self.gpu, resident: &self.resident, eye, tile, rays, targets }
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
        timing::add(stages, vec![Stage::new("cull", begin.elapsed().as_secs_f64() * 1e3)]);
        self.visibility.record(commands, context, &list, &draws);
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

//! A scene made ready for a job.

use std::time::Instant;

use argus_scene::{Cancel, LightLevel, Lighting, RenderError, Sampler, Stage, Visibility};
use glam::DVec3;

use super::gpu_sampler::{GpuSampler, Moment};
use super::surface_programs::ReflectionLookup;
use crate::eye::Eye;
use crate::light::CellUse;
use crate::probe_renderer::LitAt;
use crate::reflected_light::ViewMaps;
use crate::timing;

/// Other work that runs between two tiles of a sample; it is told which share of the job is done.
pub(super) type BetweenTiles<'a> = &'a mut dyn FnMut(&mut dyn Sampler, f64);

/// What a job needs of the scene.
pub(super) struct JobScene<'a> {
    /// Centre of the camera, metres, world space.
    pub(super) position: DVec3,
    pub(super) moment: Moment,
    /// `None` for the scene's own lighting at that moment.
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
    pub(super) moment: Moment,
    pub(super) lighting: Lighting,
    light: LightLevel,
    ray_divisor: u32,
    pub(super) cells: CellUse,
    pub(super) reflections: ReflectionLookup,
    /// Maps of what a view's reflectors see, if it is looked up there.
    pub(super) maps: Option<Box<dyn ViewMaps>>,
    pub(super) eye: Eye,
    pub(super) backend: Visibility,
    is_shaded: bool,
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
            moment,
            lighting,
            light,
            ray_divisor,
            reflections,
            visibility,
            cells,
            is_shaded,
        } = job;
        let (mut stages, time_secs) = (self.pose(moment)?, moment.time_secs);
        let lighting = lighting.unwrap_or(&self.lighting).clone();
        if is_shaded {
            // What a plan does not name may be shown before it is whole.
            let may_lag = cells == CellUse::Open;
            stages.extend(self.light(&lighting, light, time_secs, may_lag)?);
            stages.extend(self.prepare_reflections(
                reflections,
                LitAt { lighting: &lighting, light, time_secs },
                cancel,
            )?);
        }
        self.divide_rays(ray_divisor);
        self.begin_cells(cells);
        let eye = self.eye(position, &lighting)?;
        let backend = self.available_backend(visibility);
        let maps = None;
        Ok(ReadyScene {
            begin,
            moment,
            lighting,
            light,
            ray_divisor,
            cells,
            reflections,
            maps,
            eye,
            backend,
            is_shaded,
            stages,
        })
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
        if self.animated || self.posed != scene.moment {
            // The other work may have posed the scene at another moment.
            self.pose(scene.moment)?;
            scene.eye = self.eye(scene.eye.position, &scene.lighting)?;
        }
        // It may also have shown another level of light.
        let may_lag = scene.cells == CellUse::Open;
        self.light(&scene.lighting, scene.light, scene.moment.time_secs, may_lag)?;
        self.divide_rays(scene.ray_divisor);
        self.begin_cells(scene.cells);
        // Or prepared other reflections.
        let ReadyScene { lighting, light, reflections, moment, .. } = scene;
        let lit = LitAt { lighting, light: *light, time_secs: moment.time_secs };
        if scene.is_shaded {
            self.prepare_reflections(*reflections, lit, &Cancel::default())?;
        }
        scene.begin += began.elapsed();
        Ok(())
    }
}

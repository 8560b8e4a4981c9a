//! Faces of samples that need not be rendered again after something moved.

use argus_scene::{
    Cancel, FaceMask, Indirect, LightLevel, RenderError, Sample, SampleCamera, SampleJob, SampleSetInfo,
    Sampling, SceneState, Visibility,
};

use super::gpu_sampler::{GpuSampler, Moment};
use super::ready_scene::{JobScene, ReadyScene};
use super::surface_programs::ReflectionLookup;
use crate::light::{FaceTrail, SampleOf};
use crate::tile::Tile;

impl GpuSampler {
    /// The faces of a sample of an earlier version that are as they would be if they were rendered for the job.
    pub(super) fn unchanged_in(
        &mut self,
        job: &SampleJob,
        (earlier, shows): (&Sample, SceneState),
        cancel: &Cancel,
    ) -> Result<FaceMask, RenderError> {
        self.check_job(job)?;
        let info = &job.info;
        let is_known = info.sampling == Sampling::Triangles
            // Light that rises is no move: it changes all faces.
            && [shows.light, info.version.state.light] == [LightLevel::Full; 2]
            && matches!(self.settings.indirect, Indirect::Cells(_))
            && !earlier.id.is_reflection_probe();
        let camera = info.camera(earlier.id.camera)?;
        if !is_known || camera != earlier.camera {
            return Ok(FaceMask::NONE);
        }
        self.make_ready_for_sample(info, &camera, cancel)?;
        let of = SampleOf { camera, number: earlier.id.camera, shows: info.version.state };
        let Some((paths, tracing)) = self.lights.paths_on_cpu() else { return Ok(FaceMask::NONE) };
        Ok(paths.unchanged_faces(tracing, of, shows, earlier.faces))
    }

    /// Makes the scene ready for a sample.
    ///
    /// # Errors
    /// Those of [`GpuSampler::make_ready`].
    pub(super) fn make_ready_for_sample(
        &mut self,
        info: &SampleSetInfo,
        camera: &SampleCamera,
        cancel: &Cancel,
    ) -> Result<ReadyScene, RenderError> {
        let job = JobScene {
            position: camera.center(),
            moment: Moment::of(info.version.state, info.time_secs()),
            lighting: Some(&info.lighting),
            light: info.version.state.light,
            ray_divisor: 1,
            cells: self.cells_of_samples(),
            reflections: ReflectionLookup::probes(info.reflections),
            visibility: info.visibility,
            is_shaded: true,
        };
        self.make_ready(job, cancel)
    }
}

/// Writes down what the faces of a sample are found by, one after another.
pub(super) struct FaceTrails {
    of: SampleOf,
    /// The face of each tile.
    faces: Vec<usize>,
    /// Whether the CPU finds all that faces show.
    is_known: bool,
    trail: Option<FaceTrail>,
}

impl FaceTrails {
    /// Begins with the first of a sample's tiles.
    pub(super) fn begin(sampler: &mut GpuSampler, scene: &ReadyScene, of: SampleOf, tiles: &[Tile]) -> Self {
        let all = of.camera.faces();
        let face = |tile: &Tile| all.iter().position(|face| *face == tile.face).unwrap_or_default();
        let is_known = scene.backend == Visibility::Cpu;
        let trails = Self { of, faces: tiles.iter().map(face).collect(), is_known, trail: None };
        trails.start(sampler, scene, 0);
        trails
    }

    fn start(&self, sampler: &mut GpuSampler, scene: &ReadyScene, tile: usize) {
        let wanted = self.is_known && tile < self.faces.len();
        // Pages of cells that are used from now on are this face's.
        sampler.begin_cells(sampler.cells_of_samples());
        if let Some((paths, tracing)) = sampler.lights.paths_on_cpu().filter(|_| wanted) {
            paths.begin_trail(tracing, scene.eye.position);
        }
    }

    /// Stops while other work runs, once so many tiles are done. What is known of a finished face is kept.
    pub(super) fn pause(&mut self, sampler: &mut GpuSampler, done: usize) {
        let Some((paths, tracing)) = sampler.lights.paths_on_cpu() else { return };
        self.trail = paths.take_trail();
        let [face, next] = [done.checked_sub(1), Some(done)].map(|tile| self.faces.get(tile?));
        if let (Some(&face), true) = (face, face != next)
            && let Some(trail) = self.trail.take()
        {
            paths.add_face(tracing, self.of, face, trail);
        }
    }

    /// Ends, also if a tile failed.
    pub(super) fn end(self, sampler: &mut GpuSampler) {
        if let Some((paths, _)) = sampler.lights.paths_on_cpu() {
            paths.take_trail();
        }
    }

    /// Goes on with the tile after those that are done.
    pub(super) fn resume(&mut self, sampler: &mut GpuSampler, scene: &ReadyScene, done: usize) {
        let is_new = done == 0 || self.faces.get(done) != self.faces.get(done - 1);
        if is_new {
            return self.start(sampler, scene, done);
        }
        if let Some((paths, _)) = sampler.lights.paths_on_cpu() {
            paths.resume_trail(self.trail.take());
        }
    }
}

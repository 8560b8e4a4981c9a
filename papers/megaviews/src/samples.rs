//! Samples from maps of an octree: leaves are shaded first, then sample cameras look them up.

use std::time::Instant;

use argus_sampler::plug::{LitScene, SampleMethod, SampleResults, timing};
use argus_scene::{FaceMask, MegaViews, RenderError, Sample, SampleId, SampleJob, Stage};

use crate::omni_maps::{OmniMaps, groups};

impl SampleMethod for OmniMaps {
    /// Builds the octree, shades its leaves, renders the maps of all cameras in few traversals, and looks up each sample in its
    /// map.
    fn render(
        &mut self,
        scene: &mut LitScene<'_>,
        job: &SampleJob,
        settings: MegaViews,
        mut costs: Vec<Stage>,
    ) -> Result<Option<SampleResults>, RenderError> {
        self.set_settings(settings);
        let Some(lit) = self.octree.ready(scene, &job.info.lighting, job.info.time_secs())? else {
            return Ok(None);
        };
        timing::add(&mut costs, lit);
        // An index that the rig does not have fails only its own sample.
        let to_render_error =
            |id: &SampleId| job.info.rig.camera(id.camera).err().map(|error| Err(error.into()));
        let mut samples: Vec<Option<Result<Sample, RenderError>>> =
            job.ids.iter().map(to_render_error).collect();
        for group in groups(&job.info.rig, &job.ids, &settings) {
            let traversed =
                scene.check_wanted().and_then(|()| self.traverse(scene.gpu, &job.info.rig, &group));
            // Samples of a traversal share its cost evenly. The first traversal includes the cost of the octree.
            let share = 1.0 / group.wanted.len() as f64;
            let shared = traversed.map(|stages| {
                timing::add(&mut costs, stages);
                std::mem::take(&mut costs)
                    .into_iter()
                    .map(|stage| Stage { ms: stage.ms * share, ..stage })
                    .collect::<Vec<_>>()
            });
            for &(order, view) in &group.wanted {
                let sample = shared.clone().and_then(|costs| {
                    let mut sample = self.resolve(scene, job, job.ids[order], view)?;
                    timing::add(&mut sample.stages, costs);
                    Ok(sample)
                });
                samples[order] = Some(sample);
            }
        }
        let missing = || Err(RenderError::Internal("a sample is of no group".to_owned()));
        Ok(Some(samples.into_iter().map(|sample| sample.unwrap_or_else(missing)).collect()))
    }

    fn forget_pose(&mut self) {
        OmniMaps::forget_pose(self);
    }

    fn forget_light(&mut self) {
        self.octree.forget_light();
    }
}

impl OmniMaps {
    /// Renders one sample of the group that was traversed last: per tile, looks up each sub-sample and selects a surface
    /// for each texel.
    fn resolve(
        &self,
        scene: &mut LitScene<'_>,
        job: &SampleJob,
        id: SampleId,
        view: u32,
    ) -> Result<Sample, RenderError> {
        let begin = Instant::now();
        let camera = job.info.rig.camera(id.camera)?;
        let eye = scene.eye(camera.center(), &job.info.lighting)?;
        let (gpu, settings) = (scene.gpu, scene.settings);
        let planes = self.resolve.planes(gpu, settings, camera.size(), job.to_host);
        let mut stages = Vec::new();
        for tile in &scene.tiles(&camera)? {
            scene.check_wanted()?;
            let mut commands = gpu.commands("look up sample");
            let context = scene.context(&eye, tile, false);
            self.look_up(&mut commands, &context, view);
            self.resolve.record(&mut commands, &context, settings, &planes, None);
            timing::add(&mut stages, commands.submit().wait()?.stages);
        }
        let planes = planes.hand_over(gpu, job.to_host)?;
        timing::add_rest(&mut stages, begin);
        // The octree's maps have all directions.
        Ok(Sample { id, camera, faces: FaceMask::ALL, planes, stages })
    }
}

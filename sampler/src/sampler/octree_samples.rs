//! Samples from maps of an octree: leaves are shaded first, then sample cameras look them up.

use std::time::Instant;

use argus_scene::{Cancel, FaceMask, Lighting, MegaViews, RenderError, Sample, SampleId, SampleJob, Stage};

use super::{GpuSampler, add_light, check_wanted, sample_tiles};
use crate::eye::Eye;
use crate::indirect::LightSharing;
use crate::lit_octree::LitOctree;
use crate::omni_maps::{OmniMaps, groups};
use crate::passes::TileContext;
use crate::scratch::Extras;
use crate::timing;

impl GpuSampler {
    /// Renders samples of one set: builds the octree, shades its leaves, renders the maps of all cameras in few
    /// traversals, and looks up each sample in its map.
    pub(super) fn render_from_octree(
        &mut self,
        job: &SampleJob,
        knobs: MegaViews,
        cancel: &Cancel,
    ) -> Vec<Result<Sample, RenderError>> {
        let mut costs = match self.ready_maps(job, knobs, cancel) {
            Ok(Some(stages)) => stages,
            // A scene without surfaces is all sky; the triangle path renders it.
            Ok(None) => {
                return job.ids.iter().map(|&id| self.render_sample(job, id, cancel, None)).collect();
            }
            Err(error) => return vec![Err(error); job.ids.len()],
        };
        // An index that the rig does not have fails only its own sample.
        let to_render_error =
            |id: &SampleId| job.info.rig.camera(id.camera).err().map(|error| Err(error.into()));
        let mut samples: Vec<Option<Result<Sample, RenderError>>> =
            job.ids.iter().map(to_render_error).collect();
        for group in groups(&job.info.rig, &job.ids, &knobs) {
            let (gpu, rig) = (self.gpu.clone(), &job.info.rig);
            let traversed = check_wanted(cancel).and_then(|()| match &mut self.maps {
                Some(maps) => maps.traverse(&gpu, rig, &group),
                None => Err(RenderError::Internal("there are no maps".to_owned())),
            });
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
                    let mut sample = self.resolve_from_maps(job, job.ids[order], view, cancel)?;
                    timing::add(&mut sample.stages, costs);
                    Ok(sample)
                });
                samples[order] = Some(sample);
            }
        }
        let missing = || Err(RenderError::Internal("a sample is of no group".to_owned()));
        samples.into_iter().map(|sample| sample.unwrap_or_else(missing)).collect()
    }

    /// Prepares the octree of a set. Returns the cost, or `None` for a scene without surfaces.
    fn ready_maps(
        &mut self,
        job: &SampleJob,
        knobs: MegaViews,
        cancel: &Cancel,
    ) -> Result<Option<Vec<Stage>>, RenderError> {
        self.check_job(job)?;
        let (lighting, light) = (&job.info.lighting, job.info.version.state.light);
        let time_secs = job.info.time_secs();
        let mut stages = self.pose(time_secs)?;
        timing::add(&mut stages, self.light(lighting, light, time_secs)?);
        let (gpu, resident, sampler) = (self.gpu.clone(), &self.resident, &self.knobs);
        let mut maps = self.maps.take().unwrap_or_else(|| OmniMaps::new(&gpu, resident, sampler, knobs));
        maps.set_knobs(knobs);
        let lit = self.light_octree(&mut maps.octree, lighting, time_secs, cancel);
        self.maps = Some(maps);
        Ok(lit?.map(|lit| {
            timing::add(&mut stages, lit);
            stages
        }))
    }

    /// Builds the octree of the posed scene and shades its leaves, unless both are up to date. Returns the cost, or
    /// `None` for a scene without surfaces.
    pub(super) fn light_octree(
        &mut self,
        octree: &mut LitOctree,
        lighting: &Lighting,
        time_secs: f64,
        cancel: &Cancel,
    ) -> Result<Option<Vec<Stage>>, RenderError> {
        let (gpu, drifts) = (self.gpu.clone(), self.drifts());
        let posed = octree.pose(&gpu, &self.scene, &self.resident.instances)?;
        let (Some(mut stages), Some(root)) = (posed, octree.octree().map(|octree| octree.root)) else {
            return Ok(None);
        };
        if octree.is_lit(lighting, time_secs, drifts) {
            return Ok(Some(stages));
        }
        let begin = Instant::now();
        let (surfels, chunks) = (octree.make_surfels(&gpu)?, octree.chunks(&gpu));
        let extras = Extras { guides: self.keeps_guides(), ..Extras::default() };
        let middle = root.world_from_unit(glam::DVec3::splat(0.5));
        let eye = Eye::new(&gpu, &self.resident, middle, lighting)?;
        for chunk in &chunks {
            check_wanted(cancel)?;
            let mut commands = gpu.commands("shade leaves");
            let context = TileContext {
                places: octree.places(),
                ..TileContext::new(&gpu, &self.resident, &eye, &chunk.tile, &mut self.scratch, extras)
            };
            octree.shade(&mut commands, &context, chunk, &surfels);
            let (lights, sharing) = ((&self.direct, &mut self.indirect), (LightSharing::Leaves, false));
            let (mut commands, _) = add_light(lights, commands, &context, sharing, &mut stages)?;
            octree.keep(&mut commands, &context, chunk, &surfels);
            commands.submit().wait()?;
        }
        let mut commands = gpu.commands("average surfels");
        octree.light(&mut commands, surfels, lighting, time_secs);
        commands.submit().wait()?;
        timing::add_since(&mut stages, "shade leaves", begin);
        Ok(Some(stages))
    }

    /// Whether light changes with time in a static scene.
    pub(super) fn drifts(&self) -> bool {
        self.knobs.indirect.drifts()
    }

    /// Renders one sample of the group that was traversed last: per tile, looks up each sub-sample and selects a surface
    /// for each texel.
    fn resolve_from_maps(
        &mut self,
        job: &SampleJob,
        id: SampleId,
        view: u32,
        cancel: &Cancel,
    ) -> Result<Sample, RenderError> {
        let begin = Instant::now();
        let camera = job.info.rig.camera(id.camera)?;
        let eye = self.eye(camera.center(), &job.info.lighting)?;
        let Some(maps) = &self.maps else {
            return Err(RenderError::Internal("there are no maps".to_owned()));
        };
        let planes = maps.resolve.planes(&self.gpu, &self.knobs, camera.size(), job.to_host);
        let mut stages = Vec::new();
        for tile in &sample_tiles(&camera, self.knobs.side())? {
            check_wanted(cancel)?;
            let mut commands = self.gpu.commands("look up sample");
            let (gpu, resident) = (&self.gpu, &self.resident);
            let context = TileContext::new(gpu, resident, &eye, tile, &mut self.scratch, Extras::default());
            maps.look_up(&mut commands, &context, view);
            maps.resolve.record(&mut commands, &context, &self.knobs, &planes, None);
            timing::add(&mut stages, commands.submit().wait()?.stages);
        }
        let planes = self.hand_over(&planes, camera.size(), job.to_host)?;
        timing::add_rest(&mut stages, begin);
        // The octree's maps have all directions.
        Ok(Sample { id, camera, faces: FaceMask::ALL, planes, stages })
    }
}

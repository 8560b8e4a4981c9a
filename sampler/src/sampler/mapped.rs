//! Samples that come from maps of an octree: the surfaces are shaded, then the cameras look at what was shaded.

use std::time::Instant;

use argus_scene::{Cancel, Lighting, MegaViews, RenderError, Sample, SampleId, SampleJob, Stage};

use super::{GpuSampler, add_light, check_wanted, sample_tiles};
use crate::eye::Eye;
use crate::indirect::Spreading;
use crate::lit_octree::LitOctree;
use crate::omni_maps::{OmniMaps, groups};
use crate::passes::TileContext;
use crate::scratch::Extras;
use crate::timing;

impl GpuSampler {
    /// Samples of one set: the scene as an octree, its leaves shaded, the maps of all cameras in as few traversals as
    /// can be, and each sample looked up in its own.
    pub(super) fn render_mapped(
        &mut self,
        job: &SampleJob,
        knobs: MegaViews,
        cancel: &Cancel,
    ) -> Vec<Result<Sample, RenderError>> {
        let mut costs = match self.ready_maps(job, knobs, cancel) {
            Ok(Some(stages)) => stages,
            // Without surfaces all is sky, which triangles have as well.
            Ok(None) => {
                return job.ids.iter().map(|&id| self.render_sample(job, id, cancel, &mut None)).collect();
            }
            Err(error) => return vec![Err(error); job.ids.len()],
        };
        // What the rig does not have fails alone.
        let refused = |id: &SampleId| job.info.rig.camera(id.camera).err().map(|error| Err(error.into()));
        let mut samples: Vec<Option<Result<Sample, RenderError>>> = job.ids.iter().map(refused).collect();
        for group in groups(&job.info.rig, &job.ids, &knobs) {
            let (gpu, rig) = (self.gpu.clone(), &job.info.rig);
            let traversed = check_wanted(cancel).and_then(|()| match &mut self.maps {
                Some(maps) => maps.traverse(&gpu, rig, &group),
                None => Err(RenderError::Internal("there are no maps".to_owned())),
            });
            // What a batch costs is shared evenly; the first traversal pays for what came before it.
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
                    let mut sample = self.look_sample_up(job, job.ids[order], view, cancel)?;
                    timing::add(&mut sample.stages, costs);
                    Ok(sample)
                });
                samples[order] = Some(sample);
            }
        }
        let missing = || Err(RenderError::Internal("a sample is of no group".to_owned()));
        samples.into_iter().map(|sample| sample.unwrap_or_else(missing)).collect()
    }

    /// Makes ready what samples of a set are looked up in, and what that cost; `None` for a scene without surfaces.
    fn ready_maps(
        &mut self,
        job: &SampleJob,
        knobs: MegaViews,
        cancel: &Cancel,
    ) -> Result<Option<Vec<Stage>>, RenderError> {
        self.check_job(job)?;
        let (lighting, time_secs) = (&job.info.lighting, job.info.time_secs());
        let mut stages = self.pose(time_secs);
        timing::add(&mut stages, self.light(lighting, time_secs)?);
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

    /// Builds an octree of the scene as it is posed and shades its leaves, unless that was done under these lights; `None`
    /// for a scene without surfaces.
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
        let extras = Extras { guides: self.indirect.is_some(), ..Extras::default() };
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
            let mut commands =
                add_light(&mut self.indirect, commands, &context, Spreading::Leaves, &mut stages)?;
            octree.keep(&mut commands, &context, chunk, &surfels);
            commands.submit().wait()?;
        }
        let mut commands = gpu.commands("average surfels");
        octree.light(&mut commands, surfels, lighting, time_secs);
        commands.submit().wait()?;
        timing::add_since(&mut stages, "shade leaves", begin);
        Ok(Some(stages))
    }

    /// Whether light drifts though nothing of the scene moves.
    pub(super) fn drifts(&self) -> bool {
        self.knobs.indirect.drifts()
    }

    /// One sample of the group that was traversed last: per tile, look up what each sub-sample sees, choose a surface
    /// for each texel.
    fn look_sample_up(
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
            let mut commands = self.gpu.commands("look sample up");
            let (gpu, resident) = (&self.gpu, &self.resident);
            let context = TileContext::new(gpu, resident, &eye, tile, &mut self.scratch, Extras::default());
            maps.look_up(&mut commands, &context, view);
            maps.resolve.record(&mut commands, &context, &self.knobs, &planes);
            timing::add(&mut stages, commands.submit().wait()?.stages);
        }
        let planes = self.hand_over(&planes, camera.size(), job.to_host)?;
        timing::add_rest(&mut stages, begin);
        Ok(Sample { id, camera, planes, stages })
    }
}

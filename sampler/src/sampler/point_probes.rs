//! Reflection probes from points: fills cube maps, shades the points that they show, and makes probes of both.

use std::time::Instant;

use argus_gpu::wgpu;
use argus_scene::{Cancel, ProbeSource, RenderError, Stage, rgb9e5};

use super::gpu_sampler::GpuSampler;
use crate::eye::Eye;
use crate::frame::check_wanted;
use crate::passes::ProbePlanes;
use crate::point_shading::{CHUNK_SIDE, Points, image_of};
use crate::probe_renderer::{Fill, LitAt, PointProbes, ProbeBytes, ProbePlaces};
use crate::reflected_light::{Bounces, Met, Paths, Reflectors};
use crate::resident::upload;
use crate::stages::{self, PointShading};
use crate::timing;

impl GpuSampler {
    /// Renders all probes from points. The scene must be posed at the time, and light be ready. Adds the
    /// cost to the stages `of` probes.
    pub(super) fn render_probe_points(
        &mut self,
        probes: &PointProbes,
        reflectors: &Reflectors,
        places: &ProbePlaces,
        LitAt { lighting, time_secs, .. }: LitAt<'_>,
        cancel: &Cancel,
        of: &mut Vec<Stage>,
    ) -> Result<ProbeBytes, RenderError> {
        let scene = self.scene.clone();
        let (stage, source) = match probes.source {
            Fill::Points { budget, .. } => ("reflection points", ProbeSource::Points { budget }),
            Fill::Rays => ("reflection rays", ProbeSource::Rays),
        };
        timing::add(of, self.ready_reflected(source, time_secs)?);
        let begin = Instant::now();
        let eye = Eye::new(&self.gpu, &self.resident, places.middle, lighting)?;
        let Some(reflected) = &self.surface_programs.reflected else { return Ok(ProbeBytes::default()) };
        let by = &reflected.found_by;
        let groups = PointProbes::groups(probes.source, by, &scene, places, probes.side, time_secs);
        timing::add_since(of, stage, begin);
        let mut bytes = ProbeBytes::default();
        for group in groups {
            check_wanted(cancel)?;
            let begin = Instant::now();
            let filled = PointProbes::fill(probes.source, by, &scene, places.middle, &group);
            timing::add_since(of, stage, begin);
            let texels =
                upload(&self.gpu, "texels of reflectors", &filled.texels, wgpu::BufferUsages::STORAGE)?;
            let mut shading = PointShading {
                gpu: &self.gpu,
                resident: &self.resident,
                eye: &eye,
                lights: &mut self.lights,
                programs: &probes.shade,
                scratch: &mut self.scratch,
                cancel,
            };
            let radiance = if filled.rays.is_empty() {
                let points = Points { all: filled.points, image: None };
                stages::points(&mut shading, &points, false, of)?.0
            } else {
                // Where rays that go on have their places.
                let rows = (filled.points.len() as u32).div_ceil(CHUNK_SIDE);
                let (tile, sky) = (&image_of([CHUNK_SIDE, rows]), &lighting.sky);
                let bounces = Bounces { by, maps: None, reflectors, sky, eye: places.middle, tile };
                let (paths, met) = (Paths::of_rays(&filled.rays), Met::of_points(filled.points));
                let radiance = stages::follow_rays(&bounces, paths, met, &mut shading, of)?;
                let words: Vec<u32> = radiance.into_iter().map(rgb9e5::encode).collect();
                upload(&self.gpu, "radiance of points", &words, wgpu::BufferUsages::STORAGE)?
            };
            let planes = ProbePlanes::new(&self.gpu, probes.side, filled.maps);
            let (sky, environment) = (&eye.lighting, &self.resident.environment);
            let mut commands = self.gpu.commands("resample points");
            probes.resample.record(&mut commands, &texels, &radiance, sky, environment, &planes);
            probes.blur.record(&mut commands, &planes);
            bytes.read(commands, &planes)?;
        }
        Ok(bytes)
    }
}

//! Reflection probes from points: fills cube maps, shades the points that they show, and makes probes of both.

use std::time::Instant;

use argus_gpu::wgpu;
use argus_scene::{Cancel, Lighting, ProbeEye, RenderError, Stage};

use super::{GpuSampler, add_light, check_wanted};
use crate::eye::Eye;
use crate::eye_points::PointScene;
use crate::indirect::LightSharing;
use crate::passes::{ProbePlanes, TileContext};
use crate::probe_renderer::{FilledMaps, PointProbes, ProbeBytes, ProbePlaces};
use crate::scratch::Extras;
use crate::timing;

impl GpuSampler {
    /// Renders all probes of a side in texels from points. The scene must be posed at the time, and light be ready. Adds the
    /// cost to `stages`.
    pub(super) fn render_probe_points(
        &mut self,
        probes: &PointProbes,
        places: &ProbePlaces,
        (viewers, side): (&ProbeEye, u32),
        (lighting, time_secs): (&Lighting, f64),
        cancel: &Cancel,
        stages: &mut Vec<Stage>,
    ) -> Result<ProbeBytes, RenderError> {
        let begin = Instant::now();
        let scene = self.scene.clone();
        let points = PointScene::new(&scene, time_secs);
        let eye = Eye::new(&self.gpu, &self.resident, places.middle, lighting)?;
        let groups = PointProbes::groups(&scene, places, viewers, (side, time_secs));
        timing::add_since(stages, "reflection points", begin);
        let mut bytes = ProbeBytes::default();
        for reflectors in groups {
            check_wanted(cancel)?;
            let begin = Instant::now();
            let of = (viewers, probes.budget);
            let filled = PointProbes::fill(&points, &scene, places.middle, &reflectors, of);
            timing::add_since(stages, "reflection points", begin);
            filled.report();
            let [texels, list] = filled.upload(&self.gpu)?;
            let radiance = self.shade_points(probes, &filled, &list, &eye, cancel, stages)?;
            let planes = ProbePlanes::new(&self.gpu, side, filled.maps);
            let sky = (&eye.lighting, &self.resident.environment);
            let mut commands = self.gpu.commands("resample points");
            probes.resample.record(&mut commands, (&texels, &radiance), sky, &planes);
            probes.blur.record(&mut commands, &planes);
            bytes.read(commands, &planes)?;
        }
        Ok(bytes)
    }

    /// Radiance of all points of filled maps, a word of rgb9e5 each.
    fn shade_points(
        &mut self,
        probes: &PointProbes,
        filled: &FilledMaps,
        points: &wgpu::Buffer,
        eye: &Eye,
        cancel: &Cancel,
        stages: &mut Vec<Stage>,
    ) -> Result<wgpu::Buffer, RenderError> {
        let begin = Instant::now();
        let gpu = self.gpu.clone();
        let count = filled.points.len() as u32;
        let storage = wgpu::BufferUsages::STORAGE;
        let radiance = gpu.buffer("radiance of points", u64::from(count.max(1)) * 4, storage);
        let extras = Extras { guides: self.keeps_guides(), ..Extras::default() };
        let mut of_light = Vec::new();
        for chunk in PointProbes::chunks(&gpu, count) {
            check_wanted(cancel)?;
            let mut commands = gpu.commands("shade points");
            let context = TileContext::new(&gpu, &self.resident, eye, &chunk.tile, &mut self.scratch, extras);
            probes.shade.record(&mut commands, &context, (&chunk.chunk, points));
            let (lights, sharing) = ((&self.direct, &mut self.indirect), (LightSharing::Leaves, false));
            let (mut commands, _) = add_light(lights, commands, &context, sharing, &mut of_light)?;
            probes.shade.keep(&mut commands, &context, (&chunk.chunk, &radiance));
            commands.submit().wait()?;
        }
        let lit: f64 = of_light.iter().map(|stage| stage.ms).sum();
        let all = begin.elapsed().as_secs_f64() * 1e3;
        timing::add(stages, vec![Stage::new("shade points", (all - lit).max(0.0))]);
        timing::add(stages, of_light);
        Ok(radiance)
    }
}

//! Reflection probes from points: fills cube maps, shades the points that they show, and makes probes of both.

use std::time::Instant;

use argus_gpu::wgpu;
use argus_scene::{Cancel, Lighting, RenderError, Stage};

use super::{GpuSampler, check_wanted};
use crate::eye::Eye;
use crate::eye_points::{PointScene, ReflectionRays};
use crate::indirect::LightSharing;
use crate::passes::ProbePlanes;
use crate::point_shading::PointShading;
use crate::probe_renderer::{Fill, Filler, PointProbes, ProbeBytes, ProbePlaces};
use crate::resident::upload;
use crate::timing;

impl GpuSampler {
    /// Renders all probes of a side in texels from points. The scene must be posed at the time, and light be ready. Adds the
    /// cost to `stages`.
    pub(super) fn render_probe_points(
        &mut self,
        probes: &PointProbes,
        places: &ProbePlaces,
        side: u32,
        (lighting, time_secs): (&Lighting, f64),
        cancel: &Cancel,
        stages: &mut Vec<Stage>,
    ) -> Result<ProbeBytes, RenderError> {
        let begin = Instant::now();
        let scene = self.scene.clone();
        let (stage, filler) = match probes.source {
            Fill::Points { .. } => ("reflection points", Filler::Points(PointScene::new(&scene, time_secs))),
            Fill::Rays => {
                let tracer = self.visibility.prepare_packets(&self.resident);
                let rays = ReflectionRays::of_tracer(&scene, time_secs, tracer)?;
                ("reflection rays", Filler::Rays(rays))
            }
        };
        let eye = Eye::new(&self.gpu, &self.resident, places.middle, lighting)?;
        let groups = PointProbes::groups(probes.source, &scene, places, (side, time_secs));
        timing::add_since(stages, stage, begin);
        let mut bytes = ProbeBytes::default();
        for reflectors in groups {
            check_wanted(cancel)?;
            let begin = Instant::now();
            let filled = PointProbes::fill(probes.source, &filler, &scene, places.middle, &reflectors);
            timing::add_since(stages, stage, begin);
            filled.report();
            let texels =
                upload(&self.gpu, "texels of reflectors", &filled.texels, wgpu::BufferUsages::STORAGE)?;
            let mut shading = PointShading {
                gpu: &self.gpu,
                resident: &self.resident,
                direct: &self.direct,
                indirect: &mut self.indirect,
                sharing: LightSharing::Leaves,
            };
            let scratch = &mut self.scratch;
            let radiance =
                shading.shade_to_device(&probes.shade, &filled.points, &eye, scratch, cancel, stages)?;
            let planes = ProbePlanes::new(&self.gpu, side, filled.maps);
            let sky = (&eye.lighting, &self.resident.environment);
            let mut commands = self.gpu.commands("resample points");
            probes.resample.record(&mut commands, (&texels, &radiance), sky, &planes);
            probes.blur.record(&mut commands, &planes);
            bytes.read(commands, &planes)?;
        }
        Ok(bytes)
    }
}

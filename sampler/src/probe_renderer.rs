//! Renders reflection probes: maps of radiance and range around each reflective object. Samples, direct views and compositors
//! share them. There are three sources ([`argus_scene::ProbeSource`]):
//!
//! - Rays ([`points`]): what the ray of each texel of a cube map meets is shaded.
//! - Points on triangles, if a method for them is plugged in ([`crate::plug::PointMethod`]): they fill cube maps, too.
//! - An octree of the scene, if a method for it is plugged in ([`crate::plug::ProbeMethod`]).
//!
//! Points are shaded as samples are, so probes show only diffuse light; by rays, they show what reflectors in them reflect as
//! well ([`crate::reflected_light`]).
//!
//! # Lifetime
//!
//! Once for each pose and lighting: points are found and shaded. *Resample points* makes octahedral maps of radiance and range.
//! *Blur probes* adds coarser levels, each blurred for its roughness.
//!
//! The probes of one time are one more sample of the set (`SampleId::REFLECTION_PROBES`), the last of a plan. A sample's
//! *reflector* plane names the probe of each texel, and the light that passes through it. Both roles look up probes with
//! one function (`shaders/shared/reflection_probes.wgsl`): the reflected ray is followed to the probe's stored range in
//! three steps, and looked up at the level of the surface's roughness. Glass adds the refracted ray.
//!
//! Without reflective objects or reflections, none of these programs is compiled. The reference traces rays instead
//! (`scene/src/reference/reflection.rs`); `argus-lab study method probes` measures the difference.

mod method;
mod points;

use std::time::Instant;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{
    FaceMask, InvalidField, LightLevel, Lighting, OmniLayout, Plane, PlaneData, PlaneFormat, PlaneKind,
    ProbeSource, ReflectionProbeSet, Reflector, RenderError, Sample, SampleCamera, SampleId, Scene, Stage,
};

pub use self::method::{NewProbes, ProbeBytes, ProbeMethod, ProbePlaces};
pub(crate) use self::points::{Fill, PointProbes};
use crate::SamplerSettings;
use crate::passes::{ProbeBindings, ResolveSample, Shade, ShadeSample};
use crate::reflected_light::Reflectors;
use crate::resident::{GBufferUse, Resident, upload};
use crate::settings::missing;

/// The reflection probes of one scene on one device, and the programs that look them up.
pub(crate) struct ProbeRenderer {
    pub(crate) set: ReflectionProbeSet,
    /// Instances that have a probe, and their numbers.
    pub(crate) reflectors: Reflectors,
    pub(crate) source: ProbePrograms,
    pub(crate) shade: Shade,
    pub(crate) shade_sample: ShadeSample,
    pub(crate) resolve: ResolveSample,
    made: Option<Made>,
}

/// What renders the probes.
pub(crate) enum ProbePrograms {
    /// A method that is plugged in.
    Method(Box<dyn ProbeMethod>),
    /// Cube maps that are filled by rays or points.
    Filled(Box<PointProbes>),
}

/// The light of a scene at a time in seconds.
#[derive(Clone, Copy)]
pub(crate) struct LitAt<'a> {
    pub(crate) lighting: &'a Lighting,
    pub(crate) light: LightLevel,
    pub(crate) time_secs: f64,
}

/// Rendered probes, with their lighting and time.
struct Made {
    lighting: Lighting,
    light: LightLevel,
    time_secs: f64,
    sample: Sample,
    probe_bindings: ProbeBindings,
}

impl ProbeRenderer {
    /// The probe renderer of a scene on a device.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] if the number of the scene's reflectors differs from the job's, or for a source that is not
    /// plugged in.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        resident: &Resident,
        sampler: &SamplerSettings,
        set: ReflectionProbeSet,
        new: Option<&NewProbes>,
    ) -> Result<Self, RenderError> {
        let g_buffer = GBufferUse::of(sampler);
        let reflectors = Reflectors::new(scene, set.settings.most);
        if reflectors.instances.len() != set.count as usize {
            let reason =
                format!("the scene has {} reflectors, not {}", reflectors.instances.len(), set.count);
            return Err(InvalidField::new("reflections.count", reason).into());
        }
        let filled = |fill| {
            let probes = PointProbes::new(gpu, resident, g_buffer, fill, set.settings.side);
            ProbePrograms::Filled(Box::new(probes))
        };
        let source = match (set.settings.source, set.eye) {
            (ProbeSource::Octree { levels }, _) => {
                let new = new.ok_or_else(|| missing("reflections", set.settings.source.name()))?;
                ProbePrograms::Method(new(gpu, resident, g_buffer, levels))
            }
            (ProbeSource::Points { budget }, Some(viewers)) => filled(Fill::Points { viewers, budget }),
            (ProbeSource::Points { .. }, None) => {
                return Err(InvalidField::new("reflections.viewpoints", "must be given for points").into());
            }
            (ProbeSource::Rays, _) => filled(Fill::Rays),
        };
        Ok(Self {
            set,
            reflectors,
            source,
            shade: Shade::new(gpu, resident.features, g_buffer, true),
            shade_sample: ShadeSample::new(gpu, resident.features, g_buffer, true, sampler.side()),
            resolve: ResolveSample::new(gpu, resident.features.specular, 1, true, sampler.effects.any()),
            made: None,
        })
    }

    /// Marks all as out of date, because surfaces moved.
    pub(crate) fn forget_pose(&mut self) {
        if let ProbePrograms::Method(probes) = &mut self.source {
            probes.forget_pose();
        }
        self.made = None;
    }

    /// Marks lighting as out of date.
    pub(crate) fn forget_light(&mut self) {
        if let ProbePrograms::Method(probes) = &mut self.source {
            probes.forget_light();
        }
        self.made = None;
    }

    /// Whether the probes are up to date for these lights at this time.
    pub(crate) fn is_made(&self, lit: LitAt<'_>, drifts: bool) -> bool {
        let is_now = |made: &Made| {
            let is_same = (&made.lighting, made.light) == (lit.lighting, lit.light);
            is_same && (!drifts || made.time_secs == lit.time_secs)
        };
        self.made.as_ref().is_some_and(is_now)
    }

    /// The bindings of the probes, once they are rendered.
    pub(crate) fn probe_bindings(&self) -> Option<&ProbeBindings> {
        self.made.as_ref().map(|made| &made.probe_bindings)
    }

    /// The probes as a sample, once they are rendered.
    pub(crate) fn sample(&self, id: SampleId) -> Option<Sample> {
        self.made.as_ref().map(|made| Sample { id, ..made.sample.clone() })
    }

    /// Where the probes are at a time.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the device cannot bind a word for each instance.
    pub(crate) fn places(
        &self,
        gpu: &Gpu,
        scene: &Scene,
        time_secs: f64,
    ) -> Result<ProbePlaces, RenderError> {
        let middle = scene.bounds().center();
        let posed = scene.at(time_secs);
        let reflectors = self.reflectors.instances.iter().map(|&index| {
            let instance = &posed.instances[index as usize];
            // An object of zero size reflects nothing; its probe is rendered at the scene's centre.
            scene.reflector(index, instance).unwrap_or(Reflector {
                instance: index,
                center: middle,
                radius: 0.0,
            })
        });
        let spheres = reflectors
            .map(|reflector| (reflector.center - middle).as_vec3().extend(reflector.radius as f32))
            .collect();
        let probe_of_instance =
            upload(gpu, "probes of instances", &self.reflectors.numbers, wgpu::BufferUsages::STORAGE)?;
        Ok(ProbePlaces { middle, spheres, instances: self.reflectors.instances.clone(), probe_of_instance })
    }

    /// Takes over rendered probes, for a lighting and a time. Returns the cost since `begin`.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn take_over(
        &mut self,
        gpu: &Gpu,
        places: ProbePlaces,
        bytes: ProbeBytes,
        lit: LitAt<'_>,
        begin: Instant,
    ) -> Result<Vec<Stage>, RenderError> {
        let layout = OmniLayout::ReflectionProbes { side: self.set.settings.side, count: self.set.count };
        let camera = SampleCamera::Omni { center: places.middle, layout };
        let plane = |kind, format, bytes| Plane {
            kind,
            format,
            size: Plane::size_of(kind, &camera),
            data: PlaneData::Host(bytes),
        };
        let spheres = bytemuck::cast_slice(&places.spheres).to_vec();
        let sample = Sample {
            id: SampleId { version: 0, camera: SampleId::REFLECTION_PROBES },
            camera,
            faces: FaceMask::ALL,
            planes: vec![
                plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat, bytes.radiance.freeze()),
                plane(PlaneKind::InverseRange, PlaneFormat::R32Float, bytes.inverse_range.freeze()),
                plane(PlaneKind::ProbeSphere, PlaneFormat::R32Float, spheres.into()),
            ],
            stages: Vec::new(),
        };
        let probes = argus_gpu::ReflectionProbes::new(gpu, &sample)?;
        let stages = vec![Stage::new("reflection probes", begin.elapsed().as_secs_f64() * 1e3)];
        self.made = Some(Made {
            lighting: lit.lighting.clone(),
            light: lit.light,
            time_secs: lit.time_secs,
            sample: Sample { stages: stages.clone(), ..sample },
            probe_bindings: ProbeBindings { probes, probe_of_instance: places.probe_of_instance },
        });
        Ok(stages)
    }
}

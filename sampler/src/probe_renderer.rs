//! Renders reflection probes: maps of radiance and range around each reflective object, from an octree of the scene
//! (ManyLoDs, Holländer et al. 2011, section 5). Samples, direct views and compositors share them.
//!
//! One traversal renders all probes, with a cut through the octree for each. Nodes that belong to one object alone are
//! culled from its own probe. The octree's leaves are shaded as samples are, so reflections show only diffuse light.
//!
//! # Lifetime
//!
//! Once for each pose and lighting: the lit octree is built, and one traversal renders it for all objects. *Resample
//! probes* turns each dual paraboloid into an octahedral map of radiance and range. *Blur probes* adds coarser levels,
//! each blurred for its roughness.
//!
//! The probes of one time are one more sample of the set (`SampleId::REFLECTION_PROBES`), the last of a plan. A sample's
//! *reflector* plane names the probe of each texel, and the light that passes through it. Both roles look up probes with
//! one function (`shaders/shared/reflection_probes.wgsl`): the reflected ray is followed to the probe's stored range in
//! three steps, and looked up at the level of the surface's roughness. Glass adds the refracted ray.
//!
//! Without reflective objects or reflections, none of these programs is compiled. The reference traces rays instead
//! (`scene/src/reference/reflection.rs`); `argus study reflections` measures the difference.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::many_views::{ManyViews, NodeOwners, ViewList, ViewPoint};
use argus_gpu::{Gpu, wgpu};
use argus_scene::{
    FaceMask, InvalidField, Lighting, OmniLayout, Plane, PlaneData, PlaneFormat, PlaneKind,
    ReflectionProbeSet, Reflector, RenderError, Sample, SampleCamera, SampleId, Scene, Stage,
};
use bytes::BytesMut;
use glam::DVec3;

use crate::SamplerKnobs;
use crate::eye::Eye;
use crate::lit_octree::{LitOctree, map_knobs, to_render_error};
use crate::passes::{NodeMaps, OwnNodes, ProbePlanes, ResampleProbes, ResolveSample, Shade, ShadeSample};
use crate::resident::{GuideUse, Resident, upload};

/// Most bytes of probes that are rendered at once: a few thousand small ones, or sixteen of the largest.
const MOST_BYTES: u64 = 64 << 20;

/// The reflection probes of one scene on one device, and the programs that look them up.
pub(crate) struct ProbeRenderer {
    pub(crate) set: ReflectionProbeSet,
    /// Instances that have a probe.
    reflectors: Vec<u32>,
    pub(crate) octree: LitOctree,
    own_nodes: OwnNodes,
    resample: ResampleProbes,
    /// Kept across octrees, because its programs are reused.
    views: Option<ManyViews>,
    pub(crate) shade: Shade,
    pub(crate) shade_sample: ShadeSample,
    pub(crate) resolve: ResolveSample,
    made: Option<Made>,
}

/// Rendered probes, with their lighting and time.
struct Made {
    lighting: Lighting,
    time_secs: f64,
    sample: Sample,
    probe_bindings: ProbeBindings,
}

/// The probes that shading programs bind.
pub(crate) struct ProbeBindings {
    pub(crate) probes: argus_gpu::ReflectionProbes,
    /// For each instance 1 + the index of its probe; 0 for none.
    pub(crate) probe_of_instance: wgpu::Buffer,
}

impl ProbeBindings {
    /// Bindings without probes.
    pub(crate) fn none(gpu: &Gpu) -> Self {
        Self {
            probes: argus_gpu::ReflectionProbes::none(gpu),
            probe_of_instance: gpu.buffer("no probes of instances", 16, wgpu::BufferUsages::STORAGE),
        }
    }
}

impl ProbeRenderer {
    /// The probe renderer of a scene on a device.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] if the number of the scene's reflectors differs from the job's.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        resident: &Resident,
        sampler: &SamplerKnobs,
        set: ReflectionProbeSet,
    ) -> Result<Self, RenderError> {
        let guides = GuideUse::of(sampler);
        let reflectors = scene.reflectors(set.knobs.most);
        if reflectors.len() != set.count as usize {
            let reason = format!("the scene has {} reflectors, not {}", reflectors.len(), set.count);
            return Err(InvalidField::new("reflections.count", reason).into());
        }
        Ok(Self {
            set,
            reflectors,
            octree: LitOctree::new(gpu, resident, guides, set.knobs.levels),
            own_nodes: OwnNodes::new(gpu),
            resample: ResampleProbes::new(gpu, 1),
            views: None,
            shade: Shade::new(gpu, resident.features, guides, true),
            shade_sample: ShadeSample::new(gpu, resident.features, guides, true, sampler.side()),
            resolve: ResolveSample::new(gpu, resident.features.specular, 1, true, sampler.effects.any()),
            made: None,
        })
    }

    /// Marks all as out of date, because surfaces moved.
    pub(crate) fn forget_pose(&mut self) {
        self.octree.forget_pose();
        self.made = None;
    }

    /// Marks lighting as out of date.
    pub(crate) fn forget_light(&mut self) {
        self.octree.forget_light();
        self.made = None;
    }

    /// Whether the probes are up to date for these lights at this time.
    pub(crate) fn is_made(&self, lighting: &Lighting, time_secs: f64, drifts: bool) -> bool {
        let is_now = |made: &Made| made.lighting == *lighting && (!drifts || made.time_secs == time_secs);
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

    /// Renders the probes. The octree must be lit and the scene posed at `time_secs`.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`], or the errors of the device.
    pub(crate) fn make(
        &mut self,
        gpu: &Arc<Gpu>,
        scene: &Scene,
        resident: &Resident,
        lighting: &Lighting,
        time_secs: f64,
    ) -> Result<Vec<Stage>, RenderError> {
        let begin = Instant::now();
        let side = self.set.knobs.side;
        let middle = scene.bounds().center();
        let posed = scene.at(time_secs);
        let reflectors = self.reflectors.iter().map(|&index| {
            let instance = &posed.instances[index as usize];
            // An object of zero size reflects nothing; its probe is rendered at the scene's centre.
            scene.reflector(index, instance).unwrap_or(Reflector {
                instance: index,
                center: middle,
                radius: 0.0,
            })
        });
        let spheres: Vec<[f32; 4]> = reflectors
            .map(|reflector| (reflector.center - middle).as_vec3().extend(reflector.radius as f32).to_array())
            .collect();
        let mut probe_of_instance = vec![0u32; resident.instance_count.max(1)];
        for (number, &instance) in (1..).zip(&self.reflectors) {
            probe_of_instance[instance as usize] = number;
        }
        let probe_of_instance =
            upload(gpu, "probes of instances", &probe_of_instance, wgpu::BufferUsages::STORAGE)?;

        let [mut radiance, mut inverse_range] = [BytesMut::new(), BytesMut::new()];
        if let Some(octree) = self.octree.octree().cloned() {
            let mut commands = gpu.commands("own nodes");
            let owners = self.octree.owners(gpu, &mut commands, &self.own_nodes, &probe_of_instance);
            commands.submit().wait()?;
            let owners = owners
                .ok_or_else(|| RenderError::Internal("the octree has no owners of nodes".to_owned()))?;
            // From the stored f32 positions, which lookups use too.
            let seen_from = |place: &[f32; 4]| {
                let [x, y, z, _] = place.map(f64::from);
                ViewPoint::everywhere(middle + DVec3::new(x, y, z))
            };
            let points: Vec<ViewPoint> = spheres.iter().map(seen_from).collect();
            let eye = Eye::new(gpu, resident, middle, lighting)?;
            let most = (MOST_BYTES / ProbePlanes::bytes_of_map(side)).max(1) as usize;
            for (first, points) in (0..).step_by(most).zip(points.chunks(most)) {
                let list = ViewList::new(gpu, &octree.root, points)?;
                let own = NodeOwners { owners: owners.clone(), first };
                let kept = self.views.take();
                let traversed = ManyViews::reuse_or_new(kept, gpu, &octree, map_knobs(side, &octree));
                let mut traversed = traversed.map_err(to_render_error)?;
                traversed.cull_own_nodes(own).map_err(to_render_error)?;
                traversed.render(&list).map_err(to_render_error)?;
                if traversed.maps().arrays.len() != self.resample.arrays() {
                    self.resample = ResampleProbes::new(gpu, traversed.maps().arrays.len());
                }
                let planes = ProbePlanes::new(gpu, side, points.len() as u32);
                let missing = || RenderError::Internal("the octree was not lit".to_owned());
                let lit = self.octree.nodes().ok_or_else(missing)?;
                let maps =
                    NodeMaps { octree: lit.octree, views: &traversed, surfels: lit.surfels, ends: lit.ends };
                let mut commands = gpu.commands("resample probes");
                self.resample.record(gpu, &mut commands, &maps, &eye.lighting, &planes);
                let pending = [&planes.radiance, &planes.inverse_range]
                    .map(|plane| commands.read_buffer(plane, 0..plane.size()));
                let mut finished = commands.submit().wait()?;
                let [one, other] = pending.map(|pending| finished.take(pending));
                radiance.extend_from_slice(&one);
                inverse_range.extend_from_slice(&other);
                self.views = Some(traversed);
            }
        }
        let layout = OmniLayout::ReflectionProbes { side, count: self.set.count };
        let camera = SampleCamera::Omni { center: middle, layout };
        let plane = |kind, format, bytes| Plane {
            kind,
            format,
            size: Plane::size_of(kind, &camera),
            data: PlaneData::Host(bytes),
        };
        let spheres = bytemuck::cast_slice(&spheres).to_vec();
        let sample = Sample {
            id: SampleId { version: 0, camera: SampleId::REFLECTION_PROBES },
            camera,
            faces: FaceMask::ALL,
            planes: vec![
                plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat, radiance.freeze()),
                plane(PlaneKind::InverseRange, PlaneFormat::R32Float, inverse_range.freeze()),
                plane(PlaneKind::ProbeSphere, PlaneFormat::R32Float, spheres.into()),
            ],
            stages: Vec::new(),
        };
        let probes = argus_gpu::ReflectionProbes::new(gpu, &sample)?;
        let stages = vec![Stage::new("reflection probes", begin.elapsed().as_secs_f64() * 1e3)];
        self.made = Some(Made {
            lighting: lighting.clone(),
            time_secs,
            sample: Sample { stages: stages.clone(), ..sample },
            probe_bindings: ProbeBindings { probes, probe_of_instance },
        });
        Ok(stages)
    }
}

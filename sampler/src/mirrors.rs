//! What glossy and transparent things mirror of the scene: maps of an octree of it around each of them (ManyLoDs,
//! Holländer et al. 2011, section 5), made once a pose and lighting, for samples, direct views and compositors alike.
//!
//! All maps come from one traversal, a cut through the octree for each; a thing is left out of its own map, by what of
//! the octree belongs to it alone. The octree's leaves are shaded as samples are: what is seen in a reflection is diffuse.
//!
//! # Life of the maps
//!
//! Once for each pose and lighting: a lit octree is built; one traversal with a cut for each object's view renders it; *look around*
//! turns each dual paraboloid into an octahedral map of radiance and range; *blur surroundings* adds coarser levels, each blurred as a
//! surface of its roughness would. Octree nodes that belong to one object alone (*own nodes*) are culled for that object's view.
//!
//! The maps of a moment are one more sample of the set (`SampleId::SURROUNDINGS`). They are rendered, sent, held, evicted and pinned
//! like any other; plans name it last. A sample's *reflector* plane says which map each texel looks up, and what passes through it. Both
//! roles look up with one function (`shaders/shared/surroundings.wgsl`): the reflected ray is followed to the range that the map stores,
//! in three steps, and looked up at the level of the surface's roughness. Glass adds the refracted ray.
//!
//! A scene without reflective objects, or a set without reflections, compiles no program for any of this. The reference follows rays
//! instead (`scene/src/reference/reflection.rs`), and `argus study reflections` measures the difference.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::many_views::{ManyViews, Own, ViewList, ViewPoint};
use argus_gpu::{Gpu, wgpu};
use argus_scene::{
    InvalidField, Lighting, OmniLayout, Plane, PlaneData, PlaneFormat, PlaneKind, Reflector, RenderError,
    Sample, SampleCamera, SampleId, Scene, Stage, Surroundings,
};
use bytes::BytesMut;
use glam::DVec3;

use crate::SamplerKnobs;
use crate::eye::Eye;
use crate::lit_octree::{LitOctree, pictures, refused};
use crate::passes::{AroundPlanes, LookAround, NodeMaps, OwnNodes, ResolveSample, Shade, ShadeSample};
use crate::resident::{Resident, upload};

/// Bytes of maps in the making: a few thousand small ones, or sixteen of the largest.
const MOST_BYTES: u64 = 64 << 20;

/// The maps of one scene on one device, and the programs of whoever looks them up.
pub(crate) struct Mirrors {
    pub(crate) of: Surroundings,
    /// Instances that have a map.
    reflectors: Vec<u32>,
    pub(crate) octree: LitOctree,
    own_nodes: OwnNodes,
    look: LookAround,
    /// Their programs outlast the octree that they were made for.
    views: Option<ManyViews>,
    pub(crate) shade: Shade,
    pub(crate) shade_sample: ShadeSample,
    pub(crate) resolve: ResolveSample,
    made: Option<Made>,
}

/// Maps, and the lights and time that they were made under.
struct Made {
    lighting: Lighting,
    time_secs: f64,
    sample: Sample,
    mirrored: Mirrored,
}

/// What shading looks up.
pub(crate) struct Mirrored {
    pub(crate) surroundings: argus_gpu::Surroundings,
    /// Of each instance, 1 + the number of its map; 0 for none.
    pub(crate) map_of_instance: wgpu::Buffer,
}

impl Mirrored {
    /// Nothing.
    pub(crate) fn none(gpu: &Gpu) -> Self {
        Self {
            surroundings: argus_gpu::Surroundings::none(gpu),
            map_of_instance: gpu.buffer("no maps of instances", 16, wgpu::BufferUsages::STORAGE),
        }
    }
}

impl Mirrors {
    /// For a scene that lies on a device.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] where the scene has another number of reflectors than it was said to have.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        resident: &Resident,
        sampler: &SamplerKnobs,
        of: Surroundings,
    ) -> Result<Self, RenderError> {
        let keeps_guides = sampler.indirect != crate::Indirect::Off;
        let reflectors = scene.reflectors(of.knobs.most);
        if reflectors.len() != of.count as usize {
            let reason = format!("the scene has {} reflectors, not {}", reflectors.len(), of.count);
            return Err(InvalidField::new("reflections.count", reason).into());
        }
        Ok(Self {
            of,
            reflectors,
            octree: LitOctree::new(gpu, resident, keeps_guides, of.knobs.levels),
            own_nodes: OwnNodes::new(gpu),
            look: LookAround::new(gpu, 1),
            views: None,
            shade: Shade::new(gpu, resident.features, keeps_guides, true),
            shade_sample: ShadeSample::new(gpu, resident.features, keeps_guides, true, sampler.side()),
            resolve: ResolveSample::new(gpu, resident.features.specular, 1, true),
            made: None,
        })
    }

    /// Surfaces lie elsewhere.
    pub(crate) fn forget_pose(&mut self) {
        self.octree.forget_pose();
        self.made = None;
    }

    /// Surfaces are lit by other lights.
    pub(crate) fn forget_light(&mut self) {
        self.octree.forget_light();
        self.made = None;
    }

    /// Whether the maps are those under these lights at this time.
    pub(crate) fn is_made(&self, lighting: &Lighting, time_secs: f64, drifts: bool) -> bool {
        let is_now = |made: &Made| made.lighting == *lighting && (!drifts || made.time_secs == time_secs);
        self.made.as_ref().is_some_and(is_now)
    }

    /// What shading looks up, once it was made.
    pub(crate) fn mirrored(&self) -> Option<&Mirrored> {
        self.made.as_ref().map(|made| &made.mirrored)
    }

    /// The maps as a sample, once they were made.
    pub(crate) fn sample(&self, id: SampleId) -> Option<Sample> {
        self.made.as_ref().map(|made| Sample { id, ..made.sample.clone() })
    }

    /// Makes the maps, once the octree is lit; the scene is posed at `time_secs`.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for what the device cannot hold, or the device.
    pub(crate) fn make(
        &mut self,
        gpu: &Arc<Gpu>,
        scene: &Scene,
        resident: &Resident,
        lighting: &Lighting,
        time_secs: f64,
    ) -> Result<Vec<Stage>, RenderError> {
        let begin = Instant::now();
        let side = self.of.knobs.side;
        let middle = scene.bounds().center();
        let posed = scene.at(time_secs);
        let reflectors = self.reflectors.iter().map(|&index| {
            let instance = &posed.instances[index as usize];
            // What has been shrunk to nothing mirrors nothing; its map shows what is in the middle.
            scene.reflector(index, instance).unwrap_or(Reflector {
                instance: index,
                center: middle,
                radius: 0.0,
            })
        });
        let places: Vec<[f32; 4]> = reflectors
            .map(|reflector| (reflector.center - middle).as_vec3().extend(reflector.radius as f32).to_array())
            .collect();
        let mut map_of_instance = vec![0u32; resident.instance_count.max(1)];
        for (number, &instance) in (1..).zip(&self.reflectors) {
            map_of_instance[instance as usize] = number;
        }
        let map_of_instance =
            upload(gpu, "maps of instances", &map_of_instance, wgpu::BufferUsages::STORAGE)?;

        let [mut radiance, mut inverse_range] = [BytesMut::new(), BytesMut::new()];
        if let Some(octree) = self.octree.octree().cloned() {
            let mut commands = gpu.commands("own nodes");
            let owners = self.octree.owners(gpu, &mut commands, &self.own_nodes, &map_of_instance);
            commands.submit().wait()?;
            let owners = owners.ok_or_else(|| RenderError::Internal("nodes belong to nobody".to_owned()))?;
            // From the places as they are stored, so that whoever looks maps up knows where they are seen from.
            let seen_from = |place: &[f32; 4]| {
                let [x, y, z, _] = place.map(f64::from);
                ViewPoint::everywhere(middle + DVec3::new(x, y, z))
            };
            let points: Vec<ViewPoint> = places.iter().map(seen_from).collect();
            let eye = Eye::new(gpu, resident, middle, lighting)?;
            let most = (MOST_BYTES / AroundPlanes::bytes_of_map(side)).max(1) as usize;
            for (first, points) in (0..).step_by(most).zip(points.chunks(most)) {
                let list = ViewList::new(gpu, &octree.root, points)?;
                let own = Own { of_nodes: owners.clone(), first };
                let kept = self.views.take();
                let traversed = ManyViews::kept_or_new(kept, gpu, &octree, pictures(side, &octree));
                let mut traversed = traversed.map_err(refused)?;
                traversed.leave_out(own).map_err(refused)?;
                traversed.render(&list).map_err(refused)?;
                if traversed.maps().arrays.len() != self.look.arrays() {
                    self.look = LookAround::new(gpu, traversed.maps().arrays.len());
                }
                let planes = AroundPlanes::new(gpu, side, points.len() as u32);
                let missing = || RenderError::Internal("the octree was not lit".to_owned());
                let lit = self.octree.nodes().ok_or_else(missing)?;
                let maps =
                    NodeMaps { octree: lit.octree, views: &traversed, surfels: lit.surfels, ends: lit.ends };
                let mut commands = gpu.commands("look around");
                self.look.record(gpu, &mut commands, &maps, &eye.lighting, &planes);
                let tickets = [&planes.radiance, &planes.inverse_range]
                    .map(|plane| commands.read_buffer(plane, 0..plane.size()));
                let mut finished = commands.submit().wait()?;
                let [one, other] = tickets.map(|ticket| finished.take(ticket));
                radiance.extend_from_slice(&one);
                inverse_range.extend_from_slice(&other);
                self.views = Some(traversed);
            }
        }
        let layout = OmniLayout::Surroundings { side, count: self.of.count };
        let camera = SampleCamera::Omni { center: middle, layout };
        let plane = |kind, format, bytes| Plane {
            kind,
            format,
            size: Plane::size_of(kind, &camera),
            data: PlaneData::Host(bytes),
        };
        let places = bytemuck::cast_slice(&places).to_vec();
        let sample = Sample {
            id: SampleId { version: 0, camera: SampleId::SURROUNDINGS },
            camera,
            planes: vec![
                plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat, radiance.freeze()),
                plane(PlaneKind::InverseRange, PlaneFormat::R32Float, inverse_range.freeze()),
                plane(PlaneKind::Place, PlaneFormat::R32Float, places.into()),
            ],
            stages: Vec::new(),
        };
        let surroundings = argus_gpu::Surroundings::new(gpu, &sample)?;
        let stages = vec![Stage::new("look around", begin.elapsed().as_secs_f64() * 1e3)];
        self.made = Some(Made {
            lighting: lighting.clone(),
            time_secs,
            sample: Sample { stages: stages.clone(), ..sample },
            mirrored: Mirrored { surroundings, map_of_instance },
        });
        Ok(stages)
    }
}

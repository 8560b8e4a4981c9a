//! Indexed maps of a view: around each reflector in it, which point each texel sees (Gavane and Watson 2022, section 4.1.1).
//!
//! The eye is the view itself. Its pixels set the density of points and the sizes of maps, and only reflectors in the view
//! have a map. Points are not shaded until a lookup meets them. They are made and looked up on the device, if the method has one,
//! or on the CPU.

use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock};

use argus_scene::{Scene, ViewJob};
use glam::DVec3;
use rayon::prelude::*;
use tracing::warn;

use argus_sampler::plug::{MappedReflector, Met, Points, Ray, Requests, SurfacePoint, ViewMaps, probe_point};

use crate::device::PointsError;
use crate::layout::PointRay;
use crate::{
    BudgetReport, DevicePoints, Eye, EyePointSettings, EyePoints, LARGEST_SIDE, PointDevice, PointScene,
    STEPS, curved_reflector, lookup, planar_reflector,
};

/// Distances below this share of the scene's extent count as this, in the density of points.
const NEAR: f64 = 1e-5;

/// A scene at a pose, and the device that finds what views reflect in it.
pub(crate) struct PluggedPoints {
    pub(crate) points: PointScene,
    pub(crate) device: Option<PointDevice>,
}

/// Maps around the reflectors that a view sees.
pub(crate) struct IndexedMaps {
    method: Arc<PluggedPoints>,
    eye: Eye,
    settings: EyePointSettings,
    reflectors: Vec<MappedReflector>,
    /// For each reflector of the scene the number of its map.
    map_of: Vec<Option<u32>>,
    /// What the device found.
    on_device: Option<DevicePoints>,
    /// What the CPU found, if it was asked.
    found: OnceLock<EyePoints>,
}

impl IndexedMaps {
    /// Maps of a view at a time in seconds, from at most `budget` points. `instances` reflect; `ids` are the view's visibility:
    /// instance + 1 and triangle, or zeros for the sky.
    pub(crate) fn new(
        method: Arc<PluggedPoints>,
        scene: &Scene,
        (instances, ids): (&[u32], &[[u32; 2]]),
        view: &ViewJob,
        time_secs: f64,
        budget: u32,
    ) -> Self {
        let near = (NEAR * scene.bounds().size().max_element()).max(f64::MIN_POSITIVE);
        let eye = Eye::of(&view.camera, view.width, view.height, near);
        let in_view: BTreeSet<u32> = ids.iter().filter_map(|[instance, _]| instance.checked_sub(1)).collect();
        let posed = scene.at(time_secs).instances;
        let mut reflectors = Vec::new();
        let map_of = instances.iter().map(|&index| {
            let instance = in_view.contains(&index).then(|| &posed[index as usize])?;
            let reflector = planar_reflector(scene, index, instance, &eye)
                .or_else(|| curved_reflector(scene, index, instance, &eye, LARGEST_SIDE))?;
            reflectors.push(reflector);
            Some(reflectors.len() as u32 - 1)
        });
        let map_of = map_of.collect();
        // The device makes more points faster than the CPU finds which culled triangles stand alone.
        let culling = method.device.is_none();
        let settings = EyePointSettings { budget, culling, ..EyePointSettings::default() };
        let mut maps =
            Self { method, eye, settings, reflectors, map_of, on_device: None, found: OnceLock::new() };
        let filled =
            maps.method.device.as_ref().map(|device| {
                maps.method.points.fill_on(device, &maps.eye, &maps.reflectors, &maps.settings)
            });
        match filled {
            Some(Ok(filled)) => {
                maps.warn_of_budget(&filled.budget);
                maps.on_device = Some(filled);
            }
            Some(Err(error)) => warn!(%error, "the CPU finds what a view reflects, since the device failed"),
            None => (),
        }
        if maps.on_device.is_none() {
            maps.by_cpu();
        }
        maps
    }

    fn warn_of_budget(&self, budget: &BudgetReport) {
        let BudgetReport { wanted, reduction, .. } = *budget;
        if reduction < 1.0 {
            let budget = self.settings.budget;
            warn!(wanted, budget, reduction, "reflections of a view are coarser: it wants more points");
        }
    }

    /// Points and maps of the CPU.
    fn by_cpu(&self) -> &EyePoints {
        self.found.get_or_init(|| {
            let found = self.method.points.points(&self.eye, &self.reflectors, &self.settings);
            self.warn_of_budget(&found.budget);
            found
        })
    }

    /// The number of the map that a ray is looked up in.
    fn map_of(&self, ray: &Ray) -> Option<u32> {
        *self.map_of.get(ray.reflector as usize)?
    }

    fn meet_on_cpu(&self, eye: DVec3, rays: &[Ray]) -> Met {
        let found = self.by_cpu();
        let requests = Requests::none(found.count());
        let ids = rays.par_iter().with_min_len(256).map(|ray| {
            let map = self.map_of(ray)? as usize;
            let about = eye + ray.start.as_dvec3() - self.reflectors[map].center;
            let texel = lookup(&found.maps, map, about, ray.direction.as_dvec3(), STEPS);
            let (id, _) = found.maps.get(texel)?;
            requests.add(id);
            Some(id)
        });
        let ids: Vec<Option<u32>> = ids.collect();
        let requests = requests.counted();
        let points: Vec<SurfacePoint> =
            requests.ids().par_iter().map(|id| self.method.points.shading_of_point(found, *id)).collect();
        met(&points, eye, ids.par_iter().map(|id| id.map(|id| requests.slot(id) as u32)).collect())
    }

    fn meet_on_device(
        &self,
        (device, filled): (&PointDevice, &DevicePoints),
        eye: DVec3,
        rays: &[Ray],
    ) -> Result<Met, PointsError> {
        let about = |ray: &Ray| {
            let map = self.map_of(ray);
            let center = map.map_or(DVec3::ZERO, |map| self.reflectors[map as usize].center);
            PointRay {
                start: (eye - center + ray.start.as_dvec3()).as_vec3().to_array(),
                map: map.unwrap_or(u32::MAX),
                direction: ray.direction.to_array(),
                _end: 0.0,
            }
        };
        let about: Vec<PointRay> = rays.par_iter().with_min_len(1024).map(about).collect();
        let on_device = device.passes.rays(&about);
        let requested = device.passes.request(&filled.turns, &on_device, STEPS, filled.count())?;
        let points = self.method.points.requested_points(device, filled, &requested)?;
        let slots = device.passes.slots(&on_device, &requested)?;
        Ok(met(&points, eye, slots.into_iter().map(|slot| slot.checked_sub(1)).collect()))
    }
}

/// What rays met, about an eye.
fn met(points: &[SurfacePoint], eye: DVec3, of_ray: Vec<Option<u32>>) -> Met {
    let all = points.par_iter().map(|point| probe_point(point, eye)).collect();
    Met { points: Points { all, image: None }, of_ray }
}

impl ViewMaps for IndexedMaps {
    fn meet(&self, eye: DVec3, rays: &[Ray]) -> Met {
        let on_device = self.method.device.as_ref().zip(self.on_device.as_ref());
        match on_device.map(|on_device| self.meet_on_device(on_device, eye, rays)) {
            Some(Ok(met)) => met,
            Some(Err(error)) => {
                warn!(%error, "the CPU finds what a view reflects, since the device failed");
                self.meet_on_cpu(eye, rays)
            }
            None => self.meet_on_cpu(eye, rays),
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::procedural::{rooms, with_balls};
    use argus_scene::{Camera, Plan, Reflections};
    use glam::Vec3;

    use super::*;
    use crate::compute_tests::gpu;

    #[test]
    fn a_views_rays_meet_on_the_device_what_they_meet_on_the_cpu() {
        let scene = Arc::new(with_balls(rooms(20), 4).unwrap());
        let instances = scene.reflectors(Reflections::default().most);
        let ids: Vec<[u32; 2]> = instances[1..].iter().map(|instance| [instance + 1, 0]).collect();
        let camera: Camera = scene.default_camera();
        let view = ViewJob::new(camera, [320, 240], Plan::direct(1));
        let ways = [false, true].map(|has_device| {
            let points = PointScene::new(&scene, 0.0);
            let device = has_device.then(|| PointDevice::new(&gpu(), &points));
            let method = Arc::new(PluggedPoints { points, device });
            IndexedMaps::new(method, &scene, (&instances, &ids), &view, 0.0, 1 << 22)
        });
        assert!(ways[0].on_device.is_none() && ways[1].on_device.is_some());
        let eye = camera.eye;
        let ray = |i: u32| {
            let number = i % instances.len() as u32;
            let turn = f64::from(i) * 2.4;
            let height = f64::from(i) / 1000.0 - 1.0;
            let ring = (1.0 - height * height).max(0.0).sqrt();
            let normal = DVec3::new(ring * turn.cos(), height, ring * turn.sin());
            let map = ways[0].map_of[number as usize];
            let place = map.map_or(DVec3::ZERO, |map| {
                let reflector = &ways[0].reflectors[map as usize];
                reflector.center + normal * reflector.radius
            });
            let direction = (normal + DVec3::new(0.2, 0.1, -0.3)).normalize().as_vec3();
            let start = (place - eye).as_vec3();
            Ray {
                start,
                direction,
                reflector: number,
                past: None,
                width: 0.0,
                spread: 0.0,
                at: i,
                is_through: false,
            }
        };
        let rays: Vec<Ray> = (0..2000).map(ray).collect();
        let [cpu, device] = [0, 1].map(|way| ways[way].meet(eye, &rays));
        assert!(ways[1].found.get().is_none(), "the CPU made no points");
        assert_eq!(device.of_ray.len(), rays.len());
        let place = |met: &Met, slot: u32| Vec3::from_array(met.points.all[slot as usize].position);
        let differs = |(a, b): &(&Option<u32>, &Option<u32>)| match (a, b) {
            (Some(a), Some(b)) => {
                let (a, b) = (place(&cpu, *a), place(&device, *b));
                (a - b).length() > 0.02 * a.length()
            }
            (None, None) => false,
            _ => true,
        };
        let others = cpu.of_ray.iter().zip(&device.of_ray).filter(differs).count();
        assert!(others * 100 < rays.len(), "{others}");
        // Of a reflector that is not in the view nothing is known.
        assert!(rays.iter().zip(&device.of_ray).all(|(ray, slot)| ray.reflector > 0 || slot.is_none()));
        assert!(device.of_ray.iter().flatten().count() * 2 > rays.len());
    }
}

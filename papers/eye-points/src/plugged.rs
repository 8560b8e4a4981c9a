//! The method as a sampler uses it.
//!
//! Reflection probes: the eye is the box of the sample set's viewpoints, so that probes serve every view of the set. Direct views:
//! the eye is the view itself (`indexed.rs`), and a device finds what it
//! reflects, unless that is a software driver.

use std::sync::{Arc, OnceLock};

use argus_gpu::Gpu;
use argus_sampler::plug::{
    FilledMaps, MappedReflector, Methods, PointMethod, Requests, ViewMaps, probe_point,
};
use argus_scene::{Instance, ProbeEye, Scene, ViewJob};
use glam::DVec3;
use tracing::warn;

use crate::device::PointPasses;
use crate::indexed::{IndexedMaps, PluggedPoints};
use crate::{BudgetReport, Density, Eye, EyePointSettings, PointDevice, PointScene, curved_reflector};

/// Distances below this share of the scene's extent count as this, in the density of points.
const NEAR: f64 = 1e-4;

/// Adds reflections from points to the methods of a sampler.
pub fn add_to(methods: &mut Methods) {
    // Pipelines are those of the first device, and are made once.
    let passes = OnceLock::new();
    methods.points = Some(Arc::new(move |gpu: &Arc<Gpu>, scene, time_secs| -> Arc<dyn PointMethod> {
        let points = PointScene::new(scene, time_secs);
        // On a software driver the CPU's way takes half the time.
        let device = (!gpu.is_software()).then(|| {
            let passes = passes.get_or_init(|| Arc::new(PointPasses::new(gpu)));
            PointDevice::with_passes(Arc::clone(passes), &points)
        });
        Arc::new(PluggedPoints { points, device })
    }));
}

impl PointMethod for PluggedPoints {
    fn reflector(
        &self,
        scene: &Scene,
        index: u32,
        instance: &Instance,
        viewers: &ProbeEye,
        side: u32,
    ) -> Option<MappedReflector> {
        curved_reflector(scene, index, instance, &eye_of(scene, viewers, side), side)
    }

    fn fill(
        &self,
        scene: &Scene,
        middle: DVec3,
        reflectors: &[MappedReflector],
        viewers: &ProbeEye,
        budget: u32,
    ) -> FilledMaps {
        let side = reflectors.first().map_or(1, |reflector| reflector.side);
        let settings = EyePointSettings { density: Density::default(), budget, culling: true };
        let found = self.points.points(&eye_of(scene, viewers, side), reflectors, &settings);
        warn_of_budget(&found.budget);
        let shown = Requests::all(&found.maps, found.points.len(), |_, id| id);
        let point = |id: u32| probe_point(&self.points.shading_of_point(&found, id), middle);
        FilledMaps::new(&found.maps, &shown, shown.ids().into_iter().map(point).collect())
    }

    fn maps_of_view(
        self: Arc<Self>,
        scene: &Scene,
        instances: &[u32],
        ids: &[[u32; 2]],
        view: &ViewJob,
        time_secs: f64,
        budget: u32,
    ) -> Box<dyn ViewMaps> {
        Box::new(IndexedMaps::new(self, scene, (instances, ids), view, time_secs, budget))
    }
}

/// Logs that a budget was too small.
fn warn_of_budget(budget: &BudgetReport) {
    let BudgetReport { wanted, reduction, kept } = *budget;
    if reduction < 1.0 {
        let share = format!("{:.0}%", 100.0 * reduction);
        warn!(
            wanted,
            kept,
            density = share,
            "reflections are coarser: more points are wanted than coordinator.reflection_points allows"
        );
    }
}

/// The viewers as an eye of the method.
fn eye_of(scene: &Scene, viewers: &ProbeEye, side: u32) -> Eye {
    let extent = scene.bounds().size().max_element();
    Eye {
        position: viewers.viewpoints.center(),
        half_size: viewers.viewpoints.size() * 0.5,
        pixels: viewers.pixels,
        // Of no use where maps have one side.
        height: 2 * side,
        near: (NEAR * extent).max(f64::MIN_POSITIVE),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Arc;

    use argus_sampler::plug::ReflectionRays;
    use argus_scene::procedural::{rooms, with_balls};
    use argus_scene::{Reflections, Rig};

    use super::*;

    const SIDE: u32 = 32;

    fn viewers(scene: &Scene) -> ProbeEye {
        let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 128 };
        ProbeEye::of(&rig, &scene.bounds()).unwrap()
    }

    fn reflectors(scene: &Scene) -> Vec<MappedReflector> {
        let eye = eye_of(scene, &viewers(scene), SIDE);
        let indices = scene.reflectors(Reflections::default().most);
        let new = |index: u32| {
            let instance = &scene.instances[index as usize];
            MappedReflector { side: SIDE, ..curved_reflector(scene, index, instance, &eye, SIDE).unwrap() }
        };
        indices.into_iter().map(new).collect()
    }

    fn filled(scene: &Arc<Scene>, budget: u32) -> FilledMaps {
        let points = PluggedPoints { points: PointScene::new(scene, 0.0), device: None };
        points.fill(scene, DVec3::ZERO, &reflectors(scene), &viewers(scene), budget)
    }

    #[test]
    fn every_point_that_is_shaded_is_shown_and_none_is_shaded_twice() {
        let scene = Arc::new(with_balls(rooms(20), 3).unwrap());
        let found = filled(&scene, 1 << 22);
        assert_eq!((found.maps, found.texels.len()), (3, 3 * 6 * 32 * 32));
        let shown: BTreeSet<u32> = found.texels.iter().map(|[point, _]| *point).filter(|p| *p > 0).collect();
        assert_eq!(shown.len(), found.points.len());
        assert_eq!(shown.last(), Some(&(found.points.len() as u32)));
        assert!(found.points.len() * 3 < found.texels.len() * 2, "fewer shades than texels");
    }

    #[test]
    fn rays_fill_the_maps_that_points_fill() {
        let scene = Arc::new(with_balls(rooms(20), 3).unwrap());
        let points = filled(&scene, 1 << 22);
        let (rays, _) = ReflectionRays::new(&scene, 0.0).unwrap().maps(&reflectors(&scene));
        let rays: Vec<u64> = rays.bits().collect();
        assert_eq!((points.maps, rays.len()), (3, points.texels.len()));
        let range = |bits: u32| f32::from_bits(bits);
        let is_alike = |(a, b): &(&[u32; 2], &u64)| {
            let (a, b) = (range(a[1]), range((**b >> 32) as u32));
            (a - b).abs() <= 0.01 * b
        };
        let alike = points.texels.iter().zip(&rays).filter(is_alike).count();
        assert!(alike * 100 >= 98 * points.texels.len(), "{alike} of {}", points.texels.len());
    }

    #[test]
    fn a_small_budget_lowers_the_density_and_leaves_no_hole() {
        let scene = Arc::new(with_balls(rooms(20), 3).unwrap());
        let [full, some] = [1 << 22, 1 << 12].map(|budget| filled(&scene, budget));
        assert!(full.points.len() > 1 << 12 && some.points.len() <= 1 << 12, "{}", some.points.len());
        let holes =
            full.texels.iter().zip(&some.texels).filter(|(full, some)| (full[0] == 0) != (some[0] == 0));
        assert!(holes.count() * 1000 <= full.texels.len());
    }

    #[test]
    fn bytes_do_not_depend_on_the_number_of_threads() {
        let scene = Arc::new(with_balls(rooms(20), 3).unwrap());
        let bytes = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = pool.install(|| filled(&scene, 1 << 14));
            (found.texels, bytemuck::cast_slice::<_, u8>(&found.points).to_vec())
        };
        assert!(bytes(1) == bytes(3));
    }
}

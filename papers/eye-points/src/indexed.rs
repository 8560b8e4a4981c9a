//! Indexed maps of a view: around each reflector in it, which point each texel sees (Gavane and Watson 2022, section 4.1.1).
//!
//! The eye is the view itself. Its pixels set the density of points and the sizes of maps, and only reflectors in the view
//! have a map. Points are not shaded until a lookup meets them.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_scene::{Scene, ViewJob};
use glam::DVec3;
use rayon::prelude::*;
use tracing::warn;

use argus_sampler::plug::{MappedReflector, Met, Points, Ray, Requests, ViewMaps, probe_point};

use crate::{
    Eye, EyePointSettings, EyePoints, LARGEST_SIDE, PointScene, STEPS, curved_reflector, lookup,
    planar_reflector,
};

/// Distances below this share of the scene's extent count as this, in the density of points.
const NEAR: f64 = 1e-5;

/// Maps around the reflectors that a view sees.
pub(crate) struct IndexedMaps {
    points: Arc<PointScene>,
    reflectors: Vec<MappedReflector>,
    /// For each reflector of the scene the number of its map.
    map_of: Vec<Option<u32>>,
    found: EyePoints,
}

impl IndexedMaps {
    /// Maps of a view at a time in seconds, from at most `budget` points. `instances` reflect; `ids` are the view's visibility:
    /// instance + 1 and triangle, or zeros for the sky.
    pub(crate) fn new(
        points: Arc<PointScene>,
        scene: &Scene,
        instances: &[u32],
        ids: &[[u32; 2]],
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
        let settings = EyePointSettings { budget, culling: true, ..EyePointSettings::default() };
        let found = points.points(&eye, &reflectors, &settings);
        let (wanted, reduction) = (found.budget.wanted, found.budget.reduction);
        if reduction < 1.0 {
            warn!(wanted, budget, reduction, "reflections of a view are coarser: it wants more points");
        }
        Self { points, reflectors, map_of, found }
    }
}

impl ViewMaps for IndexedMaps {
    fn meet(&self, eye: DVec3, rays: &[Ray]) -> Met {
        let maps = &self.found.maps;
        let requests = Requests::none(self.found.count());
        let ids = rays.par_iter().with_min_len(256).map(|ray| {
            let map = (*self.map_of.get(ray.reflector as usize)?)?;
            let about = eye + ray.start.as_dvec3() - self.reflectors[map as usize].center;
            let texel = lookup(maps, map as usize, about, ray.direction.as_dvec3(), STEPS);
            let (id, _) = maps.get(texel)?;
            requests.add(id);
            Some(id)
        });
        let ids: Vec<Option<u32>> = ids.collect();
        let requests = requests.counted();
        let point = |id: &u32| probe_point(&self.points.shading_of_point(&self.found, *id), eye);
        Met {
            points: Points { all: requests.ids().par_iter().map(point).collect(), image: None },
            of_ray: ids.par_iter().map(|id| id.map(|id| requests.slot(id) as u32)).collect(),
        }
    }
}

//! Probes from points or rays: cube maps around reflectors are filled with points as dense as viewers see them in reflections
//! ([`crate::eye_points`]), or with what a ray through each texel meets. Each point that a map shows is shaded once.
//!
//! The eye is the box of the sample set's viewpoints, so that probes serve every view of the set. Within a cube map of as many
//! texels a side as the probe, a texel of the probe is the mean of four rays.

use argus_gpu::Gpu;
use argus_scene::{ProbeEye, Scene};
use argus_shaders::layout::sampler::ProbePoint;
use glam::DVec3;
use tracing::warn;

use super::ProbePlaces;
use crate::eye_points::{BudgetReport, Density, Eye, EyePointKnobs, Maps, PointReflector, Requests};
use crate::passes::{BlurProbes, ResamplePoints, ShadePoints};
use crate::point_shading::probe_point;
use crate::reflected_light::FoundBy;
use crate::reflected_light::Ray;
use crate::resident::{GuideUse, Resident};

/// Most bytes of cube maps that are filled at once: 340 of 64 texels a side, or 21 of 256.
const MOST_BYTES: usize = 64 << 20;
/// Bytes of a texel of a cube map.
const TEXEL_BYTES: usize = 8;
/// Distances below this share of the scene's extent count as this, in the density of points.
const NEAR: f64 = 1e-4;

/// The programs that fill probes with points, for one scene on one device.
pub(crate) struct PointProbes {
    pub(crate) source: Fill,
    pub(crate) shade: ShadePoints,
    pub(crate) resample: ResamplePoints,
    pub(crate) blur: BlurProbes,
}

/// Some reflectors' cube maps, and the points that they show.
pub(crate) struct FilledMaps {
    /// For each texel 1 + the index of its point, or 0 for sky; and its inverse range, 1/metres, f32 bits.
    pub(crate) texels: Vec<[u32; 2]>,
    /// The points, each once. Positions are relative to [`ProbePlaces::middle`].
    pub(crate) points: Vec<ProbePoint>,
    /// The rays that found them, if rays did.
    pub(crate) rays: Vec<Ray>,
    /// Number of maps.
    pub(crate) maps: u32,
    /// How the budget was kept.
    pub(crate) budget: BudgetReport,
}

/// What fills cube maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fill {
    /// Points on triangles, as dense as these viewers see them; at most so many at once.
    Points { viewers: ProbeEye, budget: u32 },
    /// A ray through each texel.
    Rays,
}

impl Fill {
    /// Texels on a side of the cube map for a probe of `side` texels. Rays shade every texel: with half the side, the cube has
    /// half again as many as the probe.
    fn cube_side(self, side: u32) -> u32 {
        match self {
            Self::Points { .. } => side,
            Self::Rays => side / 2,
        }
    }
}

impl PointProbes {
    pub(super) fn new(gpu: &Gpu, resident: &Resident, guides: GuideUse, source: Fill, side: u32) -> Self {
        let guides = match source {
            Fill::Points { .. } => guides,
            // Rays go on from what guides say.
            Fill::Rays => guides.at_least_kept(),
        };
        Self {
            source,
            shade: ShadePoints::new(gpu, resident.features, guides),
            resample: ResamplePoints::new(gpu, resident.features, source.cube_side(side)),
            blur: BlurProbes::new(gpu),
        }
    }

    /// The reflectors of all probes of a side in texels, in groups whose maps are filled at once.
    pub(crate) fn groups(
        source: Fill,
        scene: &Scene,
        places: &ProbePlaces,
        (side, time_secs): (u32, f64),
    ) -> Vec<Vec<PointReflector>> {
        let side = source.cube_side(side);
        let posed = scene.at(time_secs);
        let reflector = |(&instance, center): (&u32, DVec3)| {
            let found = match source {
                Fill::Points { viewers, .. } => {
                    let (eye, instance_) =
                        (eye_of(scene, &viewers, side), &posed.instances[instance as usize]);
                    PointReflector::new(scene, instance, instance_, &eye, side)
                }
                // Neither size nor curvature counts for rays.
                Fill::Rays => None,
            };
            // The centre that lookups use, which is rounded. An object of zero size reflects nothing.
            let nothing = PointReflector { instance, center, radius: 0.0, curvature: 0.0, side, front: None };
            found.map_or(nothing, |found| PointReflector { center, side, ..found })
        };
        let all: Vec<PointReflector> = places.instances.iter().zip(places.centers()).map(reflector).collect();
        let map_bytes = 6 * (side as usize).pow(2) * TEXEL_BYTES;
        all.chunks((MOST_BYTES / map_bytes).max(1)).map(<[PointReflector]>::to_vec).collect()
    }

    /// Fills the maps of a group of reflectors, whose sides are equal.
    pub(crate) fn fill(
        source: Fill,
        by: &FoundBy,
        scene: &Scene,
        middle: DVec3,
        reflectors: &[PointReflector],
    ) -> FilledMaps {
        match (source, by) {
            (Fill::Points { viewers, budget }, FoundBy::Points(points)) => {
                let side = reflectors.first().map_or(1, |reflector| reflector.side);
                let knobs = EyePointKnobs { density: Density::default(), budget, culling: true };
                let found = points.points(&eye_of(scene, &viewers, side), reflectors, &knobs);
                let shown = Requests::all(&found.maps, found.points.len(), |_, id| id);
                let point = |id: u32| probe_point(&points.shading_of_point(&found, id), middle);
                let points = shown.ids().into_iter().map(point).collect();
                FilledMaps::new(&found.maps, &shown, (points, Vec::new()), found.budget)
            }
            (_, FoundBy::Rays(rays)) => {
                let (maps, met) = rays.maps(reflectors);
                let shown = Requests::all(&maps, maps.texels(), |_, id| id);
                let side = f64::from(reflectors.first().map_or(1, |reflector| reflector.side));
                let spread = 2.0 / side;
                let point = |(at, texel): (u32, u32)| {
                    let met = met[texel as usize]?;
                    let (map, direction) = maps.direction_of(texel as usize);
                    let ray = Ray {
                        start: (reflectors[map].center - middle).as_vec3(),
                        direction: direction.normalize().as_vec3(),
                        reflector: map as u32,
                        past: Some(reflectors[map].instance),
                        width: 0.0,
                        spread: spread as f32,
                        at,
                        is_through: false,
                    };
                    Some((probe_point(&rays.shading_of(&met, spread * met.range), middle), ray))
                };
                let (points, found) = (0..).zip(shown.ids()).filter_map(point).unzip();
                let budget = BudgetReport { wanted: 0, reduction: 1.0, kept: true };
                FilledMaps::new(&maps, &shown, (points, found), budget)
            }
            (Fill::Rays, FoundBy::Points(_)) => unreachable!("the scene is prepared for the source"),
        }
    }
}

impl FilledMaps {
    /// Maps whose ids are replaced by places in the list of shown points.
    fn new(
        maps: &Maps,
        shown: &Requests,
        (points, rays): (Vec<ProbePoint>, Vec<Ray>),
        budget: BudgetReport,
    ) -> Self {
        let texel = |key: u64| match key {
            0 => [0; 2],
            key => [1 + shown.slot(key as u32) as u32, (key >> 32) as u32],
        };
        Self { texels: maps.bits().map(texel).collect(), points, rays, maps: maps.count(), budget }
    }

    /// Logs that a budget was too small.
    pub(crate) fn report(&self) {
        let BudgetReport { wanted, reduction, kept } = self.budget;
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

    use argus_scene::procedural::{rooms, with_balls};
    use argus_scene::{Reflections, Rig};

    use crate::eye_points::{PointScene, ReflectionRays};

    use super::*;

    const SIDE: u32 = 32;

    fn viewers(scene: &Scene) -> ProbeEye {
        let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 128 };
        ProbeEye::of(&rig, &scene.bounds()).unwrap()
    }

    fn reflectors(scene: &Scene) -> Vec<PointReflector> {
        let eye = eye_of(scene, &viewers(scene), SIDE);
        let indices = scene.reflectors(Reflections::default().most);
        let new = |index: u32| {
            let instance = &scene.instances[index as usize];
            PointReflector { side: SIDE, ..PointReflector::new(scene, index, instance, &eye, SIDE).unwrap() }
        };
        indices.into_iter().map(new).collect()
    }

    fn filled(scene: &Arc<Scene>, budget: u32) -> FilledMaps {
        let source = Fill::Points { viewers: viewers(scene), budget };
        let points = FoundBy::Points(PointScene::new(scene, 0.0));
        PointProbes::fill(source, &points, scene, DVec3::ZERO, &reflectors(scene))
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
        assert_eq!((found.budget.reduction, found.budget.kept), (1.0, true));
    }

    #[test]
    fn rays_fill_the_maps_that_points_fill() {
        let scene = Arc::new(with_balls(rooms(20), 3).unwrap());
        let points = filled(&scene, 1 << 22);
        let filler = FoundBy::Rays(Box::new(ReflectionRays::new(&scene, 0.0).unwrap()));
        let rays = PointProbes::fill(Fill::Rays, &filler, &scene, DVec3::ZERO, &reflectors(&scene));
        assert_eq!((rays.maps, rays.texels.len()), (3, points.texels.len()));
        let range = |texel: &[u32; 2]| f32::from_bits(texel[1]);
        let is_alike = |(a, b): &(&[u32; 2], &[u32; 2])| (range(a) - range(b)).abs() <= 0.01 * range(b);
        let alike = points.texels.iter().zip(&rays.texels).filter(is_alike).count();
        assert!(alike * 100 >= 98 * points.texels.len(), "{alike} of {}", points.texels.len());
        let nothing = PointProbes::fill(Fill::Rays, &filler, &scene, DVec3::ZERO, &[]);
        assert_eq!((nothing.maps, nothing.texels.len(), nothing.points.len()), (0, 0, 0));
    }

    #[test]
    fn a_small_budget_lowers_the_density_says_so_and_leaves_no_hole() {
        let scene = Arc::new(with_balls(rooms(20), 3).unwrap());
        let [full, some] = [1 << 22, 1 << 12].map(|budget| filled(&scene, budget));
        assert!(full.budget.wanted > 1 << 12 && some.budget.reduction < 0.9, "{:?}", some.budget);
        assert!(some.budget.kept && some.points.len() <= 1 << 12);
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

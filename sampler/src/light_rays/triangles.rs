//! Triangles of a leaf: what a ray hits of them.

use argus_shaders::layout::sampler::ScatteredHit;

use super::rays::LightRays;
use super::tree::{Block, CullMode, Ids};
use super::walk::{Leaves, Shear};
use crate::bvh::OF_OBJECT;
use crate::packets::lanes::{LANES, Lanes};

/// The nearest surface along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RayHit {
    /// Index into [`argus_scene::Scene::instances`].
    pub(crate) instance: u32,
    /// Index of the triangle in its mesh.
    pub(crate) primitive: u32,
    /// Distance in units of the direction.
    pub(crate) t: f32,
    /// Weights of the mesh's second and third corner.
    pub(crate) weights: [f32; 2],
    /// Whether the front face (counter-clockwise) is hit.
    pub(crate) front: bool,
}

impl RayHit {
    /// What a device found; `None` if it found nothing.
    pub(crate) fn of_device(hit: ScatteredHit) -> Option<Self> {
        const FRONT: u32 = 1 << 31;
        let ScatteredHit { instance, primitive, t, weights, .. } = hit;
        let instance = instance.checked_sub(1)?;
        Some(Self { instance, primitive: primitive & !FRONT, t, weights, front: primitive & FRONT != 0 })
    }
}

/// Triangles, until one blocks a ray.
pub(super) struct AnyTriangle<'a, L> {
    pub(super) rays: &'a LightRays,
    pub(super) ray: Shear,
    pub(super) instance: u32,
    pub(super) passed: Option<f32>,
    pub(super) lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for AnyTriangle<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, limit: f32) -> f32 {
        let Some(block) = self.rays.trees.blocks.get(leaf as usize) else { return limit };
        let Some(met) = self.ray.meet::<L>(block, limit) else { return limit };
        if met.hit & !block.cutout != 0 {
            return -1.0;
        }
        let ids = &self.rays.trees.ids[leaf as usize];
        let weights = Weights::new(met.area.to_array(), [met.parts[0].to_array(), met.parts[1].to_array()]);
        let is_stopped = match &mut self.passed {
            None => weights.any_stops(met.hit, block, ids, self.instance, self.rays),
            Some(passed) => {
                *passed *= weights.passed(met.hit, block, ids, self.instance, self.rays);
                *passed == 0.0
            }
        };
        if is_stopped { -1.0 } else { limit }
    }
}

/// Triangles, for the nearest hit. Of hits at the same distance the one with the lowest ids counts, in whatever order they are met:
/// so a hit does not depend on objects that the ray misses.
pub(super) struct NearestTriangle<'a, L> {
    pub(super) rays: &'a LightRays,
    pub(super) ray: Shear,
    pub(super) instance: u32,
    pub(super) nearest: Option<RayHit>,
    pub(super) lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for NearestTriangle<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, mut limit: f32) -> f32 {
        let Some(block) = self.rays.trees.blocks.get(leaf as usize) else { return limit };
        // Those at the limit are met, too.
        let Some(met) = self.ray.meet::<L>(block, limit.next_up()) else { return limit };
        let ids = &self.rays.trees.ids[leaf as usize];
        let weights = Weights::new(met.area.to_array(), [met.parts[0].to_array(), met.parts[1].to_array()]);
        let t = met.t.to_array();
        let mut hit = met.hit;
        while hit != 0 {
            let lane = hit.trailing_zeros() as usize % LANES;
            hit &= hit - 1;
            let is_nearer = t[lane] < limit || self.comes_first(t[lane], resolved(ids[lane], self.instance));
            if is_nearer && weights.stops(lane, block, ids, self.instance, self.rays) {
                limit = t[lane];
                self.nearest = Some(weights.hit(lane, limit, block, ids, self.instance));
            }
        }
        limit
    }
}

impl<L> NearestTriangle<'_, L> {
    /// Whether a hit is as near as the nearest one, and has lower ids.
    #[inline(always)]
    fn comes_first(&self, t: f32, ids: [u32; 2]) -> bool {
        self.nearest.is_some_and(|nearest| t == nearest.t && ids < [nearest.instance, nearest.primitive])
    }
}

/// Where in the triangles of a block a ray hits them.
struct Weights {
    area: [f32; LANES],
    parts: [[f32; LANES]; 2],
}

impl Weights {
    #[inline(always)]
    fn new(area: [f32; LANES], parts: [[f32; LANES]; 2]) -> Self {
        Self { area, parts }
    }

    /// Weights of the mesh's second and third corner.
    #[inline(always)]
    fn of(&self, lane: usize, block: &Block) -> [f32; 2] {
        let weights = [self.parts[0][lane] / self.area[lane], self.parts[1][lane] / self.area[lane]];
        if block.mirrored >> lane & 1 == 1 { [weights[1], weights[0]] } else { weights }
    }

    /// The share of light that passes hit triangles, all of which have alpha.
    #[inline(never)]
    fn passed(&self, hit: u32, block: &Block, ids: &Ids, instance: u32, rays: &LightRays) -> f32 {
        let lanes = (0..LANES).filter(|lane| hit >> lane & 1 == 1);
        lanes
            .map(|lane| {
                let [beta, gamma] = self.of(lane, block);
                1.0 - rays.coverage(resolved(ids[lane], instance), beta, gamma)
            })
            .product()
    }

    /// Whether a hit triangle is opaque there.
    #[inline(always)]
    fn stops(&self, lane: usize, block: &Block, ids: &Ids, instance: u32, rays: &LightRays) -> bool {
        if block.cutout >> lane & 1 == 0 {
            return true;
        }
        let [beta, gamma] = self.of(lane, block);
        let ids = resolved(ids[lane], instance);
        let opens = rays.cutouts.let_through(ids, beta, gamma);
        !(opens || rays.faces == CullMode::None && rays.cutouts.let_light_through(ids, beta, gamma))
    }

    /// Whether any of the hit triangles is opaque where it is hit.
    #[inline(never)]
    fn any_stops(&self, hit: u32, block: &Block, ids: &Ids, instance: u32, rays: &LightRays) -> bool {
        (0..LANES).any(|lane| hit >> lane & 1 == 1 && self.stops(lane, block, ids, instance, rays))
    }

    #[inline(always)]
    fn hit(&self, lane: usize, t: f32, block: &Block, ids: &Ids, instance: u32) -> RayHit {
        let [instance, primitive] = resolved(ids[lane], instance);
        RayHit { instance, primitive, t, weights: self.of(lane, block), front: self.area[lane] > 0.0 }
    }
}

/// Ids of a triangle of an object with this instance.
#[inline(always)]
fn resolved([own, primitive]: [u32; 2], instance: u32) -> [u32; 2] {
    [if own == OF_OBJECT { instance } else { own }, primitive]
}

//! Rays through a scene: what they see, and its radiance.

use std::sync::{Arc, OnceLock};

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::boxes::BoxTree;
use super::corners::Corners;
use super::placed::{MeshTree, Placed, place};
use super::search::{Hit, Partial, SAME_PLACE, Search, Seen, is_met_at, order, precedes};
use super::triangle::{Crossing, ShearedRay};
use crate::emitters::{EmittersByPower, emitters};
use crate::shading::{diffuse_radiance, reflected_lights, reflected_sky, sky_radiance};
use crate::texture::{MipChain, mip_chains, transform_uv};
use crate::transparency::{Layer, cut};
use crate::{Bounds, LightEffects, Material, Mesh, Pose, Scene, TextureRef};

/// How the reference traces direct light.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectLight {
    /// Effects that are traced; the rest are as in [`crate::shading`].
    pub effects: LightEffects,
    /// Rays to each light, and ten times as many to sky and emitters together, for each visible point; at least 1.
    pub rays: u32,
}

/// Direct light of a tracer, with the emitters of its pose.
#[derive(Debug, Clone)]
pub(super) struct Lit {
    pub(super) light: DirectLight,
    pub(super) emitters: EmittersByPower,
}

impl Lit {
    pub(super) fn new(light: DirectLight, tracer: &Tracer) -> Self {
        let all = match light.effects.emitters {
            true => emitters(&tracer.scene, &tracer.pose.instances, &tracer.textures),
            false => Vec::new(),
        };
        Self { light, emitters: EmittersByPower::new(all) }
    }
}

/// Instances that reflect and refract the scene, and the number of rays.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reflecting {
    /// Rays per lobe.
    pub rays: u32,
    /// Most reflections one after another, at least 1.
    pub bounces: u32,
    /// Reflecting instances, ascending; the rest reflect only the sky.
    pub instances: Vec<u32>,
}

/// A scene prepared for rays.
///
/// Building takes about a second for two million triangles. Rays may come from any number of threads.
pub struct Tracer {
    pub(super) scene: Arc<Scene>,
    pub(super) pose: Pose,
    pub(super) textures: Arc<Vec<MipChain>>,
    /// One per mesh; a mesh without instances has no triangles.
    meshes: Arc<Vec<Arc<MeshTree>>>,
    /// Box of each mesh's triangles, mesh space relative to its origin.
    boxes: Arc<Vec<Bounds>>,
    /// Placed instances in the order of `top`.
    placed: Vec<Placed>,
    top: BoxTree,
    pub(super) content_hash: OnceLock<blake3::Hash>,
    /// Instances that reflect and refract the scene.
    pub(super) reflecting: Option<Reflecting>,
    /// Effects of direct light.
    pub(super) lit: Option<Lit>,
}

impl Tracer {
    /// Builds the hierarchies and the textures' mip chains on all of rayon's threads, for the scene at time zero.
    pub fn new(scene: Arc<Scene>) -> Self {
        let textures = mip_chains(&scene);
        Self::of(scene, textures)
    }

    fn of(scene: Arc<Scene>, textures: Vec<MipChain>) -> Self {
        let mut used = vec![false; scene.meshes.len()];
        scene.instances.iter().for_each(|i| used[i.mesh as usize] = true);
        let built = scene.meshes.par_iter().zip(&used).map(|(mesh, &used)| MeshTree::new(mesh, used));
        let (meshes, boxes): (Vec<Arc<MeshTree>>, Vec<Bounds>) = built.unzip();
        let pose = scene.at(0.0);
        let (placed, top) = place(&scene, &pose, &boxes);
        let (meshes, boxes, textures) = (Arc::new(meshes), Arc::new(boxes), Arc::new(textures));
        let content_hash = OnceLock::new();
        Self { scene, pose, textures, meshes, boxes, placed, top, content_hash, reflecting: None, lit: None }
    }

    /// The scene's triangles at time zero, without textures and without cut-outs.
    pub(super) fn of_shapes(scene: Arc<Scene>) -> Self {
        Self::of(scene, Vec::new()).without_cutouts()
    }

    /// The scene's triangles at another time in seconds, without textures and without cut-outs.
    pub(super) fn shapes_at(&self, time_secs: f64) -> Self {
        self.at(time_secs).without_cutouts()
    }

    fn without_cutouts(mut self) -> Self {
        self.placed.iter_mut().for_each(|placed| placed.cutoff = placed.cutoff.and(Some(f32::INFINITY)));
        self
    }

    /// A tracer of the same scene in which every triangle is seen from both sides.
    pub(super) fn without_backs(&self) -> Self {
        let mut both = self.at(0.0);
        for (placed, same) in both.placed.iter_mut().zip(&self.placed) {
            (placed.culled, placed.cutoff) = (false, same.cutoff);
        }
        both
    }

    /// The same scene at another time in seconds. Unmoved parts are shared, so the cost follows the number of instances and
    /// the triangles of meshes that deform.
    pub fn at(&self, time_secs: f64) -> Self {
        let scene = self.scene.posed(time_secs);
        let pose = scene.at(time_secs);
        let (meshes, boxes) = self.shapes_of(&scene);
        let (placed, top) = place(&scene, &pose, &boxes);
        let content_hash = match pose == self.pose && Arc::ptr_eq(&scene, &self.scene) {
            true => self.content_hash.clone(),
            false => OnceLock::new(),
        };
        Self {
            scene,
            pose,
            textures: self.textures.clone(),
            meshes,
            boxes,
            placed,
            top,
            content_hash,
            reflecting: self.reflecting.clone(),
            lit: None,
        }
        .lit_as(self)
    }

    /// The trees and boxes of a posed scene's meshes: new ones of those that deform.
    fn shapes_of(&self, scene: &Arc<Scene>) -> (Arc<Vec<Arc<MeshTree>>>, Arc<Vec<Bounds>>) {
        if Arc::ptr_eq(scene, &self.scene) {
            return (self.meshes.clone(), self.boxes.clone());
        }
        let mut shapes = (Vec::clone(&self.meshes), Vec::clone(&self.boxes));
        for (at, _) in scene.deforming_meshes().iter().enumerate().filter(|(_, deforms)| **deforms) {
            (shapes.0[at], shapes.1[at]) = MeshTree::new(&scene.meshes[at], true);
        }
        (Arc::new(shapes.0), Arc::new(shapes.1))
    }

    /// The traced scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The surface that a ray shows, at a range above 0; its direction need not be a unit vector. Cut-outs are open
    /// where their alpha is below the cutoff, and single-sided triangles from behind. Of transparent surfaces, the ray
    /// shows the first at which half of what is behind is hidden.
    pub fn trace(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        self.see(origin, direction).shown()
    }

    /// All that a ray sees at ranges above 0; its direction need not be a unit vector.
    pub fn see(&self, origin: DVec3, direction: DVec3) -> Seen {
        let mut search = Search::nearest(Partial::Layers(Vec::new()), false);
        let Some(unit) = self.search(origin, direction, &mut search) else {
            return Seen { layers: Vec::new(), behind: None };
        };
        let at = |hit: Hit| Hit { position: origin + unit * hit.range, ..hit };
        let behind = search.nearest.map(at);
        let mut layers = match search.partial {
            Partial::Layers(layers) => layers,
            Partial::Chance | Partial::Passed(_) => Vec::new(),
        };
        let end = behind.map_or(f64::INFINITY, |behind| behind.range * (1.0 + SAME_PLACE));
        layers.retain(|layer| layer.surface.range <= end);
        layers.sort_by(|a, b| order(&a.surface, &b.surface));
        // Triangles that share an edge are one surface.
        layers.dedup_by(|b, a| {
            let (a, b) = (a.surface, b.surface);
            a.instance == b.instance && b.range - a.range <= SAME_PLACE * b.range
        });
        layers.iter_mut().for_each(|layer| layer.surface = at(layer.surface));
        cut(&mut layers, |layer| is_met_at(&layer.surface, layer.alpha));
        Seen { layers, behind }
    }

    /// One of the surfaces that a ray sees. Transparent surfaces are met as often as their alpha says.
    pub(super) fn trace_one(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        self.nearest(origin, direction, false)
    }

    /// The nearest surface at a range above 0 that reflects light along a ray, whose direction need not be a unit vector.
    /// Single-sided triangles do from both sides, and glass does not. Transparent surfaces are met as often as their
    /// alpha says.
    pub(super) fn trace_light(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        self.nearest(origin, direction, true)
    }

    fn nearest(&self, origin: DVec3, direction: DVec3, of_light: bool) -> Option<Hit> {
        let mut search = Search::nearest(Partial::Chance, of_light);
        let unit = self.search(origin, direction, &mut search)?;
        search.nearest.map(|hit| Hit { position: origin + unit * hit.range, ..hit })
    }

    /// Whether a ray meets nothing.
    pub(super) fn is_clear(&self, origin: DVec3, direction: DVec3) -> bool {
        let mut search = Search::any(Partial::Chance, f64::INFINITY, false);
        self.search(origin, direction, &mut search).is_some() && search.nearest.is_none()
    }

    /// The share of light that passes along a ray up to a range. Single-sided triangles block it both ways, and glass does
    /// not.
    pub(super) fn passed(&self, origin: DVec3, direction: DVec3, reach: f64) -> f32 {
        let mut search = Search::any(Partial::Passed(1.0), reach, true);
        match (self.search(origin, direction, &mut search), search.nearest, search.partial) {
            (Some(_), None, Partial::Passed(share)) => share,
            _ => 0.0,
        }
    }

    /// The range of a surface on the way from one point to another, and beyond by a share `slack` of the distance. It is
    /// the nearest, or one of those closer than that share.
    pub(super) fn range_towards(&self, from: DVec3, to: DVec3, slack: f64) -> Option<f64> {
        let way = to - from;
        let length = way.length();
        let mut search = Search {
            enough: (1.0 - slack) * length,
            ..Search::any(Partial::Chance, (1.0 + slack) * length, false)
        };
        self.search(from, way, &mut search)?;
        search.nearest.map(|hit| hit.range)
    }

    /// Searches along a ray, and returns its unit direction; `None` for a direction that is zero or not finite.
    fn search(&self, origin: DVec3, direction: DVec3, search: &mut Search) -> Option<DVec3> {
        // Scaled first, since the square of a direction may overflow where the direction does not.
        let unit = (direction / direction.abs().max_element()).normalize();
        if !(origin.is_finite() && unit.is_finite()) {
            return None;
        }
        self.top.visit(origin, unit, search.limit(), |position| {
            self.search_instance(&self.placed[position], origin, unit, search);
            search.limit()
        });
        Some(unit)
    }

    fn search_instance(&self, placed: &Placed, origin: DVec3, unit: DVec3, search: &mut Search) {
        if search.of_light && placed.passes_light {
            return;
        }
        let mesh = &self.meshes[placed.mesh as usize];
        let origin = placed.mesh_from_world * (origin - placed.translation) - placed.origin;
        let direction = placed.mesh_from_world * unit;
        if !(origin.is_finite() && direction.is_finite() && direction != DVec3::ZERO) {
            return;
        }
        let ray = ShearedRay::new(origin, direction);
        mesh.tree.visit(origin, direction, search.limit(), |position| {
            if let Some(crossing) = ray.crossing(&mesh.corners[position]) {
                let hit = Hit {
                    instance: placed.instance,
                    triangle: mesh.triangles[position],
                    barycentric: crossing.barycentric,
                    range: crossing.t,
                    position: DVec3::ZERO,
                    front: crossing.front,
                };
                let end = search.nearest.map_or(search.reach, |best| best.range * (1.0 + SAME_PLACE));
                if hit.range <= end.min(search.reach)
                    && self.blocks(placed, &hit, &crossing, search)
                    && search.nearest.is_none_or(|best| precedes(&hit, &best))
                {
                    search.nearest = Some(hit);
                }
            }
            search.limit()
        });
    }

    /// Whether a search ends at a triangle that its ray crosses. Takes a surface over that hides a part.
    fn blocks(&self, placed: &Placed, hit: &Hit, crossing: &Crossing, search: &mut Search) -> bool {
        if placed.culled && !crossing.front && !search.of_light {
            return false;
        }
        if search.of_light && placed.passes_light_in_parts && self.is_clear_glass(placed, hit) {
            return false;
        }
        let coverage = self.coverage(placed, hit.triangle, crossing);
        if coverage == 0.0 || coverage >= 1.0 {
            return coverage >= 1.0;
        }
        match &mut search.partial {
            Partial::Layers(layers) => layers.push(Layer { surface: *hit, alpha: coverage }),
            Partial::Chance => return is_met_at(hit, coverage),
            Partial::Passed(share) => *share *= 1.0 - coverage,
        }
        false
    }

    /// The share of what is behind that a surface hides where a ray crosses a triangle.
    fn coverage(&self, placed: &Placed, triangle: u32, crossing: &Crossing) -> f32 {
        let Some(cutoff) = placed.cutoff else { return 1.0 };
        if cutoff == f32::INFINITY {
            return 0.0;
        }
        let mesh = &self.scene.meshes[placed.mesh as usize];
        let material = &self.scene.materials[mesh.material as usize];
        material.coverage(self.alpha(mesh, material, triangle, crossing.barycentric))
    }

    /// Alpha of a surface point: factor × texture (level 0) × vertex colour.
    fn alpha(&self, mesh: &Mesh, material: &Material, triangle: u32, barycentric: DVec2) -> f32 {
        let corner = Corners::new(mesh, triangle, barycentric);
        let texture = self.read_level_0(mesh, &corner, material.base_color_texture, MipChain::alpha);
        let color = corner.blend(&mesh.colors).map_or(1.0, |color| color.w);
        material.base_color.w * texture * color
    }

    /// Whether light passes through a surface point that passes it in parts.
    fn is_clear_glass(&self, placed: &Placed, hit: &Hit) -> bool {
        let mesh = &self.scene.meshes[placed.mesh as usize];
        let material = &self.scene.materials[mesh.material as usize];
        let corner = Corners::new(mesh, hit.triangle, hit.barycentric);
        let red = self.read_level_0(mesh, &corner, material.transmission_texture, MipChain::red);
        material.transmission * red >= 0.5
    }

    /// A channel of a texture's level 0; 1 without a texture.
    fn read_level_0(
        &self,
        mesh: &Mesh,
        corner: &Corners,
        reference: Option<TextureRef>,
        channel: impl Fn(&MipChain, Vec2) -> f32,
    ) -> f32 {
        let found = reference.and_then(|r| Some((r, self.textures.get(r.texture as usize)?)));
        let Some((reference, chain)) = found else { return 1.0 };
        let uv = corner.blend(mesh.uvs_of(reference.uv_set)).unwrap_or(Vec2::ZERO);
        channel(chain, transform_uv(&reference, uv))
    }

    /// Linear radiance that arrives at `origin` from the unit direction `direction`.
    ///
    /// `direction + dx` and `direction + dy` are the neighbouring samples' directions, up to their length. Their distance
    /// selects the mip levels. Zero reads textures unfiltered.
    pub fn radiance_along(&self, origin: DVec3, direction: DVec3, dx: DVec3, dy: DVec3) -> Vec3 {
        let seen = self.see(origin, direction);
        seen.shares().map(|(hit, share)| self.radiance_of(hit, direction, dx, dy) * share).sum()
    }

    /// Linear radiance of a ray's hit, or of the sky without one; arguments as in [`Self::radiance_along`].
    pub fn radiance_of(&self, hit: Option<&Hit>, direction: DVec3, dx: DVec3, dy: DVec3) -> Vec3 {
        let lighting = &self.pose.lighting;
        let Some(hit) = hit else { return sky_radiance(&lighting.sky, direction.as_vec3()) };
        let surface = self.surface(hit, direction, dx, dy);
        let to_eye = -direction.as_vec3();
        let (surface, transmitted) = self.without_transmitted(hit, &surface);
        let arriving = self.arriving(hit, &surface, direction);
        let diffuse = match &arriving {
            Some(arriving) => surface.emissive + surface.albedo * arriving.by_pi,
            None => diffuse_radiance(&surface, lighting),
        };
        if surface.f0 == Vec3::ZERO {
            return diffuse;
        }
        let open_sky = arriving.as_ref().map_or(1.0, |arriving| arriving.sky);
        let around = self
            .sent_of_around(hit, &surface, transmitted, direction)
            .unwrap_or_else(|| reflected_sky(&surface, to_eye, lighting) * open_sky);
        let lights = match &arriving {
            Some(arriving) => self.reflected_lights_seen(&surface, to_eye, arriving),
            None => reflected_lights(&surface, to_eye, lighting),
        };
        diffuse + around + lights
    }

    /// The material at a hit.
    pub(super) fn material_of(&self, hit: &Hit) -> &Material {
        let instance = &self.pose.instances[hit.instance as usize];
        &self.scene.materials[self.scene.meshes[instance.mesh as usize].material as usize]
    }
}

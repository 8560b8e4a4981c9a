//! Layers: the transparent surfaces that rays of sight cross before the first opaque one.
//!
//! Visibility backends find opaque surfaces alone. Layers are found here, on the CPU, for every backend: so ids and ranges
//! do not depend on the backend, on tiles or on threads. Packets of rays go through a hierarchy of the transparent meshes;
//! each ray that meets some is traced again, in f64, for all of its layers and for the opaque surface behind. A scene without
//! transparent meshes has no such hierarchy, and costs nothing. The rule is `argus_scene::transparency`.

use std::sync::Arc;

use argus_scene::Scene;
use argus_scene::transparency::{self, Layer, OPAQUE, is_met, shown, transparent_meshes};
use argus_shaders::layout::sampler::Rays;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::draws;
use crate::packets::{Hit, PacketTracer};
use crate::resident::{Placement, Resident};
use crate::tile::Tile;

/// Distances along a ray that differ by less than this share are of one place: a decal that lies on a wall is in front of it,
/// and two triangles at an edge are one surface. Above the rounding of f32 corners.
const SAME_PLACE: f64 = 1e-6;

/// Texels to which the part of a tile that shows layers is widened: patterns of light rays repeat.
const ALIGNED: u32 = 8;

/// Finds the layers of a scene.
pub(crate) struct LayerTracer {
    /// By mesh.
    is_transparent: Vec<bool>,
    transparent: PacketTracer,
    /// Distance of the near plane along the view's axis, metres.
    near: f64,
}

/// A surface on a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Met {
    /// As in the visibility buffer: instance + 1, triangle.
    pub(crate) ids: [u32; 2],
    /// Distance in units of the ray's direction.
    t: f64,
}

/// The layers of one ray.
pub(crate) struct RayLayers {
    /// Index of the ray in its image or list.
    pub(crate) at: u32,
    /// Front to back; at least one.
    pub(crate) layers: Vec<Layer<Met>>,
    /// The one that the ray shows; `None` if it shows what is behind.
    pub(crate) shown: Option<usize>,
    /// Length of the ray's direction.
    length: f64,
}

impl RayLayers {
    /// The layer that the ray shows, and its range in metres.
    pub(crate) fn shown(&self) -> Option<([u32; 2], f64)> {
        let met = self.layers[self.shown?].surface;
        Some((met.ids, met.t * self.length))
    }
}

impl LayerTracer {
    /// Builds the hierarchy of a scene's transparent meshes; `None` if it has none.
    pub(crate) fn new(scene: &Arc<Scene>, resident: &Resident) -> Option<Self> {
        let is_transparent = transparent_meshes(scene);
        is_transparent.contains(&true).then(|| {
            let near = draws::near(&resident.bounds);
            let placements = transparent(&is_transparent, &resident.instances);
            let mut transparent = PacketTracer::meeting_any(scene, &placements, near);
            if scene.is_animated() {
                transparent.pose(scene, &placements);
            }
            Self { is_transparent, transparent, near: f64::from(near) }
        })
    }

    /// Reads alpha from another scene, whose triangles are the same.
    pub(crate) fn set_scene(&mut self, scene: &Arc<Scene>) {
        self.transparent.set_scene(scene);
    }

    /// Moves instances to their current transforms.
    pub(crate) fn pose(&mut self, scene: &Scene, resident: &Resident) {
        self.transparent.pose(scene, &transparent(&self.is_transparent, &resident.instances));
    }

    /// The layers of all rays of a tile from `eye`, in order. Rays without layers are left out. `opaque` traces the scene.
    pub(crate) fn of_tile(&self, opaque: &PacketTracer, eye: DVec3, rays: &Rays) -> Vec<RayLayers> {
        let met = self.transparent.trace(eye, rays);
        let of = |(at, ids): (usize, &[u32; 2])| {
            let at = at as u32;
            let place = [at % rays.width, at / rays.width];
            (ids[0] != 0).then(|| self.of_ray(opaque, eye, direction(rays, place), at)).flatten()
        };
        met.par_iter().enumerate().filter_map(of).collect()
    }

    /// The layers of rays with these directions, in rows of `width`, as [`Self::of_tile`].
    pub(crate) fn of_listed(
        &self,
        opaque: &PacketTracer,
        eye: DVec3,
        directions: &[[f32; 4]],
        width: u32,
    ) -> Vec<RayLayers> {
        let met = self.transparent.trace_listed(eye, directions, width);
        let of = |(at, (ids, &[x, y, z, _])): (usize, (&[u32; 2], &[f32; 4]))| {
            let direction = Vec3::new(x, y, z).as_dvec3();
            (ids[0] != 0).then(|| self.of_ray(opaque, eye, direction, at as u32)).flatten()
        };
        met.par_iter().zip(directions).enumerate().filter_map(of).collect()
    }

    /// The layers of some rays of a tile, by column and row, as [`Self::of_tile`].
    pub(crate) fn of_list(
        &self,
        opaque: &PacketTracer,
        eye: DVec3,
        rays: &Rays,
        places: &[[u32; 2]],
    ) -> Vec<RayLayers> {
        let met = self.transparent.trace_some(eye, rays, places);
        let of = |(at, (&place, ids)): (usize, (&[u32; 2], &[u32; 2]))| {
            (ids[0] != 0).then(|| self.of_ray(opaque, eye, direction(rays, place), at as u32)).flatten()
        };
        places.par_iter().zip(&met).enumerate().filter_map(of).collect()
    }

    fn of_ray(&self, opaque: &PacketTracer, eye: DVec3, direction: DVec3, at: u32) -> Option<RayLayers> {
        let mut crossed: Vec<Layer<Hit>> = Vec::new();
        let _ = self.transparent.first(eye, direction, f64::INFINITY, |hit| {
            let alpha = self.transparent.coverage(hit);
            if alpha > 0.0 && alpha < OPAQUE && hit.t >= self.near {
                crossed.push(Layer { surface: *hit, alpha });
            }
            false
        });
        let farthest = crossed.iter().map(|layer| layer.surface.t).fold(0.0, f64::max);
        if farthest > 0.0 {
            // From the near plane on, as the backends see.
            let from = eye + direction * self.near;
            let most = farthest * (1.0 - SAME_PLACE) - self.near;
            let blocks = opaque.first(from, direction, most, |hit| opaque.coverage(hit) >= 1.0);
            let end = blocks.map_or(f64::INFINITY, |hit| (hit.t + self.near) * (1.0 + SAME_PLACE));
            crossed.retain(|layer| layer.surface.t <= end);
        }
        crossed.sort_by(|a, b| {
            let ids = |hit: &Hit| (hit.instance, hit.primitive);
            a.surface.t.total_cmp(&b.surface.t).then(ids(&a.surface).cmp(&ids(&b.surface)))
        });
        crossed.dedup_by(|b, a| {
            let (a, b) = (a.surface, b.surface);
            a.instance == b.instance && b.t - a.t <= SAME_PLACE * b.t
        });
        transparency::cut(&mut crossed, |Layer { surface: hit, alpha }| {
            is_met(*alpha, [hit.instance, hit.primitive], hit.weights.map(|weight| weight as f32))
        });
        let met = |hit: Hit| Met { ids: [hit.instance + 1, hit.primitive], t: hit.t };
        let layers: Vec<Layer<Met>> =
            crossed.iter().map(|layer| Layer { surface: met(layer.surface), alpha: layer.alpha }).collect();
        (!layers.is_empty()).then(|| RayLayers {
            at,
            shown: shown(&layers),
            layers,
            length: direction.length(),
        })
    }
}

fn transparent(is_transparent: &[bool], placements: &[Placement]) -> Vec<Placement> {
    let of = |placement: &&Placement| is_transparent[placement.mesh as usize];
    placements.iter().filter(of).copied().collect()
}

/// The ray through the centre of a sub-sample, as `ray_through` in `shaders/shared/rays.wgsl`, in f64.
pub(crate) fn direction(rays: &Rays, [x, y]: [u32; 2]) -> DVec3 {
    let world = |v: [f32; 3]| Vec3::from_array(v).as_dvec3();
    let [x, y] = [x, y].map(|place| f64::from(place) + 0.5);
    world(rays.top_left) + world(rays.right) * x + world(rays.down) * y
}

/// Layers of an image's rays, one for each ray that has so many: as they are shaded together.
pub(crate) struct LayerImage {
    /// Visibility, row by row; 0 where a ray has no such layer.
    pub(crate) ids: Vec<[u32; 2]>,
    /// Alpha; 0 without a layer, negative for the layer that the ray shows.
    pub(crate) alphas: Vec<f32>,
}

/// The images of the layers of rays in an image of `width` columns, from the hindmost layers to the foremost. `begin` and
/// `size`: the part of the image that they show.
pub(crate) fn images<'a>(
    rays: &'a [RayLayers],
    width: u32,
    begin: [u32; 2],
    size: [u32; 2],
) -> impl Iterator<Item = LayerImage> + 'a {
    let most = rays.iter().map(|ray| ray.layers.len()).max().unwrap_or(0);
    (0..most).map(move |from_behind| {
        let count = size[0] as usize * size[1] as usize;
        let mut image = LayerImage { ids: vec![[0; 2]; count], alphas: vec![0.0; count] };
        for ray in rays {
            let Some(index) = ray.layers.len().checked_sub(from_behind + 1) else { continue };
            let layer = &ray.layers[index];
            let [x, y] = [ray.at % width - begin[0], ray.at / width - begin[1]];
            let at = y as usize * size[0] as usize + x as usize;
            image.ids[at] = layer.surface.ids;
            image.alphas[at] = if ray.shown == Some(index) { -layer.alpha } else { layer.alpha };
        }
        image
    })
}

/// The part of a tile in which rays have layers, a little wider. `side`: rays along a texel's side, of which `rays` has so
/// many.
pub(crate) fn part_of(tile: &Tile, rays: &[RayLayers], side: u32) -> Tile {
    let width = tile.size[0] * side;
    let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
    for ray in rays {
        let place = [ray.at % width / side, ray.at / width / side];
        for axis in 0..2 {
            low[axis] = low[axis].min(place[axis] / ALIGNED * ALIGNED);
            high[axis] = high[axis].max((place[axis] + 1).next_multiple_of(ALIGNED));
        }
    }
    let begin = [0, 1].map(|axis| tile.begin[axis] + low[axis]);
    let size = [0, 1].map(|axis| high[axis].min(tile.size[axis]) - low[axis]);
    Tile { begin, size, ..*tile }
}

/// Ids of texels, repeated for `side` × `side` sub-samples. `width`: texels in a row.
pub(crate) fn repeated(ids: &[[u32; 2]], width: u32, side: u32) -> Vec<[u32; 2]> {
    let (width, side) = (width as usize, side as usize);
    let row = |row: &[[u32; 2]]| -> Vec<[u32; 2]> {
        let wide: Vec<[u32; 2]> = row.iter().flat_map(|ids| std::iter::repeat_n(*ids, side)).collect();
        wide.repeat(side)
    };
    ids.chunks(width.max(1)).flat_map(row).collect()
}

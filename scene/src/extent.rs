//! The extent of a scene: the box of the surfaces that viewers look at, without what is far away or far larger.
//!
//! The bounds of a scene hold every vertex, so one stray triangle or a ground plane decides them. Lengths that should
//! suit what viewers see, such as the spacing of sample cameras, follow from the extent instead.
//!
//! The extent is found in three steps:
//! 1. Quartiles of the triangles' centroids along each axis, once with equal weights and once weighted by area. In the
//!    latter no triangle has more than [`MOST_SHARE`] of the weight, so that a ground of two triangles does not outweigh
//!    what stands on it.
//! 2. Fences at [`FENCE`] times the longest of the three interquartile ranges (or the median size of a triangle, if that is
//!    longer) beyond the quartiles (Tukey, *Exploratory Data Analysis*, 1977, section 2D: values beyond such fences are "far
//!    out"). The box of both fences holds the bulk.
//! 3. Meshes that are flat or hollow, and [`BACKDROP`] times larger than all that is in the extent beside them, such as a
//!    sky dome or a ground of many triangles, are left out, and the first two steps are repeated without them. Meshes that
//!    the loader found to be backdrops ([`crate::Material::backdrop`]) never count.
//!
//! The extent is the box of all surfaces within the fences. Triangles that reach out of them are cut off there. Where no
//! surface is far out, as in most scenes, the extent equals the bounds.

use glam::DVec3;

use crate::animation::Animation;
use crate::{Bounds, Instance, Scene};

/// Greatest share of the area that one triangle counts for.
const MOST_SHARE: f64 = 1.0 / 8.0;

/// Distance of the fences from the quartiles, in interquartile ranges.
const FENCE: f64 = 3.0;

/// Ratio of sizes from which a mesh is a backdrop of the other meshes. A room is seldom that much larger than all that
/// is in it.
const BACKDROP: f64 = 32.0;

/// Most triangles that quartiles are computed from. Of larger scenes every n-th triangle of each mesh is taken.
const MOST_TRIANGLES: usize = 1 << 15;

/// Most moments of an animated scene whose surfaces count.
const MOMENTS: u32 = 4;

impl Scene {
    /// The box of the surfaces that viewers look at, over all times of an animated scene; see the module [`crate::extent`].
    /// Meshes that deform count in their shapes of time zero. It lies within the bounds of all that counts, and holds the
    /// eyes of the scene's cameras that lie within these. Empty if the scene has no finite triangle.
    pub fn extent(&self) -> Bounds {
        // Wherever clients move nodes, the box stays: lattices of light hang on it.
        if let Some(moved) = &self.by_request {
            return moved.base.extent();
        }
        let moments = if self.is_animated() { MOMENTS } else { 1 };
        let secs =
            self.animations.iter().map(Animation::length_secs).fold(0.0, f64::max) / f64::from(moments);
        let posed = (0..moments).flat_map(|moment| self.at(secs * f64::from(moment)).instances);
        let all: Vec<Part> = posed.filter_map(|instance| Part::new(self, &instance)).collect();
        let mut parts: Vec<&Part> = all.iter().filter(|part| !part.is_backdrop(self)).collect();
        if parts.is_empty() {
            parts = all.iter().collect();
        }
        let mut extent = extent_of(self, &parts);
        while let Some((rest, of_rest)) = without_backdrop(self, &parts, &extent) {
            (parts, extent) = (rest, of_rest);
        }
        let bounds = all.iter().fold(Bounds::EMPTY, |bounds, part| bounds.union(&part.bounds));
        for eye in self.cameras.iter().map(|named| named.camera.eye).filter(|eye| bounds.contains(*eye)) {
            extent.extend(eye);
        }
        extent
    }

    /// Share of the area at time zero whose triangles are not within a box.
    pub fn area_beyond(&self, extent: &Bounds) -> f64 {
        let (mut all, mut beyond) = (0.0, 0.0);
        for part in self.instances.iter().filter_map(|instance| Part::new(self, instance)) {
            for triangle in part.triangles(self, 1) {
                let (area, bounds) = (area_of(triangle), box_of(triangle));
                all += area;
                beyond += if extent.contains(bounds.min) && extent.contains(bounds.max) { 0.0 } else { area };
            }
        }
        if all > 0.0 { beyond / all } else { 0.0 }
    }
}

/// A placed mesh.
struct Part {
    instance: Instance,
    bounds: Bounds,
}

impl Part {
    /// `None` for a mesh without finite vertices.
    fn new(scene: &Scene, instance: &Instance) -> Option<Self> {
        let mesh = &scene.meshes[instance.mesh as usize];
        let mut bounds = Bounds::EMPTY;
        for position in &mesh.positions {
            bounds.extend(instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3()));
        }
        (!bounds.is_empty()).then_some(Self { instance: *instance, bounds })
    }

    fn is_backdrop(&self, scene: &Scene) -> bool {
        let mesh = &scene.meshes[self.instance.mesh as usize];
        scene.materials.get(mesh.material as usize).is_some_and(|material| material.backdrop)
    }

    /// Whether it is a level, or a wall.
    fn is_flat(&self) -> bool {
        let size = self.bounds.size();
        size.min_element() * BACKDROP <= size.max_element()
    }

    /// Whether none of its triangles reaches into the middle third of its box.
    fn is_hollow(&self, scene: &Scene) -> bool {
        let (center, size) = (self.bounds.center(), self.bounds.size());
        let middle = Bounds { min: center - size / 6.0, max: center + size / 6.0 };
        self.triangles(scene, 1).all(|triangle| middle.intersection(&box_of(triangle)).is_empty())
    }

    /// Corners of every `step`-th triangle, metres, world space. Triangles that are not finite are left out.
    fn triangles<'a>(&self, scene: &'a Scene, step: usize) -> impl Iterator<Item = [DVec3; 3]> + 'a {
        let Instance { mesh, world_from_mesh, .. } = self.instance;
        let mesh = &scene.meshes[mesh as usize];
        let corner = move |&index: &u32| {
            world_from_mesh.transform_point3(mesh.origin + mesh.positions[index as usize].as_dvec3())
        };
        let triangles = mesh.indices.as_chunks::<3>().0.iter().step_by(step.max(1));
        triangles
            .map(move |three| three.each_ref().map(corner))
            .filter(|three| three.iter().all(|p| p.is_finite()))
    }
}

fn area_of([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

fn box_of([a, b, c]: [DVec3; 3]) -> Bounds {
    Bounds { min: a.min(b).min(c), max: a.max(b).max(c) }
}

/// The parts without their backdrops, and the extent of these; `None` if there is no backdrop.
fn without_backdrop<'a>(
    scene: &Scene,
    parts: &[&'a Part],
    extent: &Bounds,
) -> Option<(Vec<&'a Part>, Bounds)> {
    let size = extent.size().max_element();
    let is_large = |part: &&&Part| part.bounds.size().max_element() * 2.0 >= size;
    let large: Vec<&Part> = parts.iter().filter(is_large).copied().collect();
    let rest: Vec<&Part> = parts.iter().filter(|part| !is_large(part)).copied().collect();
    if rest.is_empty() || large.is_empty() {
        return None;
    }
    let of_rest = extent_of(scene, &rest);
    let rest_size = of_rest.size().max_element();
    let is_apart = rest_size > 0.0 && rest_size * BACKDROP <= size;
    // A stray mesh is outside of the extent.
    let is_within = !extent.intersection(&of_rest).is_empty();
    let is_bare = || large.iter().all(|part| part.is_flat() || part.is_hollow(scene));
    (is_apart && is_within && is_bare()).then_some((rest, of_rest))
}

/// The extent of some parts.
fn extent_of(scene: &Scene, parts: &[&Part]) -> Bounds {
    let fences = fences(scene, parts);
    let mut extent = Bounds::EMPTY;
    for part in parts {
        // Spares the triangles of a part that lies inside.
        if fences.contains(part.bounds.min) && fences.contains(part.bounds.max) {
            extent = extent.union(&part.bounds);
            continue;
        }
        for triangle in part.triangles(scene, 1) {
            let inside = box_of(triangle).intersection(&fences);
            if !inside.is_empty() {
                extent = extent.union(&inside);
            }
        }
    }
    extent
}

/// A triangle as it counts for quartiles.
struct Weighted {
    centroid: DVec3,
    /// Number of triangles that it stands for.
    count: f64,
    /// Area that it stands for, square metres.
    area: f64,
    /// Longest edge of its box, metres.
    size: f64,
}

/// The box that holds the bulk of the parts' surfaces.
fn fences(scene: &Scene, parts: &[&Part]) -> Bounds {
    let count = |part: &&Part| scene.meshes[part.instance.mesh as usize].triangles();
    let step = parts.iter().map(count).sum::<usize>().div_ceil(MOST_TRIANGLES).max(1);
    let mut triangles = Vec::new();
    for part in parts {
        let taken: Vec<[DVec3; 3]> = part.triangles(scene, step).collect();
        // The first of a mesh of few triangles does not stand for more than it has.
        let each = count(part) as f64 / taken.len().max(1) as f64;
        triangles.extend(taken.into_iter().map(|[a, b, c]| Weighted {
            centroid: (a + b + c) / 3.0,
            count: each,
            area: area_of([a, b, c]) * each,
            size: box_of([a, b, c]).size().max_element(),
        }));
    }
    let most = most_area(&triangles);
    let by_count = fences_of(&triangles, |triangle| triangle.count);
    let by_area = fences_of(&triangles, |triangle| triangle.area.min(most));
    by_count.union(&by_area)
}

/// The area to which larger triangles are reduced, so that none has more than [`MOST_SHARE`] of the sum.
fn most_area(triangles: &[Weighted]) -> f64 {
    let mut areas: Vec<f64> = triangles.iter().map(|triangle| triangle.area).collect();
    areas.sort_unstable_by(|a, b| b.total_cmp(a));
    // With the n largest reduced to x: x = share · (n·x + sum of the others).
    let mut others: f64 = areas.iter().sum();
    for (reduced, &area) in areas.iter().enumerate() {
        let most = MOST_SHARE * others / (1.0 - MOST_SHARE * reduced as f64);
        if MOST_SHARE * reduced as f64 >= 1.0 {
            break;
        }
        if area <= most {
            return most;
        }
        others -= area;
    }
    // Few triangles: all count the same.
    areas.last().copied().unwrap_or(0.0)
}

/// The box between the fences of centroids with these weights; empty without weight.
fn fences_of(triangles: &[Weighted], weight: impl Fn(&Weighted) -> f64) -> Bounds {
    let total: f64 = triangles.iter().map(&weight).sum();
    if !(total > 0.0 && total.is_finite()) {
        return Bounds::EMPTY;
    }
    let quantiles = |value: &dyn Fn(&Weighted) -> f64, shares: [f64; 2]| {
        let mut values: Vec<(f64, f64)> =
            triangles.iter().map(|triangle| (value(triangle), weight(triangle))).collect();
        values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        shares.map(|share| {
            let mut sum = 0.0;
            let reached = values.iter().find(|(_, weight)| {
                sum += weight;
                sum >= share * total
            });
            reached.or(values.last()).map_or(0.0, |(value, _)| *value)
        })
    };
    let [x, y, z] = [0, 1, 2].map(|axis| quantiles(&|triangle| triangle.centroid[axis], [0.25, 0.75]));
    let (first, third) = (DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1]));
    let [median_size, _] = quantiles(&|triangle| triangle.size, [0.5, 1.0]);
    // The same on all axes, since a scene may be flat. Centroids of few triangles lie closer than their corners.
    let beyond = FENCE * (third - first).max_element().max(median_size);
    Bounds { min: first - beyond, max: third + beyond }
}

#[cfg(test)]
mod tests;

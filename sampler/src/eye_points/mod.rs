//! Eye-based point rendering on the CPU (Gavane and Watson, "Eye-Based Point Rendering for Dynamic Multiview Effects", 2022).
//!
//! Each reflective object has a map of what surrounds it. The maps are filled with points whose density follows the pixels of
//! the *eye*, not the texels of the maps, and only what the eye sees in reflections is shaded. This is the definition of the
//! method in f64, which programs for the GPU are compared with. Sections are those of the paper.
//!
//! # Passes
//!
//! 1. [`facets`]: triangles become pieces of one [`density`] each, with a bit for each reflector that sees them (3.1, 3.2).
//! 2. [`cells`]: points of all pieces, conservatively (3.3). Over a budget, density is lowered and points are made again.
//! 3. [`splat`]: points are written into the texels of [`maps`] that see them, with the range on the texel's ray (3.5).
//! 4. [`requests`]: the eye's taps look maps up ([`lookup`]) and mark what they meet; each marked point is shaded once; the
//!    taps' radiance is averaged (4.1.2, 4.1.3).
//!
//! Bytes are equal for any number of threads.

mod cells;
mod density;
mod facets;
mod lookup;
mod maps;
mod reflectors;
mod requests;
mod splat;
#[cfg(test)]
mod tests;
mod traced;

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use argus_scene::{Scene, Stage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::packets::cutouts::Cutouts;
pub use cells::{Grid, Point, Rows};
pub use density::{Density, DensityRule, density_for};
use facets::Cutter;
pub use facets::{Facet, Piece, Pieces, Side};
pub use lookup::{STEPS, lookup};
pub use maps::Maps;
pub use reflectors::{Eye, LARGEST_SIDE, PointReflector, map_side};
pub use requests::{Lookups, ReflectivePixel, Requests, taps};
use splat::Splats;
pub use traced::{MetByRay, ReflectionRays};

/// Whether a cut-out is open somewhere.
pub(crate) trait Cut: Sync {
    /// Whether rays pass through a point of a facet.
    fn is_open(&self, facet: &Facet, point: DVec3) -> bool;
}

impl Cut for Cutouts {
    fn is_open(&self, facet: &Facet, point: DVec3) -> bool {
        let [second, third] = facet.weights(point);
        self.let_through([facet.instance, facet.primitive], second as f32, third as f32)
    }
}

/// A scene at a pose, prepared for points.
pub struct PointScene {
    facets: Vec<Facet>,
    cutouts: Cutouts,
}

impl fmt::Debug for PointScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PointScene").field("facets", &self.facets.len()).finish_non_exhaustive()
    }
}

/// How points are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EyePointKnobs {
    /// Density of points.
    pub density: Density,
    /// Most points, 8 bytes each. More are never made, as long as there are no more pieces.
    pub budget: u32,
    /// Whether most triangles below a tenth of a cell are left out (section 3.2). It saves points and may leave holes.
    pub culling: bool,
}

impl Default for EyePointKnobs {
    fn default() -> Self {
        Self { density: Density::default(), budget: 1 << 25, culling: false }
    }
}

/// How a budget was kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BudgetReport {
    /// Points at full density.
    pub wanted: u64,
    /// Factor on the density, linear: 1 within the budget.
    pub reduction: f64,
    /// Whether the points fit in the budget. If not, there are more pieces of triangles than points are allowed.
    pub kept: bool,
}

/// Points and the maps that they fill.
pub struct EyePoints {
    /// Pieces of triangles.
    pub pieces: Pieces,
    /// Points, in the order of pieces.
    pub points: Vec<Point>,
    /// First point of each piece, and the number of all.
    first: Vec<u32>,
    /// The reflectors' maps. Ids are indices of points.
    pub maps: Maps,
    /// How the budget was kept.
    pub budget: BudgetReport,
    /// Time of each pass.
    pub stages: Vec<Stage>,
}

/// A surface that is to be shaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadingPoint {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Weights of the mesh's second and third corner.
    pub weights: [f64; 2],
    /// Metres, world space.
    pub position: DVec3,
    /// The side that is seen.
    pub side: Side,
    /// Two edges of the area that it stands for, metres, world space.
    pub footprint: [DVec3; 2],
}

/// Most rounds in which density is lowered.
const MOST_ROUNDS: u32 = 6;
/// Least and largest factor on the density in a round after the first.
const LARGEST_STEP: f64 = 0.05;
const SMALLEST_STEP: f64 = 0.95;

impl PointScene {
    /// The triangles of a scene at a time in seconds.
    pub fn new(scene: &Arc<Scene>, time_secs: f64) -> Self {
        Self { facets: Facet::all(scene, &scene.at(time_secs).instances), cutouts: Cutouts::new(scene) }
    }

    /// All triangles, in the order of instances.
    pub fn facets(&self) -> &[Facet] {
        &self.facets
    }

    /// Makes points for reflectors that an eye sees, and fills their maps.
    pub fn points(&self, eye: &Eye, reflectors: &[PointReflector], knobs: &EyePointKnobs) -> EyePoints {
        let mut begin = Instant::now();
        let mut stages = Vec::new();
        let mut stage = |name: &'static str| {
            stages.push(Stage::new(name, begin.elapsed().as_secs_f64() * 1e3));
            begin = Instant::now();
        };
        let (pieces, first, budget) = self.pieces(eye, reflectors, knobs);
        stage("density");
        let points = generate(&pieces, &first);
        stage("points");
        let maps = Maps::new(reflectors);
        let splats = Splats {
            facets: &self.facets,
            pieces: &pieces,
            points: &points,
            first: &first,
            reflectors,
            cut: &self.cutouts,
        };
        splats.splat_to(&maps);
        stage("splat");
        EyePoints { pieces, points, first, maps, budget, stages }
    }

    /// Pieces whose points fit in the budget, and the first point of each.
    fn pieces(
        &self,
        eye: &Eye,
        reflectors: &[PointReflector],
        knobs: &EyePointKnobs,
    ) -> (Pieces, Vec<u32>, BudgetReport) {
        let (mut reduction, mut wanted) = (knobs.density.reduction, None);
        for round in 0.. {
            let density = Density { reduction, ..knobs.density };
            let pieces = Cutter { eye, reflectors, density, culling: knobs.culling }.cut(&self.facets);
            let counts: Vec<u64> = pieces.all.par_iter().map(|piece| piece.rows().cells()).collect();
            let sum: u64 = counts.iter().sum();
            let wanted = *wanted.get_or_insert(sum);
            let kept = sum <= u64::from(knobs.budget);
            if kept || round == MOST_ROUNDS {
                let mut next = 0u32;
                let mut first: Vec<u32> = Vec::with_capacity(counts.len() + 1);
                for count in counts {
                    first.push(next);
                    next = next.saturating_add(count as u32);
                }
                first.push(next);
                return (pieces, first, BudgetReport { wanted, reduction, kept });
            }
            let budget = f64::from(knobs.budget);
            reduction *= match round {
                0 => (budget / sum as f64).sqrt(),
                // Cells on edges follow the density itself, and every piece keeps one.
                _ => {
                    let pieces = pieces.all.len() as f64;
                    ((budget - pieces) / (sum as f64 - pieces)).clamp(LARGEST_STEP, SMALLEST_STEP)
                }
            };
        }
        unreachable!("the last round returns")
    }

    /// Fills maps with whole triangles, as a rasteriser would: multi-view rendering. Ids are indices of facets.
    pub fn rasterise(&self, reflectors: &[PointReflector]) -> Maps {
        let maps = Maps::new(reflectors);
        Splats::rasterise(&self.facets, reflectors, &self.cutouts, &maps);
        maps
    }

    /// What a texel of a map with ids of facets sees, for shading.
    pub fn shading_of_texel(
        &self,
        maps: &Maps,
        reflectors: &[PointReflector],
        texel: usize,
    ) -> Option<ShadingPoint> {
        let (id, range) = maps.get(texel)?;
        let facet = self.facets.get(id as usize)?;
        let (map, direction) = maps.direction_of(texel);
        let reflector = &reflectors[map];
        let direction = direction.normalize();
        let position = reflector.center + direction * range;
        let width = 2.0 * range / f64::from(reflector.side);
        let normal = facet.area_vector().normalize_or(direction);
        // A square of a texel's width in the triangle's plane.
        let right = normal.any_orthonormal_vector();
        Some(ShadingPoint {
            instance: facet.instance,
            primitive: facet.primitive,
            weights: facet.weights(position),
            position,
            side: if normal.dot(direction) < 0.0 { Side::Front } else { Side::Back },
            footprint: [right * width, normal.cross(right) * width],
        })
    }

    /// A point, for shading: the middle of its cell, or the closest place of its triangle.
    pub fn shading_of_point(&self, points: &EyePoints, id: u32) -> ShadingPoint {
        let point = points.points[id as usize];
        let piece = &points.pieces.all[point.piece() as usize];
        let facet = &self.facets[piece.facet as usize];
        let middle = piece.grid.point(point.middle());
        let position = argus_scene::closest_on_triangle(middle, facet.corners);
        let width = piece.grid.density.recip();
        ShadingPoint {
            instance: facet.instance,
            primitive: facet.primitive,
            weights: facet.weights(position),
            position,
            side: piece.side,
            footprint: [piece.grid.right * width, piece.grid.up * width],
        }
    }
}

/// The points of all pieces, each from its place in the list on.
fn generate(pieces: &Pieces, first: &[u32]) -> Vec<Point> {
    let mut points = vec![Point(0); first.last().map_or(0, |count| *count as usize)];
    let mut parts = Vec::with_capacity(pieces.all.len());
    let mut rest = points.as_mut_slice();
    for (number, piece) in pieces.all.iter().enumerate() {
        let (part, others) = rest.split_at_mut((first[number + 1] - first[number]) as usize);
        rest = others;
        parts.push((number as u32, piece, part));
    }
    parts.into_par_iter().with_min_len(16).for_each(|(number, piece, part)| {
        let rows = piece.rows();
        let cells = (0..rows.count).flat_map(|row| rows.columns(row).map(move |column| (row, column)));
        for (point, (row, column)) in part.iter_mut().zip(cells) {
            *point = Point::new(number, row as u16, column as u16);
        }
    });
    points
}

impl EyePoints {
    /// Bytes of pieces, points and maps.
    pub fn bytes(&self) -> usize {
        self.pieces.bytes() + size_of_val(&self.points[..]) + size_of_val(&self.first[..]) + self.maps.bytes()
    }
}

/// Radiance that pixels reflect, and what finding it took.
#[derive(Debug, Clone)]
pub struct Reflected {
    /// Mean radiance of each pixel's taps.
    pub radiance: Vec<Vec3>,
    /// Number of shaded points.
    pub shades: usize,
    /// Bytes of bits and of shaded radiance.
    pub bytes: usize,
    /// Time of each pass.
    pub stages: Vec<Stage>,
}

/// Requests, shades and looks up what pixels reflect. `count` and `id_of` are those of [`Lookups::request`]; `shade` gives the
/// radiance of an id.
pub fn reflect(
    lookups: &Lookups<'_>,
    sky: &argus_scene::Sky,
    count: usize,
    id_of: impl Fn(usize, u32) -> u32 + Sync,
    shade: impl Fn(u32) -> Vec3 + Sync,
) -> Reflected {
    let begin = Instant::now();
    let requests = lookups.request(count, &id_of);
    shade_and_mirror(lookups, sky, (&requests, begin), id_of, shade)
}

/// Shades all ids, as rendering does that is not deferred to the eye, and looks up what pixels reflect. Arguments are those of
/// [`reflect`].
pub fn reflect_all(
    lookups: &Lookups<'_>,
    sky: &argus_scene::Sky,
    count: usize,
    id_of: impl Fn(usize, u32) -> u32 + Sync,
    shade: impl Fn(u32) -> Vec3 + Sync,
) -> Reflected {
    let begin = Instant::now();
    let requests = Requests::all(lookups.maps, count, &id_of);
    shade_and_mirror(lookups, sky, (&requests, begin), id_of, shade)
}

fn shade_and_mirror(
    lookups: &Lookups<'_>,
    sky: &argus_scene::Sky,
    (requests, mut begin): (&Requests, Instant),
    id_of: impl Fn(usize, u32) -> u32 + Sync,
    shade: impl Fn(u32) -> Vec3 + Sync,
) -> Reflected {
    let mut stages = Vec::new();
    let mut stage = |name: &'static str| {
        stages.push(Stage::new(name, begin.elapsed().as_secs_f64() * 1e3));
        begin = Instant::now();
    };
    let ids = requests.ids();
    stage("request");
    let shaded: Vec<Vec3> = ids.par_iter().with_min_len(64).map(|&id| shade(id)).collect();
    stage("shade");
    let radiance = lookups.mirror(requests, &shaded, sky, &id_of);
    stage("mirror");
    let bytes = requests.bytes() + size_of_val(&shaded[..]);
    Reflected { radiance, shades: shaded.len(), bytes, stages }
}

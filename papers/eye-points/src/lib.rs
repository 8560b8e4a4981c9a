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
//! 3. [`splat`]: points are written into the texels of [`IndexMaps`] that see them, with the range on the texel's ray (3.5).
//! 4. [`requests`]: the eye's taps look maps up ([`lookup`]) and mark what they meet; each marked point is shaded once; the
//!    taps' radiance is averaged (4.1.2, 4.1.3).
//!
//! Bytes are equal for any number of threads. [`PointDevice`] runs the second and the third pass on the GPU, or all of them but
//! the shading ([`DevicePoints`]).
//!
//! [`add_to`] plugs the method into a sampler: as a source of reflection probes, and of what direct views reflect (`plugged.rs`).

mod adaptive;
mod bounces;
mod budget;
mod buffer;
mod cells;
mod compute;
#[cfg(test)]
mod compute_tests;
mod density;
pub mod device;
mod facets;
#[cfg(test)]
mod hard_tests;
mod indexed;
mod layout;
mod lookup;
mod on_device;
#[cfg(test)]
mod on_device_tests;
mod planar;
mod plugged;
pub mod programs;
mod reflect_on_device;
mod reflectors;
mod requests;
mod shadows;
mod splat;
#[cfg(test)]
mod tests;

use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use argus_scene::{Scene, Stage};
use glam::Vec3;
use rayon::prelude::*;

use argus_sampler::plug::{Cutouts, IndexMaps, MappedReflector, Requests, Side, SurfacePoint};

pub use adaptive::reflect_adaptively;
pub use bounces::{Bounces, Mirror, Sight, Surfaces};
pub use budget::BudgetReport;
use budget::within_budget;
pub use buffer::Splatting;
use buffer::generate;
pub use cells::{Grid, Point, Rows};
pub use compute::PointDevice;
pub use density::{Density, DensityRule, density_for};
use facets::Cutter;
pub use facets::{Facet, Piece, Pieces};
pub use lookup::{STEPS, lookup};
pub use on_device::DevicePoints;
pub use planar::{LARGEST_MIRROR_SIDE, planar_reflector};
pub use plugged::add_to;
pub use reflect_on_device::DeviceLookups;
pub use reflectors::{Eye, LARGEST_SIDE, curved_reflector, map_side};
pub use requests::{Lookups, ReflectivePixel};
pub use shadows::{LARGEST_SHADOW_SIDE, is_lit, light_map, light_points, shadow_side};
use splat::Splats;

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
pub struct EyePointSettings {
    /// Density of points.
    pub density: Density,
    /// Most points, 8 bytes each. More are never made, as long as there are no more pieces.
    pub budget: u32,
    /// Whether most triangles below a tenth of a cell are left out (section 3.2). It saves points. Those that stand alone,
    /// where a map would see nothing without them, are kept as far as the budget allows.
    pub culling: bool,
}

impl Default for EyePointSettings {
    fn default() -> Self {
        Self { density: Density::default(), budget: 1 << 25, culling: false }
    }
}

/// Points and the maps that they fill.
pub struct EyePoints {
    /// Pieces of triangles.
    pub pieces: Pieces,
    /// Stored points, in the order of pieces: those that splatting needs a buffer for.
    pub points: Vec<Point>,
    /// First point of each piece, and the number of all.
    first: Vec<u32>,
    /// First stored point of each piece, and the number of all.
    stored: Vec<u32>,
    /// The reflectors' maps. Ids are indices of points.
    pub maps: IndexMaps,
    /// How the budget was kept.
    pub budget: BudgetReport,
    /// Time of each pass.
    pub stages: Vec<Stage>,
}

/// A clock of passes, one after the other.
struct Stages {
    all: Vec<Stage>,
    begin: Instant,
}

impl Stages {
    fn new() -> Self {
        Self { all: Vec::new(), begin: Instant::now() }
    }

    /// Ends a pass; the next one begins.
    fn end(&mut self, name: &'static str) {
        self.all.push(Stage::new(name, self.begin.elapsed().as_secs_f64() * 1e3));
        self.begin = Instant::now();
    }

    fn all(self) -> Vec<Stage> {
        self.all
    }
}

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
    pub fn points(
        &self,
        eye: &Eye,
        reflectors: &[MappedReflector],
        settings: &EyePointSettings,
    ) -> EyePoints {
        self.points_by(eye, reflectors, settings, Splatting::Buffered)
    }

    /// Makes points for reflectors that an eye sees, and fills their maps. All ways to splat give the same maps.
    pub fn points_by(
        &self,
        eye: &Eye,
        reflectors: &[MappedReflector],
        settings: &EyePointSettings,
        splatting: Splatting,
    ) -> EyePoints {
        let mut stages = Stages::new();
        let ([mut pieces, culled], mut first, budget) = self.pieces(eye, reflectors, settings);
        stages.end("density");
        let mut stored = vec![0];
        splatting.extend_stored(&mut stored, &pieces, &first, reflectors);
        let mut points = generate(&pieces, &stored, 0);
        stages.end("points");
        let maps = IndexMaps::new(reflectors);
        let splats = self.splats(&pieces, (&points, &stored), &first, reflectors);
        splats.splat_to(&maps, 0);
        let buffer = (splatting, &mut points, &mut stored);
        self.add_alone(&culled, &mut pieces, &mut first, buffer, &maps, (reflectors, settings));
        stages.end("splat");
        EyePoints { pieces, points, first, stored, maps, budget, stages: stages.all() }
    }

    /// Adds and splats the culled pieces that stand alone, which would leave holes, as far as the budget allows. Their points
    /// are stored beside those of the others, if they are stored at all.
    fn add_alone(
        &self,
        culled: &Pieces,
        pieces: &mut Pieces,
        first: &mut Vec<u32>,
        (splatting, points, stored): (Splatting, &mut Vec<Point>, &mut Vec<u32>),
        maps: &IndexMaps,
        (reflectors, settings): (&[MappedReflector], &EyePointSettings),
    ) {
        let alone = self.splats(pieces, (points, stored), first, reflectors).fill_holes(culled, maps);
        let kept = pieces.all.len();
        for index in alone {
            let count = u64::from(first[pieces.all.len()]) + culled.all[index].rows().cells();
            if count <= u64::from(settings.budget) {
                pieces.push(culled.all[index], culled.bits(index));
                first.push(count as u32);
            }
        }
        splatting.extend_stored(stored, pieces, first, reflectors);
        points.extend(generate(pieces, stored, kept));
        self.splats(pieces, (points, stored), first, reflectors).splat_to(maps, kept);
    }

    fn splats<'a>(
        &'a self,
        pieces: &'a Pieces,
        (points, stored): (&'a [Point], &'a [u32]),
        first: &'a [u32],
        reflectors: &'a [MappedReflector],
    ) -> Splats<'a> {
        Splats { facets: &self.facets, pieces, points, stored, first, reflectors, cut: &self.cutouts }
    }

    /// Pieces whose points fit in the budget, pieces that are culled, and the first point of each of the former.
    fn pieces(
        &self,
        eye: &Eye,
        reflectors: &[MappedReflector],
        settings: &EyePointSettings,
    ) -> ([Pieces; 2], Vec<u32>, BudgetReport) {
        let mut counts = Vec::new();
        let count = |pieces: &Pieces| {
            counts = pieces.all.par_iter().map(|piece| piece.rows().cells()).collect();
            Ok::<u64, Infallible>(counts.iter().sum())
        };
        let Ok((pieces, budget)) = self.pieces_within(eye, reflectors, settings, count);
        let mut next = 0u32;
        let mut first: Vec<u32> = Vec::with_capacity(counts.len() + 1);
        for count in counts {
            first.push(next);
            next = next.saturating_add(count as u32);
        }
        first.push(next);
        (pieces, first, budget)
    }

    /// Pieces whose points fit in the budget, and pieces that are culled. `count` counts the points of pieces; its last call is
    /// for those that are returned.
    fn pieces_within<E>(
        &self,
        eye: &Eye,
        reflectors: &[MappedReflector],
        settings: &EyePointSettings,
        mut count: impl FnMut(&Pieces) -> Result<u64, E>,
    ) -> Result<([Pieces; 2], BudgetReport), E> {
        within_budget((settings.density, settings.budget), |density| {
            let cutter = Cutter { eye, reflectors, density, culling: settings.culling };
            let [pieces, culled] = cutter.cut_and_culled(&self.facets);
            let counts = [pieces.all.len() as u64, count(&pieces)?];
            Ok(([pieces, culled], counts))
        })
    }

    /// Fills maps with whole triangles, as a rasteriser would: multi-view rendering. Ids are indices of facets.
    pub fn rasterise(&self, reflectors: &[MappedReflector]) -> IndexMaps {
        let maps = IndexMaps::new(reflectors);
        Splats::rasterise(&self.facets, reflectors, &self.cutouts, &maps);
        maps
    }

    /// What a texel of a map with ids of facets sees, for shading.
    pub fn shading_of_texel(
        &self,
        maps: &IndexMaps,
        reflectors: &[MappedReflector],
        texel: usize,
    ) -> Option<SurfacePoint> {
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
        Some(SurfacePoint {
            instance: facet.instance,
            primitive: facet.primitive,
            weights: facet.weights(position),
            position,
            side: if normal.dot(direction) < 0.0 { Side::Front } else { Side::Back },
            footprint: [right * width, normal.cross(right) * width],
        })
    }

    /// A point, for shading: the middle of its cell, or the closest place of its triangle.
    pub fn shading_of_point(&self, points: &EyePoints, id: u32) -> SurfacePoint {
        let point = points.point(id);
        self.shading_of_cell(&points.pieces.all[point.piece() as usize], point)
    }

    /// The point of a piece, for shading.
    fn shading_of_cell(&self, piece: &Piece, point: Point) -> SurfacePoint {
        let facet = &self.facets[piece.facet as usize];
        let middle = piece.grid.point(point.middle());
        let position = argus_scene::closest_on_triangle(middle, facet.corners);
        let width = piece.grid.density.recip();
        SurfacePoint {
            instance: facet.instance,
            primitive: facet.primitive,
            weights: facet.weights(position),
            position,
            side: piece.side,
            footprint: [piece.grid.right * width, piece.grid.up * width],
        }
    }
}

impl EyePoints {
    /// Number of points, whether a buffer has them or not.
    pub fn count(&self) -> usize {
        self.first.last().map_or(0, |count| *count as usize)
    }

    /// A point that a texel names.
    pub fn point(&self, id: u32) -> Point {
        if self.points.len() == self.count() {
            return self.points[id as usize];
        }
        let piece = self.first.partition_point(|first| *first <= id) - 1;
        let number = (id - self.first[piece]) as usize;
        let stored = self.stored[piece] as usize..self.stored[piece + 1] as usize;
        if let Some(&point) = self.points[stored].get(number) {
            return point;
        }
        let [row, column] = self.pieces.all[piece].cells().nth(number).unwrap_or_default();
        Point::new(piece as u32, row, column)
    }

    /// Bytes of pieces, points and maps.
    pub fn bytes(&self) -> usize {
        let numbers = size_of_val(&self.first[..]) + size_of_val(&self.stored[..]);
        self.pieces.bytes() + size_of_val(&self.points[..]) + numbers + self.maps.bytes()
    }
}

/// Radiance that pixels reflect, and what finding it took.
#[derive(Debug, Clone)]
pub struct Reflected {
    /// Mean radiance of each pixel's taps.
    pub radiance: Vec<Vec3>,
    /// Number of shaded points.
    pub shades: usize,
    /// Bytes of looked-up texels, bits and shaded radiance.
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
    let stages = Stages::new();
    let requests = lookups.request(count, &id_of);
    shade_and_mirror(lookups, sky, (&requests, stages), id_of, shade)
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
    let stages = Stages::new();
    let requests = Requests::all(lookups.maps, count, &id_of);
    shade_and_mirror(lookups, sky, (&requests, stages), id_of, shade)
}

fn shade_and_mirror(
    lookups: &Lookups<'_>,
    sky: &argus_scene::Sky,
    (requests, mut stages): (&Requests, Stages),
    id_of: impl Fn(usize, u32) -> u32 + Sync,
    shade: impl Fn(u32) -> Vec3 + Sync,
) -> Reflected {
    let ids = requests.ids();
    stages.end("request");
    let shaded: Vec<Vec3> = ids.par_iter().with_min_len(64).map(|&id| shade(id)).collect();
    stages.end("shade");
    let radiance = lookups.mirror(requests, &shaded, sky, &id_of);
    stages.end("mirror");
    let bytes = requests.bytes() + size_of_val(&shaded[..]);
    Reflected { radiance, shades: shaded.len(), bytes, stages: stages.all() }
}

//! Leaf sides: what the surfaces in a cell are, seen from one side.

mod changes;
mod hits;
mod packed;

use argus_scene::Bounds;
use argus_scene::light_sampling::r2;
use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::super::lattice::Lattice;
use super::super::pattern::hash;
use super::super::shading_points::ShadingPoint;
use super::grid::{Grid, Table};
use super::polygon::Polygon;
use crate::light_rays::LightRaysAbout;
use crate::resident::{Cull, Placement};
use crate::surfaces::Surfaces;

pub(in crate::light) use changes::{LeafChanges, LeafRead};

/// Cosine of the angle within which surfaces of a cell are one leaf side: 45°.
const ALIKE: f32 = 0.707;
/// Directions that the surfaces of a cell are divided by, at most. Further surfaces join the most alike.
const MOST_FACINGS: usize = 4;
/// Least area of a leaf side, in areas of a cell's face. Hits on smaller ones are looked up in neighbouring cells.
const LEAST_AREA: f32 = 1e-3;
/// Cosine of the angle within which neighbours share their light: 25°.
const NEIGHBOUR: f32 = 0.906;
/// Distance of planes within which neighbours share their light, in cells.
const SAME_PLANE: f32 = 0.5;

/// Leaf sides of a posed scene. Positions are metres about the centre.
pub(in crate::light) struct Leaves {
    center: DVec3,
    grid: Grid,
    table: Table,
    /// Morton numbers of occupied cells, ascending.
    keys: Vec<u32>,
    /// For each cell, its first leaf side; one entry more.
    first: Vec<u32>,
    pub(in crate::light) sides: Vec<Side>,
    /// Where the rays of each leaf side start.
    points: Vec<Point>,
    rays: usize,
    triangles: Vec<[Vec3; 3]>,
    /// First triangle and index of each placed instance, ascending.
    placed: Vec<(u32, u32)>,
    /// First triangle of each instance.
    first_of_instance: Vec<u32>,
}

/// Surfaces of a cell, seen from one side.
pub(in crate::light) struct Side {
    /// Mean position.
    center: Vec3,
    /// Unit mean normal, towards the side.
    normal: Vec3,
    /// Mean diffuse albedo.
    albedo: Vec3,
    /// Whether triangles show their counter-clockwise side.
    is_front: bool,
    number: u32,
}

impl Side {
    /// A number by which it casts other rays than others. It depends on its cell alone, so that its rays are the same whatever moves
    /// elsewhere. Neighbours have numbers that follow one another.
    pub(in crate::light) fn number(&self) -> u32 {
        self.number
    }
}

/// A point of a triangle.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    triangle: u32,
    /// Weights of its second and third corner.
    weights: [f32; 2],
}

/// The leaf sides of a cell, each with its points.
type CellSides = Vec<(Side, Vec<Point>)>;

/// A part of a triangle in a cell.
#[derive(Debug, Clone, Copy)]
struct Part {
    key: u32,
    triangle: u32,
    area: f32,
}

/// Parts of a cell that face about the same way.
struct Facing {
    /// Sum of the fronts' normals by area.
    sum: Vec3,
    area: f32,
    parts: Vec<Part>,
}

impl Leaves {
    /// Divides visible surfaces. `rays` is the number of points of each leaf side.
    pub(in crate::light) fn new(surfaces: &Surfaces, level: u32, rays: usize) -> Self {
        let mut bounds = Bounds::EMPTY;
        let finite = |triangle: &[DVec3; 3]| triangle.iter().all(|corner| corner.is_finite());
        surfaces.triangles().filter(finite).flatten().for_each(|corner| bounds.extend(corner));
        // The extent is that of all times, so that cells stay where they are whatever moves.
        let extent = surfaces.scene().extent();
        let (center, size, beyond) = match extent.is_empty() || bounds.is_empty() {
            true => (DVec3::ZERO, Vec3::ZERO, 0.0),
            false => {
                let (center, half) = (extent.center(), 0.5 * extent.size().max_element());
                let farthest = (bounds.max - center).max(center - bounds.min).max_element();
                let beyond = (farthest - half).max(0.0);
                // What moves out of the extent and on seldom changes how far cells reach.
                let reach = |half: f64| half * (beyond / half).max(1.0).log2().ceil().exp2();
                let beyond = if half > 0.0 { reach(half) } else { beyond };
                (center, extent.size().as_vec3(), beyond as f32)
            }
        };
        let mut leaves = Self {
            center,
            grid: Grid::around(size, beyond, level),
            table: Table::new(&[]),
            keys: Vec::new(),
            first: Vec::new(),
            sides: Vec::new(),
            points: Vec::new(),
            rays,
            triangles: Vec::new(),
            placed: Vec::new(),
            first_of_instance: Vec::new(),
        };
        leaves.take_triangles(surfaces);
        let mut parts: Vec<Part> = (0..leaves.triangles.len() as u32)
            .into_par_iter()
            .with_min_len(64)
            .fold(Vec::new, |mut parts, triangle| {
                leaves.cut(triangle, &mut parts);
                parts
            })
            .reduce(Vec::new, |mut all, mut parts| {
                all.append(&mut parts);
                all
            });
        // No two parts are of the same triangle and cell.
        parts.par_sort_unstable_by_key(|part| (part.key, part.triangle));
        leaves.divide(surfaces, &parts);
        leaves
    }

    pub(in crate::light) fn center(&self) -> DVec3 {
        self.center
    }

    /// Edge of a cell within the extent: about the width of a leaf side.
    pub(in crate::light) fn width(&self) -> f32 {
        self.grid.inner_size()
    }

    /// The lattice of light cells around the same extent.
    pub(in crate::light) fn lattice(&self) -> Lattice {
        let (low, edge) = self.grid.cube();
        Lattice { low, edge }
    }

    /// Corners of all triangles.
    pub(in crate::light) fn triangles(&self) -> &[[Vec3; 3]] {
        &self.triangles
    }

    /// The visible instances, each with its triangles.
    pub(in crate::light) fn instances(&self) -> impl Iterator<Item = (u32, &[[Vec3; 3]])> {
        let ends = self.placed.iter().skip(1).map(|(first, _)| *first as usize).chain([self.triangles.len()]);
        self.placed
            .iter()
            .zip(ends)
            .map(|(&(first, instance), end)| (instance, &self.triangles[first as usize..end]))
    }

    /// A triangle as a polygon.
    pub(in crate::light) fn polygon(&self, triangle: u32) -> Polygon {
        Polygon::triangle(self.triangles[triangle as usize])
    }

    /// Unit normal of a triangle's counter-clockwise side, and whether views see that side and the other one. `None` for a
    /// triangle without area.
    pub(in crate::light) fn faces(&self, surfaces: &Surfaces, triangle: u32) -> Option<(Vec3, [bool; 2])> {
        let (placement, _) = self.placement(surfaces, triangle)?;
        let seen = match placement.class.cull {
            Cull::None => [true, true],
            Cull::Back => [true, false],
            Cull::MirroredBack => [false, true],
        };
        Some((self.front(triangle)?, seen))
    }

    /// Unit shading normal at a position of a triangle, on the side of a unit normal.
    pub(in crate::light) fn shading_normal(
        &self,
        surfaces: &Surfaces,
        triangle: u32,
        position: Vec3,
        side: Vec3,
    ) -> Option<Vec3> {
        let (placement, primitive) = self.placement(surfaces, triangle)?;
        let weights = weights(self.triangles[triangle as usize], position)?.map(f64::from);
        Some(surfaces.shading_normal(placement, primitive, weights, side.as_dvec3())?.as_vec3())
    }

    fn take_triangles(&mut self, surfaces: &Surfaces) {
        for placement in surfaces.placements() {
            let instance = placement.instance as usize;
            let first = self.triangles.len() as u32;
            self.placed.push((first, placement.instance));
            self.first_of_instance.resize(self.first_of_instance.len().max(instance + 1), u32::MAX);
            self.first_of_instance[instance] = first;
            let mesh = &surfaces.scene().meshes[placement.mesh as usize];
            let about_center = |corner: DVec3| (corner - self.center).as_vec3();
            self.triangles.extend(placement.triangles(mesh).map(|corners| corners.map(about_center)));
        }
    }

    /// Adds the parts of a triangle in all cells.
    fn cut(&self, triangle: u32, parts: &mut Vec<Part>) {
        let corners = self.triangles[triangle as usize];
        if !corners.iter().all(|corner| corner.is_finite()) {
            return;
        }
        let whole = Polygon::triangle(corners);
        let spans = [0, 1, 2].map(|axis| self.grid.span(axis, whole.extent(axis)));
        let is_whole = spans.iter().all(|span| span.start() == span.end());
        let slab = |part: &Polygon, axis: usize, number: i32| match is_whole {
            true => *part,
            false => part.slab(axis, self.grid.bounds(axis, number)),
        };
        for x in spans[0].clone() {
            let of_x = slab(&whole, 0, x);
            for y in self.grid.span(1, of_x.extent(1)) {
                let of_y = slab(&of_x, 1, y);
                for z in self.grid.span(2, of_y.extent(2)) {
                    let area = slab(&of_y, 2, z).area();
                    if let (true, Some(key)) = (area > 0.0, self.grid.key(IVec3::new(x, y, z))) {
                        parts.push(Part { key, triangle, area });
                    }
                }
            }
        }
    }

    /// Makes leaf sides of all parts, sorted by cells.
    fn divide(&mut self, surfaces: &Surfaces, parts: &[Part]) {
        let cells: Vec<&[Part]> = parts.chunk_by(|a, b| a.key == b.key).collect();
        let made: Vec<(u32, CellSides)> = cells
            .par_iter()
            .with_min_len(64)
            .map(|parts| (parts[0].key, self.sides_of(surfaces, parts)))
            .filter(|(_, sides)| !sides.is_empty())
            .collect();
        for (key, sides) in made {
            self.keys.push(key);
            self.first.push(self.sides.len() as u32);
            for (side, points) in sides {
                self.sides.push(side);
                self.points.extend(points);
            }
        }
        self.first.push(self.sides.len() as u32);
        self.table = Table::new(&self.keys);
    }

    /// The leaf sides of a cell, with their points.
    fn sides_of(&self, surfaces: &Surfaces, parts: &[Part]) -> CellSides {
        let mut facings: Vec<Facing> = Vec::new();
        for &part in parts {
            let Some(normal) = self.front(part.triangle) else { continue };
            let cosines = facings.iter().map(|facing| facing.sum.normalize_or_zero().dot(normal));
            let best = cosines.enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b));
            match best {
                // More would be many rays for little surface.
                Some((best, cosine)) if cosine > ALIKE || facings.len() == MOST_FACINGS => {
                    facings[best].add(part, normal);
                }
                _ => facings.push(Facing::new(part, normal)),
            }
        }
        let size = parts.first().map_or(0.0, |part| self.grid.size(Grid::cell(part.key)));
        let least = LEAST_AREA * size * size;
        let usable = facings.iter().filter(|facing| facing.area > least);
        let mut sides: CellSides =
            usable.filter_map(|facing| self.sides_of_facing(surfaces, facing)).flatten().collect();
        let key = parts.first().map_or(0, |part| part.key);
        for (place, (side, _)) in (0u32..).zip(&mut sides) {
            side.number = key.wrapping_add(place.wrapping_mul(0x9e37_79b9));
        }
        sides
    }

    /// Front and back of a facing.
    fn sides_of_facing(&self, surfaces: &Surfaces, facing: &Facing) -> Option<[(Side, Vec<Point>); 2]> {
        let normal = facing.sum.try_normalize()?;
        let points = self.points_of(facing);
        let (mut center, mut albedo) = (Vec3::ZERO, Vec3::ZERO);
        for &point in &points {
            center += self.position(point);
            albedo += self.albedo(surfaces, point);
        }
        let share = 1.0 / points.len() as f32;
        let side = |is_front: bool| Side {
            center: center * share,
            normal: if is_front { normal } else { -normal },
            albedo: albedo * share,
            is_front,
            number: 0,
        };
        Some([(side(true), points.clone()), (side(false), points)])
    }

    /// Points that are spread by area.
    fn points_of(&self, facing: &Facing) -> Vec<Point> {
        let first = facing.parts[0];
        let [low, high] = self.grid.corners(Grid::cell(first.key));
        let shift = hash(first.key ^ first.triangle.rotate_left(16));
        let mut part_of_point = facing.parts.iter();
        let (mut part, mut up_to) = (first, 0.0);
        let mut polygon = None;
        let mut points = Vec::with_capacity(self.rays);
        for ray in 0..self.rays {
            let target = (ray as f32 + 0.5) / self.rays as f32 * facing.area;
            while up_to <= target {
                let Some(next) = part_of_point.next() else { break };
                (part, up_to, polygon) = (*next, up_to + next.area, None);
            }
            let corners = self.triangles[part.triangle as usize];
            let polygon = polygon.get_or_insert_with(|| Polygon::triangle(corners).in_box(low, high));
            let square = (r2(ray as u32 + 1) + shift).fract().as_vec2();
            let weights = polygon.point(square).and_then(|position| weights(corners, position));
            points.push(Point { triangle: part.triangle, weights: weights.unwrap_or([1.0 / 3.0; 2]) });
        }
        points
    }

    /// Unit normal of a triangle's counter-clockwise side.
    fn front(&self, triangle: u32) -> Option<Vec3> {
        let [a, b, c] = self.triangles[triangle as usize];
        (b - a).normalize_or_zero().cross((c - a).normalize_or_zero()).try_normalize()
    }

    fn position(&self, point: Point) -> Vec3 {
        let ([a, b, c], [beta, gamma]) = (self.triangles[point.triangle as usize], point.weights);
        a + (b - a) * beta + (c - a) * gamma
    }

    /// The instance and primitive of a triangle.
    fn placement<'a>(&self, surfaces: &'a Surfaces, triangle: u32) -> Option<(&'a Placement, u32)> {
        let after = self.placed.partition_point(|(first, _)| *first <= triangle);
        let (first, instance) = *self.placed.get(after.checked_sub(1)?)?;
        Some((surfaces.placement(instance)?, triangle - first))
    }

    fn albedo(&self, surfaces: &Surfaces, point: Point) -> Vec3 {
        let weights = point.weights.map(f64::from);
        let found = self.placement(surfaces, point.triangle);
        let found = found.and_then(|(placement, primitive)| {
            surfaces.point(placement, primitive, weights, DVec3::Y).map(|point| point.albedo)
        });
        found.unwrap_or(Vec3::ZERO)
    }

    /// Point number `index` of all leaf sides, as a surface that casts rays.
    pub(in crate::light) fn texel(
        &self,
        surfaces: &Surfaces,
        about: &LightRaysAbout<'_>,
        index: usize,
    ) -> ShadingPoint {
        let point = self.points[index];
        let is_front = self.sides[index / self.rays].is_front;
        let Some(front) = self.front(point.triangle) else { return ShadingPoint::default() };
        let side = if is_front { front } else { -front };
        let normal = self.placement(surfaces, point.triangle).and_then(|(placement, primitive)| {
            surfaces.shading_normal(placement, primitive, point.weights.map(f64::from), side.as_dvec3())
        });
        let position = self.position(point);
        ShadingPoint {
            exists: true,
            position,
            normal: normal.map_or(side, |normal| normal.as_vec3()),
            side,
            start: position + side * (2.0 * about.offset(position, 0.0)),
            is_lifted: false,
            across: 0.0,
        }
    }

    fn sides_in(&self, leaf: u32) -> std::ops::Range<u32> {
        self.first[leaf as usize]..self.first[leaf as usize + 1]
    }

    /// Means of values over each leaf side and those of neighbouring cells in the same plane.
    pub(in crate::light) fn smoothed(&self, values: &[Vec3]) -> Vec<Vec3> {
        let of_cell = |leaf: usize| {
            let cell = Grid::cell(self.keys[leaf]);
            let mut around = [u32::MAX; 27];
            for (number, found) in (0..).zip(&mut around) {
                let there = cell + IVec3::new(number % 3 - 1, number / 3 % 3 - 1, number / 9 - 1);
                let leaf = self.grid.key(there).and_then(|key| self.table.get(key));
                *found = leaf.unwrap_or(u32::MAX);
            }
            let around = around.into_iter().filter(|leaf| *leaf != u32::MAX);
            let most_off = SAME_PLANE * self.grid.size(cell);
            self.sides_in(leaf as u32)
                .map(move |side| self.mean_around(side, most_off, around.clone(), values))
        };
        (0..self.keys.len()).into_par_iter().with_min_len(64).flat_map_iter(of_cell).collect()
    }

    fn mean_around(
        &self,
        side: u32,
        most_off: f32,
        around: impl Iterator<Item = u32>,
        values: &[Vec3],
    ) -> Vec3 {
        let own = &self.sides[side as usize];
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for other in around.flat_map(|leaf| self.sides_in(leaf)) {
            let there = &self.sides[other as usize];
            let off = own.normal.dot(there.center - own.center).abs();
            let alike =
                there.is_front == own.is_front && there.normal.dot(own.normal) > NEIGHBOUR && off < most_off;
            if alike || other == side {
                sum += values[other as usize];
                count += 1.0;
            }
        }
        sum / count
    }

    /// Reflected radiance of leaf sides by their irradiance / π.
    pub(in crate::light) fn reflected(&self, irradiance_over_pi: &[Vec3]) -> Vec<Vec3> {
        self.sides
            .par_iter()
            .zip(irradiance_over_pi)
            .map(|(side, irradiance_over_pi)| side.albedo * *irradiance_over_pi)
            .collect()
    }
}

impl Facing {
    fn new(part: Part, normal: Vec3) -> Self {
        Self { sum: normal * part.area, area: part.area, parts: vec![part] }
    }

    fn add(&mut self, part: Part, normal: Vec3) {
        self.sum += normal * part.area;
        self.area += part.area;
        self.parts.push(part);
    }
}

/// Weights of a triangle's second and third corner at a position in its plane.
fn weights([a, b, c]: [Vec3; 3], position: Vec3) -> Option<[f32; 2]> {
    let [ab, ac, ap] = [b - a, c - a, position - a].map(|edge| edge.as_dvec3());
    let normal = ab.cross(ac);
    let squared = normal.length_squared();
    let [beta, gamma] =
        [ap.cross(ac).dot(normal), ab.cross(ap).dot(normal)].map(|part| (part / squared).clamp(0.0, 1.0));
    let sum = (beta + gamma).max(1.0);
    (beta + gamma).is_finite().then(|| [(beta / sum) as f32, (gamma / sum) as f32])
}

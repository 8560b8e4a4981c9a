//! Writes points into the maps of the reflectors that see them (section 3.5).
//!
//! A texel is written where its ray meets the triangle within the point's cell, at the range there. The paper fills the
//! bounding box of a projected cell with one depth; without the test, a tenth to a third of all texels show something
//! nearer than what they see.

use glam::DVec3;
use rayon::prelude::*;

use super::cells::Point;
use super::facets::{Facet, Openings, Pieces};
use argus_sampler::plug::{FACES, IndexMaps, MappedReflector, face_of, in_face};

/// Texels that the bounds of a cell are widened by, against rounding.
const SLACK: f64 = 1e-6;

/// What is splatted.
pub(super) struct Splats<'a> {
    pub(super) facets: &'a [Facet],
    pub(super) pieces: &'a Pieces,
    /// Stored points, in the order of pieces. Those of other pieces are made while they are splatted.
    pub(super) points: &'a [Point],
    /// First stored point of each piece, and the number of all.
    pub(super) stored: &'a [u32],
    /// First point of each piece, and the number of all.
    pub(super) first: &'a [u32],
    pub(super) reflectors: &'a [MappedReflector],
    pub(super) cut: &'a dyn Openings,
}

impl Splats<'_> {
    /// Splats the points of all pieces from one on. The maps' bytes do not depend on the number of threads.
    pub(super) fn splat_to(&self, maps: &IndexMaps, from: usize) {
        (from..self.pieces.all.len()).into_par_iter().with_max_len(32).for_each(|piece| {
            for map in self.pieces.seen_by(piece) {
                self.piece(piece, map, maps);
            }
        });
    }

    /// Splats the points of all pieces of triangles that parts are cut out of.
    pub(super) fn splat_cutouts(&self, maps: &IndexMaps) {
        (0..self.pieces.all.len()).into_par_iter().with_max_len(32).for_each(|piece| {
            if self.facets[self.pieces.all[piece].facet as usize].cutout {
                self.pieces.seen_by(piece).for_each(|map| self.piece(piece, map, maps));
            }
        });
    }

    fn piece(&self, number: usize, map: usize, maps: &IndexMaps) {
        let piece = &self.pieces.all[number];
        let facet = &self.facets[piece.facet as usize];
        let MappedReflector { center, front, .. } = self.reflectors[map];
        let plane = Plane::new(facet, center);
        let range = self.first[number]..self.first[number + 1];
        let single = range.len() == 1 && !piece.whole_cell;
        let splat = |id: u32, cell: [u16; 2]| {
            let [row, column] = cell.map(f64::from);
            let corner = |x: f64, y: f64| piece.grid.point(glam::DVec2::new(column + x, row + y)) - center;
            let outline = if single {
                // A triangle that is smaller than its cell is bounded more closely by its own corners.
                Outline::new(&piece.corners.map(|corner| corner - center))
            } else {
                Outline::new(&[corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)])
            };
            outline.bounds(maps.side(map), |face, columns, rows| {
                for y in rows.0..=rows.1 {
                    for x in columns.0..=columns.1 {
                        let direction = maps.direction(map, face, x, y);
                        let Some(met) = plane.meet(direction, piece.whole_cell) else { continue };
                        if front.is_some_and(|front| !front.contains(center + met)) {
                            continue;
                        }
                        let place = piece.grid.place(center + met);
                        if place.x.floor() != column || place.y.floor() != row {
                            continue;
                        }
                        if facet.cutout && self.cut.is_open(facet, center + met) {
                            continue;
                        }
                        maps.write(maps.index(map, face, x, y), met.length(), id);
                    }
                }
            });
        };
        match &self.points[self.stored[number] as usize..self.stored[number + 1] as usize] {
            [] => range.zip(piece.cells()).for_each(|(id, cell)| splat(id, cell)),
            points => range.zip(points).for_each(|(id, point)| splat(id, point.cell())),
        }
    }

    /// Those of `others`, ascending, that some reflector sees in a texel which sees nothing yet.
    pub(super) fn fill_holes(&self, others: &Pieces, maps: &IndexMaps) -> Vec<usize> {
        let fills = |piece: &usize| {
            let facet = &self.facets[others.all[*piece].facet as usize];
            others.seen_by(*piece).any(|map| self.fills_a_hole(facet, map, maps))
        };
        (0..others.all.len()).into_par_iter().with_min_len(64).filter(fills).collect()
    }

    fn fills_a_hole(&self, facet: &Facet, map: usize, maps: &IndexMaps) -> bool {
        let MappedReflector { center, front, .. } = self.reflectors[map];
        let mut found = false;
        Outline::new(&facet.corners.map(|corner| corner - center)).bounds(
            maps.side(map),
            |face, columns, rows| {
                for (y, x) in (rows.0..=rows.1).flat_map(|y| (columns.0..=columns.1).map(move |x| (y, x))) {
                    if found || maps.get(maps.index(map, face, x, y)).is_some() {
                        continue;
                    }
                    let met = Plane::new(facet, center).meet(maps.direction(map, face, x, y), false);
                    let seen = |met: &DVec3| {
                        front.is_none_or(|front| front.contains(center + *met))
                            && !(facet.cutout && self.cut.is_open(facet, center + *met))
                    };
                    found = met.as_ref().is_some_and(seen);
                }
            },
        );
        found
    }

    /// Splats whole triangles, as a rasteriser would: ids are those of facets. The bounds of a triangle are those of its
    /// outline, and a texel is written where its ray meets the triangle.
    pub(super) fn rasterise(
        facets: &[Facet],
        reflectors: &[MappedReflector],
        cut: &dyn Openings,
        maps: &IndexMaps,
    ) {
        facets.par_iter().enumerate().with_max_len(64).for_each(|(index, facet)| {
            for (map, reflector) in reflectors.iter().enumerate() {
                let center = reflector.center;
                if reflector.instance == facet.instance || facet.side_towards(center).is_none() {
                    continue;
                }
                let plane = Plane::new(facet, center);
                let outline = Outline::new(&facet.corners.map(|corner| corner - center));
                outline.bounds(maps.side(map), |face, columns, rows| {
                    for y in rows.0..=rows.1 {
                        for x in columns.0..=columns.1 {
                            let Some(met) = plane.meet(maps.direction(map, face, x, y), false) else {
                                continue;
                            };
                            let behind = reflector.front.is_some_and(|front| !front.contains(center + met));
                            if !(behind || facet.cutout && cut.is_open(facet, center + met)) {
                                maps.write(maps.index(map, face, x, y), met.length(), index as u32);
                            }
                        }
                    }
                });
            }
        });
    }
}

/// A triangle about a point, prepared for rays from there.
struct Plane {
    /// Cross products of each corner with the next: their products with a direction are signed volumes, and two triangles
    /// that share an edge find the same volume there, of opposite sign.
    edges: [DVec3; 3],
    /// Product of all three corners.
    volume: f64,
}

impl Plane {
    fn new(facet: &Facet, center: DVec3) -> Self {
        let [a, b, c] = facet.corners.map(|corner| corner - center);
        Self { edges: [a.cross(b), b.cross(c), c.cross(a)], volume: a.dot(b.cross(c)) }
    }

    /// Where a ray meets the triangle, or anywhere in its plane; relative to the ray's origin.
    #[inline]
    fn meet(&self, direction: DVec3, anywhere: bool) -> Option<DVec3> {
        let [u, v, w] = self.edges.map(|edge| edge.dot(direction));
        let one_side = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        if !(one_side || anywhere) {
            return None;
        }
        let t = self.volume / (u + v + w);
        // In the plane, t is not finite.
        (t > 0.0 && t < f64::INFINITY).then(|| direction * t)
    }
}

/// Most corners of an outline that is cut off at a face's four sides.
const MOST_CORNERS: usize = 8;

/// A convex polygon about a point, of at most four corners.
struct Outline {
    corners: [DVec3; 4],
    count: usize,
}

impl Outline {
    fn new(from: &[DVec3]) -> Self {
        let mut corners = [DVec3::ZERO; 4];
        corners[..from.len()].copy_from_slice(from);
        Self { corners, count: from.len() }
    }

    /// Calls `texels` with each face that the outline covers middles of texels of, and their first and last columns and rows.
    fn bounds(&self, side: u32, mut texels: impl FnMut(usize, (u32, u32), (u32, u32))) {
        let corners = &self.corners[..self.count];
        let face = face_of(corners[0]);
        if corners.iter().all(|corner| face_of(*corner) == face) {
            Self::face_bounds(corners, face, side, &mut texels);
            return;
        }
        for face in 0..FACES {
            let (clipped, count) = clipped_to_face(corners, face);
            if count > 0 {
                Self::face_bounds_of(&clipped[..count], face, side, &mut texels);
            }
        }
    }

    fn face_bounds(
        corners: &[DVec3],
        face: usize,
        side: u32,
        texels: &mut impl FnMut(usize, (u32, u32), (u32, u32)),
    ) {
        let mut turned = [DVec3::ZERO; 4];
        turned.iter_mut().zip(corners).for_each(|(turned, corner)| *turned = in_face(face, *corner));
        Self::face_bounds_of(&turned[..corners.len()], face, side, texels);
    }

    fn face_bounds_of(
        corners: &[DVec3],
        face: usize,
        side: u32,
        texels: &mut impl FnMut(usize, (u32, u32), (u32, u32)),
    ) {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in corners.iter().filter(|corner| corner.z > 0.0) {
            for (axis, x) in [corner.x, corner.y].into_iter().enumerate() {
                let at = (x / corner.z + 1.0) * 0.5 * f64::from(side) - 0.5;
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        let last = f64::from(side - 1);
        let first = low.map(|x| (x - SLACK).ceil().max(0.0));
        let end = high.map(|x| (x + SLACK).floor().min(last));
        if first[0] <= end[0] && first[1] <= end[1] {
            let span = |axis: usize| (first[axis] as u32, end[axis] as u32);
            texels(face, span(0), span(1));
        }
    }
}

/// The part of an outline within a face's pyramid, in the face's coordinates (Sutherland and Hodgman, 1974).
fn clipped_to_face(corners: &[DVec3], face: usize) -> ([DVec3; MOST_CORNERS], usize) {
    let mut polygon = [DVec3::ZERO; MOST_CORNERS];
    let mut count = corners.len();
    polygon.iter_mut().zip(corners).for_each(|(turned, corner)| *turned = in_face(face, *corner));
    for side in [
        DVec3::new(1.0, 0.0, 1.0),
        DVec3::new(-1.0, 0.0, 1.0),
        DVec3::new(0.0, 1.0, 1.0),
        DVec3::new(0.0, -1.0, 1.0),
    ] {
        let (from, from_count) = (polygon, count);
        count = 0;
        for i in 0..from_count {
            let (p, q) = (from[i], from[(i + 1) % from_count]);
            let (inside, next) = (p.dot(side), q.dot(side));
            if inside >= 0.0 {
                polygon[count.min(MOST_CORNERS - 1)] = p;
                count += 1;
            }
            if (inside > 0.0 && next < 0.0) || (inside < 0.0 && next > 0.0) {
                polygon[count.min(MOST_CORNERS - 1)] = p + (q - p) * (inside / (inside - next));
                count += 1;
            }
        }
        count = count.min(MOST_CORNERS);
    }
    (polygon, count)
}

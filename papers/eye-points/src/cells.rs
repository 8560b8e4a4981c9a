//! Cells of a triangle: a grid in its plane, and the cells of it that the triangle touches (section 3.3).
//!
//! Generation is conservative: every point of the triangle lies in one of the cells, and every cell touches the triangle.

use std::ops::RangeInclusive;

use glam::{DVec2, DVec3};

/// Rows and columns that a point's 16 bits can say.
pub(super) const MOST_CELLS: f64 = 65_000.0;
/// Distance of the grid's corner from the triangle, cells: a corner of the triangle is not on a border of cells.
const MARGIN: f64 = 1.0 / 1024.0;
/// Cells that are nearer to the triangle than this, in cells, count as touching: rounding moves a texel's point by less.
const SLACK: f64 = 1e-6;

/// A grid of square cells in the plane of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Corner of row 0, column 0, metres, world space.
    pub origin: DVec3,
    /// Unit vector along rows: that of the triangle's first edge.
    pub right: DVec3,
    /// Unit vector from row to row.
    pub up: DVec3,
    /// Cells for each metre.
    pub density: f64,
}

impl Grid {
    /// The grid of a triangle, of `density` cells for each metre or as many as 16 bits can say. `None` for a triangle
    /// without area, one that is not finite, or a density that is not above 0.
    pub fn new([a, b, c]: [DVec3; 3], density: f64) -> Option<Self> {
        // NaN fails.
        if !(density > 0.0) {
            return None;
        }
        let (right, normal) = ((b - a).try_normalize()?, (b - a).cross(c - a).try_normalize()?);
        let up = normal.cross(right).try_normalize()?;
        let along = [0.0, (b - a).dot(right), (c - a).dot(right)];
        let least = along.into_iter().fold(f64::INFINITY, f64::min);
        let most = along.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let extent = (most - least).max((c - a).dot(up));
        let density = density.min(MOST_CELLS / extent);
        let margin = MARGIN / density;
        let origin = a + right * (least - margin) - up * margin;
        (density > 0.0 && density.is_finite() && origin.is_finite()).then_some(Self {
            origin,
            right,
            up,
            density,
        })
    }

    /// A grid whose cell at row 0 and column 0 has its middle at the triangle's, for a triangle that is much smaller than
    /// a cell. `None` as in [`Self::new`].
    pub fn around_middle(corners: [DVec3; 3], density: f64) -> Option<Self> {
        let grid = Self::new(corners, density)?;
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        Some(Self { origin: middle - (grid.right + grid.up) * (0.5 / grid.density), ..grid })
    }

    /// Column and row of a point of the plane, with fractions.
    pub fn place(&self, point: DVec3) -> DVec2 {
        let from_origin = point - self.origin;
        DVec2::new(from_origin.dot(self.right), from_origin.dot(self.up)) * self.density
    }

    /// The point of the plane at a column and a row, metres, world space.
    pub fn point(&self, place: DVec2) -> DVec3 {
        self.origin + (self.right * place.x + self.up * place.y) / self.density
    }

    /// The rows of cells that a triangle of this grid touches.
    pub fn rows(&self, corners: [DVec3; 3]) -> Rows {
        let places = corners.map(|corner| self.place(corner));
        let top = places[0].y.max(places[1].y).max(places[2].y);
        Rows { places, count: (top + SLACK).floor().max(0.0) as u32 + 1 }
    }
}

/// The cells that a triangle touches, row by row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rows {
    /// Column and row of each corner.
    pub(super) places: [DVec2; 3],
    /// Number of rows, from 0.
    pub count: u32,
}

impl Rows {
    /// The columns of a row.
    pub fn columns(&self, row: u32) -> RangeInclusive<u32> {
        let (low, high) = (f64::from(row) - SLACK, f64::from(row) + 1.0 + SLACK);
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (p, q) = (self.places[from], self.places[to]);
            if p.y.max(q.y) < low || p.y.min(q.y) > high {
                continue;
            }
            // The ends of the part of the edge within the row.
            for end in [p, q] {
                let held = end.y.clamp(low, high);
                let x = if held == end.y { end.x } else { p.x + (q.x - p.x) * ((held - p.y) / (q.y - p.y)) };
                least = least.min(x);
                most = most.max(x);
            }
        }
        if !(least <= most) {
            // Only rounding leaves a row empty.
            return RangeInclusive::new(1, 0);
        }
        let column = |x: f64| x.floor().clamp(0.0, MOST_CELLS) as u32;
        column(least - SLACK)..=column(most + SLACK)
    }

    /// Most cells that the rows may have, without looking at each.
    pub(super) fn most_cells(&self) -> u64 {
        let right = self.places[0].x.max(self.places[1].x).max(self.places[2].x);
        (u64::from(self.count) + 1) * (right.max(0.0) as u64 + 2)
    }

    /// Number of cells in all rows.
    pub fn cells(&self) -> u64 {
        (0..self.count)
            .map(|row| self.columns(row))
            .map(|c| u64::from((c.end() + 1).saturating_sub(*c.start())))
            .sum()
    }
}

/// A point: a cell of a piece of a triangle, in 8 bytes. The paper's take 80 (section 4.2.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Point(pub u64);

impl Point {
    /// The point of a piece, row and column.
    pub fn new(piece: u32, row: u16, column: u16) -> Self {
        Self(u64::from(piece) << 32 | u64::from(row) << 16 | u64::from(column))
    }

    /// Index of its piece.
    pub fn piece(self) -> u32 {
        (self.0 >> 32) as u32
    }

    /// Row and column.
    pub fn cell(self) -> [u16; 2] {
        [(self.0 >> 16) as u16, self.0 as u16]
    }

    /// Column and row of its middle.
    pub fn middle(self) -> DVec2 {
        let [row, column] = self.cell();
        DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of all shapes, some far from the origin, with densities.
    fn triangles() -> Vec<([DVec3; 3], f64)> {
        let mut seed = 7u32;
        let mut unit = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        let mut found = Vec::new();
        for number in 0..120 {
            let mut place = || DVec3::new(unit(), unit(), unit());
            let far = if number % 3 == 0 { DVec3::splat(1e6) } else { DVec3::ZERO };
            let (a, edge) = (place(), place());
            // Thin ones, too.
            let b = if number % 4 == 0 { a + edge } else { place() };
            let c = if number % 4 == 0 { a + edge * 0.5 + place() * 1e-3 } else { place() };
            found.push(([a + far, b + far, c + far], 0.3 * 4f64.powi(number % 5)));
        }
        found
    }

    #[test]
    fn every_point_of_a_triangle_lies_in_a_cell() {
        for (corners, density) in triangles() {
            let grid = Grid::new(corners, density).unwrap();
            let rows = grid.rows(corners);
            let [a, b, c] = corners;
            for i in 0..=60 {
                for j in 0..=60 - i {
                    let (u, v) = (f64::from(i) / 60.0, f64::from(j) / 60.0);
                    let place = grid.place(a + (b - a) * u + (c - a) * v);
                    assert!(place.min_element() >= 0.0, "{place}");
                    let (column, row) = (place.x as u32, place.y as u32);
                    assert!(row < rows.count && rows.columns(row).contains(&column), "{corners:?} {place}");
                }
            }
        }
    }

    /// Whether a cell touches a triangle, by separating axes in the plane.
    fn touches(places: [DVec2; 3], row: u32, column: u32) -> bool {
        let low = DVec2::new(f64::from(column), f64::from(row));
        let cell = [low, low + DVec2::X, low + DVec2::Y, low + DVec2::ONE];
        let edges = [places[1] - places[0], places[2] - places[1], places[0] - places[2]];
        let axes = edges.iter().map(|edge| edge.perp()).chain([DVec2::X, DVec2::Y]);
        axes.into_iter().all(|axis| {
            let range = |points: &[DVec2]| {
                let along = points.iter().map(|point| point.dot(axis));
                along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
            };
            let ((a, b), (c, d)) = (range(&places), range(&cell));
            let slack = 1e-4 * axis.length();
            a <= d + slack && c <= b + slack
        })
    }

    #[test]
    fn cells_are_those_that_touch_the_triangle_and_no_others() {
        for (corners, density) in triangles() {
            let grid = Grid::new(corners, density).unwrap();
            let rows = grid.rows(corners);
            let mut count = 0;
            for row in 0..rows.count {
                for column in rows.columns(row) {
                    assert!(touches(rows.places, row, column), "{corners:?} row {row}, column {column}");
                    count += 1;
                }
            }
            assert_eq!(rows.cells(), count);
            let area =
                density * density * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() / 2.0;
            assert!(count as f64 >= area, "the cells cover the triangle");
        }
    }

    #[test]
    fn a_point_survives_its_eight_bytes_within_half_a_cell() {
        assert_eq!(size_of::<Point>(), 8);
        for (corners, density) in triangles() {
            let grid = Grid::new(corners, density).unwrap();
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let place = grid.place(middle);
            let point = Point::new(u32::MAX, place.y as u16, place.x as u16);
            assert_eq!(point.piece(), u32::MAX);
            let decoded = grid.point(point.middle());
            assert!((decoded - middle).length() <= 0.5f64.sqrt() / grid.density + 1e-9);
        }
        let last = Point::new(5, u16::MAX, u16::MAX - 1);
        assert_eq!((last.piece(), last.cell()), (5, [u16::MAX, u16::MAX - 1]));
    }

    #[test]
    fn too_many_cells_lower_the_density_instead_of_overflowing() {
        let corners = [DVec3::ZERO, DVec3::X * 1e4, DVec3::Y * 1e4];
        let grid = Grid::new(corners, 1e6).unwrap();
        let rows = grid.rows(corners);
        assert!(grid.density < 7.0 && rows.count <= 65_536);
        assert!(*rows.columns(0).end() <= u32::from(u16::MAX));
    }

    #[test]
    fn a_triangle_without_area_has_no_grid() {
        let p = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(Grid::new([p; 3], 1.0), None);
        assert_eq!(Grid::new([p, p + DVec3::X, p + DVec3::X * 2.0], 1.0), None);
        assert_eq!(Grid::new([p, p + DVec3::X, p + DVec3::NAN], 1.0), None);
        assert_eq!(Grid::new([p, p + DVec3::X, p + DVec3::Y], 0.0), None);
        assert_eq!(Grid::new([p, p + DVec3::X, p + DVec3::Y], f64::NAN), None);
    }
}

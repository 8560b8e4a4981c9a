//! Convex polygons: parts of triangles in cells.

use glam::{Vec2, Vec3};

/// Corners of a triangle that is clipped by the six planes of a cell, at most.
const MOST: usize = 10;

/// A convex polygon in a plane.
#[derive(Debug, Clone, Copy)]
pub(in crate::light) struct Polygon {
    corners: [Vec3; MOST],
    count: usize,
}

impl Polygon {
    pub(in crate::light) fn triangle(corners: [Vec3; 3]) -> Self {
        let mut all = [Vec3::ZERO; MOST];
        all[..3].copy_from_slice(&corners);
        Self { corners: all, count: 3 }
    }

    fn corners(&self) -> &[Vec3] {
        &self.corners[..self.count]
    }

    /// The part with coordinates of at least (`above`) or at most `bound` along an axis.
    fn clipped(&self, axis: usize, bound: f32, above: bool) -> Self {
        let inside = |corner: Vec3| if above { corner[axis] >= bound } else { corner[axis] <= bound };
        let mut part = Self { corners: [Vec3::ZERO; MOST], count: 0 };
        let mut add = |corner: Vec3| {
            if part.count < MOST {
                part.corners[part.count] = corner;
                part.count += 1;
            }
        };
        for (index, &from) in self.corners().iter().enumerate() {
            let to = self.corners[(index + 1) % self.count];
            if inside(from) {
                add(from);
            }
            if inside(from) != inside(to) {
                let mut crossing = from.lerp(to, (bound - from[axis]) / (to[axis] - from[axis]));
                crossing[axis] = bound;
                add(crossing);
            }
        }
        part
    }

    /// The part between two bounds along an axis.
    pub(in crate::light) fn slab(&self, axis: usize, [low, high]: [f32; 2]) -> Self {
        self.clipped(axis, low, true).clipped(axis, high, false)
    }

    /// The part in a box.
    pub(in crate::light) fn in_box(&self, low: Vec3, high: Vec3) -> Self {
        (0..3).fold(*self, |part, axis| part.slab(axis, [low[axis], high[axis]]))
    }

    /// Least and greatest coordinate along an axis.
    pub(in crate::light) fn extent(&self, axis: usize) -> [f32; 2] {
        let bounds = |[low, high]: [f32; 2], corner: &Vec3| [low.min(corner[axis]), high.max(corner[axis])];
        self.corners().iter().fold([f32::INFINITY, f32::NEG_INFINITY], bounds)
    }

    /// Triangles about the first corner, with twice their areas.
    fn fan(&self) -> impl Iterator<Item = ([Vec3; 3], f32)> + '_ {
        (2..self.count).map(|last| {
            let [a, b, c] = [self.corners[0], self.corners[last - 1], self.corners[last]];
            ([a, b, c], (b - a).cross(c - a).length())
        })
    }

    /// Square metres.
    pub(in crate::light) fn area(&self) -> f32 {
        self.fan().map(|(_, twice)| twice).sum::<f32>() * 0.5
    }

    /// The mean of its points by area; of its corners for a polygon without area.
    pub(in crate::light) fn center(&self) -> Vec3 {
        let (mut sum, mut area) = (Vec3::ZERO, 0.0);
        for ([a, b, c], twice) in self.fan() {
            sum += (a + b + c) * (twice / 3.0);
            area += twice;
        }
        let mean = sum / area;
        if mean.is_finite() { mean } else { self.corners().iter().sum::<Vec3>() / self.count.max(1) as f32 }
    }

    /// A point by two numbers in 0..1, uniform over the area. `None` for a polygon without area.
    pub(in crate::light) fn point(&self, square: Vec2) -> Option<Vec3> {
        let whole: f32 = self.fan().map(|(_, twice)| twice).sum();
        let mut left = square.x * whole;
        let mut found = None;
        for ([a, b, c], twice) in self.fan() {
            if twice > 0.0 {
                // Square root: uniform over the area (Turk, "Generating Random Points in Triangles", 1990).
                let root = (left / twice).clamp(0.0, 1.0).sqrt();
                found = Some(a + (b - a) * (root * (1.0 - square.y)) + (c - a) * (root * square.y));
                if left < twice {
                    break;
                }
                left -= twice;
            }
        }
        found.filter(|point| point.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_of_a_triangle_have_its_area_together_and_hold_their_points() {
        let triangle =
            Polygon::triangle([Vec3::new(0.1, 0.2, 0.3), Vec3::new(7.3, 1.0, 4.0), Vec3::new(2.0, 9.1, 1.0)]);
        let mut sum = 0.0;
        for x in 0..8 {
            for y in 0..10 {
                for z in 0..5 {
                    let low = Vec3::new(x as f32, y as f32, z as f32);
                    let part = triangle.in_box(low, low + 1.0);
                    sum += part.area();
                    for i in 0..8 {
                        let square = argus_scene::light_sampling::r2(i).as_vec2();
                        let Some(point) = part.point(square) else { continue };
                        assert!((point - low).min_element() > -1e-4, "{point} {low}");
                        assert!((point - low).max_element() < 1.0001, "{point} {low}");
                    }
                }
            }
        }
        assert!((sum / triangle.area() - 1.0).abs() < 1e-4, "{sum} {}", triangle.area());
        assert!(Polygon::triangle([Vec3::ONE; 3]).point(Vec2::splat(0.5)).is_none());
    }
}

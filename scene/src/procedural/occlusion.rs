//! Visibility of the sky from the ground and the tree, baked into their vertex colours.
//!
//! The shading model has no shadows, and a crown without them is a flat disc of one green. The baked factor is part of
//! the scene's colours and depends on no light.

use glam::{DVec2, DVec3, IVec3};

use super::ground;

/// Cells along the longest edge of the crown's box.
const CROWN_CELLS: f64 = 40.0;
/// Samples along an edge of the ground's map.
const GROUND_CELLS: usize = 160;

/// Nine directions over the upper hemisphere, unit, with their cosine weights (sum 1).
const SKY: [(DVec3, f64); 9] = {
    const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
    const LOW: (f64, f64) = (0.612_372_435_695_794_5, 0.5); // 60° from the zenith, at 45° in x and z
    [
        (DVec3::Y, 0.20),
        (DVec3::new(DIAGONAL, DIAGONAL, 0.0), 0.12),
        (DVec3::new(-DIAGONAL, DIAGONAL, 0.0), 0.12),
        (DVec3::new(0.0, DIAGONAL, DIAGONAL), 0.12),
        (DVec3::new(0.0, DIAGONAL, -DIAGONAL), 0.12),
        (DVec3::new(LOW.0, LOW.1, LOW.0), 0.08),
        (DVec3::new(LOW.0, LOW.1, -LOW.0), 0.08),
        (DVec3::new(-LOW.0, LOW.1, LOW.0), 0.08),
        (DVec3::new(-LOW.0, LOW.1, -LOW.0), 0.08),
    ]
};

/// Leaf area density of the crown on a grid.
#[derive(Debug)]
pub(super) struct Crown {
    min: DVec3,
    cell: f64,
    size: IVec3,
    /// Square metres of leaf per cubic metre, halved: the mean projection of randomly turned leaves.
    extinction: Vec<f64>,
    /// Share of the sky's light that reaches the middle of each cell.
    visible: Vec<f64>,
}

impl Crown {
    /// A crown of leaves with these middles, each of `leaf_area` square metres.
    pub(super) fn new(leaves: &[DVec3], leaf_area: f64) -> Self {
        let (mut min, mut max) = (DVec3::splat(f64::MAX), DVec3::splat(f64::MIN));
        for leaf in leaves {
            min = min.min(*leaf);
            max = max.max(*leaf);
        }
        let cell = ((max - min).max_element() / CROWN_CELLS).max(0.1);
        let size = ((max - min) / cell).ceil().as_ivec3() + 1;
        let extinction = vec![0.0; (size.x * size.y * size.z) as usize];
        let mut crown = Self { min, cell, size, extinction, visible: Vec::new() };
        for leaf in leaves {
            if let Some(i) = crown.index(((*leaf - min) / cell).floor().as_ivec3()) {
                crown.extinction[i] += 0.5 * leaf_area / (cell * cell * cell);
            }
        }
        let middle = |i: i32| {
            let c = IVec3::new(i % size.x, i / size.x % size.y, i / (size.x * size.y));
            min + (c.as_dvec3() + 0.5) * cell
        };
        crown.visible = (0..size.x * size.y * size.z).map(|i| crown.survey(middle(i))).collect();
        crown
    }

    fn index(&self, c: IVec3) -> Option<usize> {
        let inside = c.cmpge(IVec3::ZERO).all() && c.cmplt(self.size).all();
        inside.then(|| ((c.z * self.size.y + c.y) * self.size.x + c.x) as usize)
    }

    /// Share of the sky's light that reaches a point within the crown: trilinear between cells.
    pub(super) fn sky_visibility(&self, at: DVec3) -> f64 {
        let last = (self.size - 1).as_dvec3();
        let c = ((at - self.min) / self.cell - 0.5).clamp(DVec3::ZERO, last);
        let base = c.floor().min(last - 1.0).max(DVec3::ZERO);
        let f = c - base;
        let mut sum = 0.0;
        for corner in 0..8 {
            let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let weight = DVec3::select(step.cmpeq(IVec3::ONE), f, 1.0 - f);
            if let Some(i) = self.index(base.as_ivec3() + step) {
                sum += weight.x * weight.y * weight.z * self.visible[i];
            }
        }
        sum
    }

    /// Share of the sky's light that reaches any point `from` through the leaves.
    pub(super) fn survey(&self, from: DVec3) -> f64 {
        SKY.iter().map(|&(direction, weight)| weight * self.transmittance(from, direction)).sum()
    }

    fn transmittance(&self, from: DVec3, direction: DVec3) -> f64 {
        let max = self.min + self.size.as_dvec3() * self.cell;
        // The part of the ray within the grid. Nudged, so that no axis divides zero by zero.
        let nudged = direction + 1e-9;
        let (a, b) = ((self.min - from) / nudged, (max - from) / nudged);
        let enter = a.min(b).max_element().max(0.5 * self.cell);
        let leave = a.max(b).min_element();
        let mut depth = 0.0;
        let mut t = enter;
        while t < leave {
            let c = ((from + direction * t - self.min) / self.cell).floor().as_ivec3();
            depth += self.index(c).map_or(0.0, |i| self.extinction[i]) * self.cell;
            t += self.cell;
        }
        // Beer–Lambert, with the reciprocal of the exponential's series: the library's exponential differs between
        // platforms.
        1.0 / (1.0 + depth + 0.5 * depth * depth)
    }
}

/// Visibility of the sky from the ground, past the mountains and the crown.
#[derive(Debug)]
pub(super) struct GroundOcclusion {
    visible: Vec<f64>,
}

impl GroundOcclusion {
    /// Surveys the height field under a crown.
    pub(super) fn new(crown: &Crown) -> Self {
        let row = GROUND_CELLS + 1;
        let at = |i: usize, j: usize| {
            DVec2::new(i as f64, j as f64) * (2.0 * ground::HALF / GROUND_CELLS as f64) - ground::HALF
        };
        let mut heights = Vec::with_capacity(row * row);
        for j in 0..row {
            heights.extend((0..row).map(|i| ground::height(at(i, j))));
        }
        let mut visible = Vec::with_capacity(row * row);
        for j in 0..row {
            for i in 0..row {
                let (p, y) = (at(i, j), heights[j * row + i]);
                let shade = crown.survey(DVec3::new(p.x, y + 0.3, p.y));
                // Squared: light that passes the leaves is green and low.
                visible.push(horizon(&heights, i, j) * shade * shade);
            }
        }
        Self { visible }
    }

    /// At (x, z), bilinear.
    pub(super) fn at(&self, p: DVec2) -> f64 {
        let limit = GROUND_CELLS as f64;
        let c = ((p + ground::HALF) * (limit / (2.0 * ground::HALF))).clamp(DVec2::ZERO, DVec2::splat(limit));
        let base = c.floor().min(DVec2::splat(limit - 1.0));
        let f = c - base;
        let (i, j) = (base.x as usize, base.y as usize);
        let v = |di: usize, dj: usize| self.visible[(j + dj) * (GROUND_CELLS + 1) + i + di];
        let top = v(0, 0) + (v(1, 0) - v(0, 0)) * f.x;
        let bottom = v(0, 1) + (v(1, 1) - v(0, 1)) * f.x;
        top + (bottom - top) * f.y
    }
}

/// Mean share of the sky above the horizon in eight directions around a sample; 1 on a plain.
fn horizon(heights: &[f64], i: usize, j: usize) -> f64 {
    let row = GROUND_CELLS + 1;
    let cell = 2.0 * ground::HALF / GROUND_CELLS as f64;
    let here = heights[j * row + i];
    let mut open = 0.0;
    for (dx, dz, length) in [
        (1, 0, 1.0),
        (1, 1, std::f64::consts::SQRT_2),
        (0, 1, 1.0),
        (-1, 1, std::f64::consts::SQRT_2),
        (-1, 0, 1.0),
        (-1, -1, std::f64::consts::SQRT_2),
        (0, -1, 1.0),
        (1, -1, std::f64::consts::SQRT_2),
    ] {
        let mut slope: f64 = 0.0;
        for distance in [1, 2, 4, 7, 11] {
            let (x, z) = (i as i64 + dx * distance, j as i64 + dz * distance);
            if (0..row as i64).contains(&x) && (0..row as i64).contains(&z) {
                let rise = heights[z as usize * row + x as usize] - here;
                slope = slope.max(rise / (distance as f64 * length * cell));
            }
        }
        // Cosine-weighted: 1 − sin² of the horizon's elevation.
        open += 1.0 / (1.0 + slope * slope) / 8.0;
    }
    open
}

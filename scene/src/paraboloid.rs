//! Dual paraboloid maps: conversion between directions and texels. `papers/megaviews/shaders/shared/paraboloid.wgsl` is the same on the
//! GPU.
//!
//! Each hemisphere, about +x and −x of the world's axes, is projected stereographically onto a square of `side` by
//! `side` texels. The projection keeps circles circular: a ball whose angular radius is β, at the angle α from the
//! axis, covers side·sin β / (cos α + cos β) texels in every direction (MegaViews, section 3.2.2). Both hemispheres
//! have the same (y, z) along their common rim. Texels outside a square's inscribed circle have no direction: theirs
//! belong to the other hemisphere.
//!
//! A map is an array of 2·side² texels: the hemisphere about +x, then the one about −x, each row by row.

use glam::{DVec2, DVec3};

/// A position in a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParaboloidPosition {
    /// 0 about +x, 1 about −x.
    pub hemisphere: u32,
    /// Texels; centres lie at half integers.
    pub at: DVec2,
}

impl ParaboloidPosition {
    /// The position of a direction, of any length but 0, in a map of `side` texels.
    pub fn of(direction: DVec3, side: u32) -> Self {
        let d = direction / direction.abs().max_element().max(f64::MIN_POSITIVE);
        let p = DVec2::new(d.y, d.z) / (d.length() + d.x.abs()).max(f64::MIN_POSITIVE);
        Self { hemisphere: u32::from(d.x < 0.0), at: (p * 0.5 + 0.5) * f64::from(side) }
    }

    /// The unit direction of this position.
    pub fn direction(self, side: u32) -> DVec3 {
        let p = self.at / f64::from(side) * 2.0 - 1.0;
        let s = p.length_squared();
        let x = (1.0 - s) / (1.0 + s);
        let yz = p * (2.0 / (1.0 + s));
        DVec3::new(if self.hemisphere == 1 { -x } else { x }, yz.x, yz.y)
    }
}

/// Index of a direction's texel in a map of `side` texels.
pub fn texel_of(direction: DVec3, side: u32) -> u32 {
    let position = ParaboloidPosition::of(direction, side);
    let cell = position.at.clamp(DVec2::ZERO, DVec2::splat(f64::from(side) - 0.5)).as_uvec2();
    (position.hemisphere * side + cell.y) * side + cell.x
}

/// The unit direction of a texel's centre.
pub fn center_of(texel: u32, side: u32) -> DVec3 {
    let (row, column) = (texel / side, texel % side);
    let at = DVec2::new(f64::from(column) + 0.5, f64::from(row % side) + 0.5);
    ParaboloidPosition { hemisphere: row / side, at }.direction(side)
}

/// Whether a texel holds any direction: true inside the circle inscribed in its square.
pub fn is_inside(texel: u32, side: u32) -> bool {
    let center = f64::from(side) * 0.5;
    let nearest = |i: u32| {
        let low = f64::from(i);
        (center - center.clamp(low, low + 1.0)).abs()
    };
    DVec2::new(nearest(texel % side), nearest(texel / side % side)).length() < center
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIRECTIONS: [DVec3; 8] = [
        DVec3::X,
        DVec3::NEG_X,
        DVec3::Y,
        DVec3::NEG_Z,
        DVec3::new(1.0, 2.0, -3.0),
        DVec3::new(-1e-9, 1.0, 1.0),
        DVec3::new(1e-9, 1.0, 1.0),
        DVec3::new(-0.3, -0.2, 0.9),
    ];

    #[test]
    fn directions_survive_the_map_whatever_their_length() {
        for d in DIRECTIONS {
            for length in [1e-150, 1.0, 1e150] {
                let back = ParaboloidPosition::of(d * length, 16).direction(16);
                assert!((back - d.normalize()).length() < 1e-12, "{d} {back}");
            }
        }
    }

    #[test]
    fn every_texel_inside_the_circle_has_its_own_centre() {
        for side in [1, 2, 16, 33] {
            let mut seen = 0;
            for texel in 0..2 * side * side {
                let center = center_of(texel, side);
                assert!((center.length() - 1.0).abs() < 1e-12);
                // A centre beyond the rim is a direction of the other hemisphere.
                if (center.x < 0.0) == (texel >= side * side) {
                    assert_eq!(texel_of(center, side), texel);
                    assert!(is_inside(texel, side));
                    seen += 1;
                }
            }
            assert!(f64::from(seen) > 0.7 * f64::from(2 * side * side), "{side}: {seen}");
        }
    }

    #[test]
    fn the_rim_belongs_to_both_hemispheres_at_the_same_place() {
        let [left, right] = [-1e-12, 1e-12].map(|x| ParaboloidPosition::of(DVec3::new(x, 0.6, 0.8), 64));
        assert_ne!(left.hemisphere, right.hemisphere);
        assert!((left.at - right.at).length() < 1e-9);
    }

    #[test]
    fn a_ball_covers_as_many_texels_as_the_formula_says_everywhere() {
        let (side, beta): (u32, f64) = (64, 0.2);
        for alpha in [0.0f64, 0.4, 0.9, 1.3] {
            let axis = DVec3::new(alpha.cos(), alpha.sin() * 0.6, alpha.sin() * 0.8);
            let across = axis.any_orthonormal_vector();
            for turn in 0..4 {
                let side_of = glam::DQuat::from_axis_angle(axis, f64::from(turn)) * across;
                let ends = [-beta, beta].map(|angle| axis * angle.cos() + side_of * angle.sin());
                if ends.iter().any(|end| end.x < 0.0) {
                    continue;
                }
                // The image of a circle is a circle; antipodal points of the ball lie on it, but only those along the
                // line through the map's middle span its diameter.
                let [a, b] = ends.map(|end| ParaboloidPosition::of(end, side).at);
                let diameter = f64::from(side) * beta.sin() / (alpha.cos() + beta.cos());
                assert!(a.distance(b) <= diameter * (1.0 + 1e-9), "{alpha} {turn}");
            }
            let radial = DVec3::new(-alpha.sin(), alpha.cos() * 0.6, alpha.cos() * 0.8);
            let ends = [-beta, beta].map(|angle| axis * angle.cos() + radial * angle.sin());
            if ends.iter().all(|end| end.x > 0.0) {
                let [a, b] = ends.map(|end| ParaboloidPosition::of(end, side).at);
                let diameter = f64::from(side) * beta.sin() / (alpha.cos() + beta.cos());
                assert!((a.distance(b) - diameter).abs() < 1e-9 * diameter, "{alpha}");
            }
        }
    }
}

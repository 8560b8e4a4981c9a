//! Cameras around one tile: the paper's four above its corners, and denser ones on the hemisphere through those.

use glam::DVec3;

use super::lattice::MAX_LEVEL;
use crate::{Bounds, Camera};

/// Refined cameras of one tile: level l has 4·2ˡ azimuths and 2ˡ elevations.
pub(super) const REFINED: u64 = {
    let (mut sum, mut level) = (0, 1);
    while level <= MAX_LEVEL {
        sum += azimuths(level) * elevations(level);
        level += 1;
    }
    sum
};

/// Elevations keep this distance from the horizon, where a camera sees the tile's edge, and from the zenith, where all
/// azimuths coincide.
const MARGIN_DEG: f64 = 5.0;

const fn azimuths(level: u32) -> u64 {
    4 << level
}

const fn elevations(level: u32) -> u64 {
    1 << level
}

/// The level of a slot.
pub(super) fn level_of(slot: u64) -> u32 {
    let mut end = 0;
    let mut levels = 1..=MAX_LEVEL;
    levels
        .find(|&level| {
            end += azimuths(level) * elevations(level);
            slot < end
        })
        .unwrap_or(MAX_LEVEL)
}

/// A tile: its box with the scene's full height, and the height of its corner cameras above that.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    pub(super) bounds: Bounds,
    pub(super) above: f64,
}

impl Tile {
    /// Position of the camera above one corner.
    pub(super) fn corner(&self, corner: u64) -> DVec3 {
        let Bounds { min, max } = self.bounds;
        let x = if corner & 1 == 0 { min.x } else { max.x };
        let z = if corner & 2 == 0 { min.z } else { max.z };
        DVec3::new(x, max.y + self.above, z)
    }

    /// Position of a refined camera, at the corner cameras' distance from the tile's centre.
    pub(super) fn refined(&self, slot: u64) -> Option<DVec3> {
        let mut rest = slot;
        for level in 1..=MAX_LEVEL {
            let (around, up) = (azimuths(level), elevations(level));
            if rest < around * up {
                let azimuth = std::f64::consts::TAU * (rest % around) as f64 / around as f64;
                let share = ((rest / around) as f64 + 0.5) / up as f64;
                let elevation = (MARGIN_DEG + (90.0 - 2.0 * MARGIN_DEG) * share).to_radians();
                let (level_part, height) = (elevation.cos(), elevation.sin());
                let direction = DVec3::new(level_part * azimuth.cos(), height, level_part * azimuth.sin());
                return Some(self.bounds.center() + direction * self.radius());
            }
            rest -= around * up;
        }
        None
    }

    /// The slot of a level nearest to an eye's direction, seen from the tile's centre.
    pub(super) fn nearest_slot(&self, eye: DVec3, level: u32) -> u64 {
        let direction = (eye - self.bounds.center()).normalize_or(DVec3::Y);
        let (around, up) = (azimuths(level), elevations(level));
        let turn = direction.z.atan2(direction.x) / std::f64::consts::TAU;
        let azimuth = (turn.rem_euclid(1.0) * around as f64).round() as u64 % around;
        let elevation_deg = direction.y.clamp(-1.0, 1.0).asin().to_degrees();
        let share = (elevation_deg - MARGIN_DEG) / (90.0 - 2.0 * MARGIN_DEG);
        let row = ((share * up as f64).max(0.0) as u64).min(up - 1);
        (1..level).map(|l| azimuths(l) * elevations(l)).sum::<u64>() + row * around + azimuth
    }

    fn radius(&self) -> f64 {
        (self.corner(0) - self.bounds.center()).length()
    }

    /// The smallest vertical field of view, degrees, that shows the whole box in an image of `width` × `height`
    /// pixels; at most 150°, for cameras that are too close.
    pub(super) fn fov_around(&self, camera: &Camera, width: u32, height: u32) -> f64 {
        let view_from_world = camera.view_from_world();
        let aspect = f64::from(width) / f64::from(height);
        let mut tangent: f64 = 1e-3;
        for i in 0..8 {
            let pick = |bit: i32, min: f64, max: f64| if i & bit == 0 { min } else { max };
            let corner = DVec3::new(
                pick(1, self.bounds.min.x, self.bounds.max.x),
                pick(2, self.bounds.min.y, self.bounds.max.y),
                pick(4, self.bounds.min.z, self.bounds.max.z),
            );
            let p = view_from_world * (corner - camera.eye);
            let depth = (-p.z).max(1e-9);
            tangent = tangent.max((p.y / depth).abs()).max((p.x / depth).abs() / aspect);
        }
        // A margin of 1%, so that the border's texels are inside the image.
        (2.0 * (tangent * 1.01).atan()).to_degrees().min(150.0)
    }
}

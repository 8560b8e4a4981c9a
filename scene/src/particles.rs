//! Glowing particles: many small moving lights (MegaViews, section 5.2).

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use crate::Bounds;

/// A point light that shines equally in all directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// World space, metres.
    pub position: DVec3,
    /// Total emitted power, watts.
    pub flux: Vec3,
}

/// Share of the bounds, around their middle, that holds all particles.
const WITHIN: f64 = 0.9;
/// A particle's largest drift to each side: a share of the bounds' extent along that axis.
const DRIFT: f64 = 0.08;
/// Period of the slowest drift, seconds.
const SLOWEST_SECS: f64 = 12.0;

/// The particles at a time in seconds: a pure function, the same in every process. They are spread evenly through the
/// bounds, and each drifts about its own position. Their total power in watts is the square of the bounds' diagonal
/// in metres, so a scene's brightness depends little on its size and on their number.
pub fn glowing(bounds: &Bounds, count: u32, seed: u32, time_secs: f64) -> Vec<Particle> {
    let (middle, size) = (bounds.center(), bounds.size());
    let each = (size.length_squared() / f64::from(count.max(1))) as f32;
    let particle = |index: u32| {
        let number = |k: u32| unit(u64::from(seed) << 40 ^ u64::from(index) << 4 ^ u64::from(k));
        // The R3 sequence (Roberts 2018): 1/g, 1/g², 1/g³ of g⁴ = g + 1.
        let spread = |step: f64, k: u32| {
            (unit(u64::from(seed) << 8 | u64::from(k)) + f64::from(index) * step).fract() - 0.5
        };
        let place = DVec3::new(
            spread(0.819_172_513_396_164_4, 1),
            spread(0.671_043_606_703_789_3, 2),
            spread(0.549_700_477_901_960_3, 3),
        );
        let along = |k: u32| {
            let turns = time_secs / (SLOWEST_SECS * (0.4 + 0.6 * number(k))) + number(k + 3);
            (TAU * turns).sin()
        };
        let drift = DVec3::new(along(0), along(1), along(2)) * DRIFT;
        let position = middle + (place * (WITHIN - 2.0 * DRIFT) + drift) * size;
        Particle { position, flux: color(number(6)) * each }
    };
    (0..count).map(particle).collect()
}

/// A colour of a hue in 0..1, pale enough that many of them add up to white; the mean of its channels is 1.
fn color(hue: f64) -> Vec3 {
    let channel = |shift: f64| 1.0 + 0.7 * (TAU * (hue + shift)).cos() as f32;
    Vec3::new(channel(0.0), channel(1.0 / 3.0), channel(2.0 / 3.0))
}

/// A pseudo-random number in 0..1 (SplitMix64).
fn unit(seed: u64) -> f64 {
    let mut x = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: Bounds = Bounds { min: DVec3::new(1e6, -2.0, 0.0), max: DVec3::new(1e6 + 4.0, 6.0, 3.0) };

    #[test]
    fn particles_stay_within_the_bounds_and_move_continuously() {
        for time in [0.0, 3.3, 1e5] {
            let (before, after) = (glowing(&ROOM, 300, 1, time), glowing(&ROOM, 300, 1, time + 0.01));
            assert!(before.iter().all(|p| ROOM.contains(p.position)));
            let moves = before.iter().zip(&after).map(|(a, b)| a.position.distance(b.position));
            let most = moves.fold(0.0, f64::max);
            assert!(most > 1e-4 && most < 0.02, "{most} m in 10 ms");
        }
    }

    #[test]
    fn a_scene_is_as_bright_with_few_as_with_many() {
        let sum =
            |count| glowing(&ROOM, count, 7, 0.0).iter().map(|p| p.flux.element_sum()).sum::<f32>() / 3.0;
        assert!((sum(10) / sum(4096) - 1.0).abs() < 0.01, "{} {}", sum(10), sum(4096));
        assert!(glowing(&ROOM, 0, 1, 0.0).is_empty());
        assert_ne!(glowing(&ROOM, 5, 1, 0.0), glowing(&ROOM, 5, 2, 0.0));
    }
}

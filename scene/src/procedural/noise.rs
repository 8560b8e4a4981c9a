//! Noise and randomness from integers and IEEE basic arithmetic alone.
//!
//! Sine, cosine and powers come from each platform's library and differ in their last bits. This module uses only
//! `+ − × ÷ √`, which IEEE 754 rounds alike everywhere, so every process of a cluster generates the same triangles.

use glam::{DVec2, DVec3};

/// Mixes 64 bits thoroughly (the finaliser of SplitMix64).
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A stream of pseudo-random numbers (SplitMix64).
#[derive(Debug, Clone)]
pub(super) struct Random(u64);

impl Random {
    /// The stream of a seed; near seeds give unrelated streams.
    pub(super) fn new(seed: u64) -> Self {
        Self(mix(seed ^ 0x5851_f42d_4c95_7f2d))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in [low, high).
    pub(super) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in 0..count.
    pub(super) fn index(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Uniform in the unit ball.
    pub(super) fn in_ball(&mut self) -> DVec3 {
        loop {
            let p = DVec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0));
            if p.length_squared() <= 1.0 {
                return p;
            }
        }
    }

    /// Uniform on the unit sphere.
    pub(super) fn direction(&mut self) -> DVec3 {
        loop {
            let p = self.in_ball();
            if p.length_squared() > 1e-4 {
                return p.normalize();
            }
        }
    }
}

/// Smooth step from 0 at `from` to 1 at `to`.
pub(super) fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// (cos, sin) of a share of a full turn, to 1e-9: the Taylor series about the nearest quarter.
pub(super) fn circle(turns: f64) -> (f64, f64) {
    let quarters = (turns * 4.0).round();
    let x = (turns * 4.0 - quarters) * std::f64::consts::FRAC_PI_2;
    let x2 = x * x;
    let sin =
        x * (1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0 * (1.0 - x2 / 110.0)))));
    let cos = 1.0 - x2 / 2.0 * (1.0 - x2 / 12.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0 * (1.0 - x2 / 90.0))));
    match (quarters as i64).rem_euclid(4) {
        0 => (cos, sin),
        1 => (-sin, cos),
        2 => (-cos, -sin),
        _ => (sin, -cos),
    }
}

/// Gradients at lattice points: sixteen directions with their opposites, 22.5° apart, so that no axis stands out.
const GRADIENTS: [(f64, f64); 8] = [
    (0.980_785, 0.195_090),
    (0.831_470, 0.555_570),
    (0.555_570, 0.831_470),
    (0.195_090, 0.980_785),
    (-0.195_090, 0.980_785),
    (-0.555_570, 0.831_470),
    (-0.831_470, 0.555_570),
    (-0.980_785, 0.195_090),
];

/// Gradient noise (Perlin 2002), about −1..1, period 1 lattice cell; lattice coordinates are taken modulo
/// `period` where it is positive, so that the noise tiles.
fn gradient_noise(p: DVec2, seed: u32, period: i64) -> f64 {
    let base = p.floor();
    let f = p - base;
    let corner = |dx: i64, dy: i64| {
        let wrap = |v: i64| if period > 0 { v.rem_euclid(period) } else { v };
        let (x, y) = (wrap(base.x as i64 + dx), wrap(base.y as i64 + dy));
        let bits = mix((x as u64) << 32 ^ (y as u64 & 0xffff_ffff) ^ u64::from(seed) << 17);
        let (gx, gy) = GRADIENTS[(bits & 7) as usize];
        let sign = if bits & 8 == 0 { 1.0 } else { -1.0 };
        sign * (gx * (f.x - dx as f64) + gy * (f.y - dy as f64))
    };
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(f.x), fade(f.y));
    let top = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * u;
    let bottom = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * u;
    1.5 * (top + (bottom - top) * v)
}

/// Sum of `octaves` of gradient noise, each twice as fine and half as strong; about −1..1.
pub(super) fn fbm(p: DVec2, octaves: u32, seed: u32) -> f64 {
    octave_sum(octaves, |octave, scale| gradient_noise(p * scale, seed + octave, 0))
}

/// As [`fbm`], repeating every `period` units of `p`.
pub(super) fn tiling_fbm(p: DVec2, octaves: u32, seed: u32, period: i64) -> f64 {
    octave_sum(octaves, |octave, scale| gradient_noise(p * scale, seed + octave, period << octave))
}

/// Ridges at the noise's zero crossings, sharper the higher (Musgrave's ridged multifractal); about 0..1.
pub(super) fn ridged(p: DVec2, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut weight, mut scale, mut strength) = (0.0, 1.0, 1.0, 0.5);
    for octave in 0..octaves {
        let crest = 1.0 - gradient_noise(p * scale, seed + octave, 0).abs().min(1.0);
        let signal = crest * crest * weight;
        sum += signal * strength;
        weight = (signal * 1.8).clamp(0.0, 1.0);
        scale *= 2.03;
        strength *= 0.5;
    }
    sum
}

fn octave_sum(octaves: u32, noise: impl Fn(u32, f64) -> f64) -> f64 {
    let (mut sum, mut scale, mut strength) = (0.0, 1.0, 0.5);
    for octave in 0..octaves {
        sum += noise(octave, scale) * strength;
        scale *= 2.0;
        strength *= 0.5;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_circle_is_the_librarys_to_nine_digits() {
        for i in -40..80 {
            let turns = f64::from(i) / 37.0;
            let (cos, sin) = circle(turns);
            let angle = turns * std::f64::consts::TAU;
            assert!((cos - angle.cos()).abs() < 1e-9 && (sin - angle.sin()).abs() < 1e-9, "{turns}");
        }
    }

    #[test]
    fn noise_is_bounded_continuous_and_tiles_where_asked() {
        let step = 1.0 / 64.0;
        for i in 0..4096 {
            let p = DVec2::new(f64::from(i % 64), f64::from(i / 64)) * step * 4.3 - 7.0;
            let here = fbm(p, 4, 3);
            assert!(here.abs() < 1.2);
            assert!((here - fbm(p + step * 0.01, 4, 3)).abs() < 0.02, "{p}");
            let tiled = tiling_fbm(p, 3, 9, 4);
            assert!((tiled - tiling_fbm(p + DVec2::new(4.0, -8.0), 3, 9, 4)).abs() < 1e-9);
            assert!((0.0..1.6).contains(&ridged(p, 5, 1)));
        }
    }
}

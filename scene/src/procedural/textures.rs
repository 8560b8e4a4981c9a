//! Small tiling textures, with detail below the size of a triangle.

use std::sync::Arc;

use glam::DVec2;

use super::noise::{Random, smoothstep, tiling_fbm};
use crate::Texture;
use crate::material::{Filter, Wrap};

const SIDE: u32 = 256;

/// Fine mottling of the ground, around a mean of 0.9 of the encoded range.
pub(super) fn ground() -> Texture {
    let mut random = Random::new(101);
    tile("ground detail", |p| {
        let clumps = tiling_fbm(p * 12.0, 4, 102, 12);
        let tint = tiling_fbm(p * 5.0, 3, 103, 5);
        let value = 0.87 + 0.20 * clumps + random.range(-0.035, 0.035);
        [value + 0.035 * tint, value, value - 0.05 * tint.abs()]
    })
}

/// Cracked bark; stretched four times along the branch, its cells become furrows.
pub(super) fn bark() -> Texture {
    tile("bark", |p| {
        let crack = tiling_fbm(p * 9.0, 4, 111, 9).abs().min(tiling_fbm(p * 7.0, 3, 112, 7).abs());
        let plate = smoothstep(0.0, 0.20, crack);
        let lichen = smoothstep(0.15, 0.5, tiling_fbm(p * 3.0, 4, 113, 3));
        let value = 0.46 + 0.42 * plate + 0.10 * tiling_fbm(p * 24.0, 2, 114, 24);
        [value, value * (0.96 + 0.05 * lichen), value * (0.90 - 0.05 * lichen)]
    })
}

fn tile(name: &str, mut color: impl FnMut(DVec2) -> [f64; 3]) -> Texture {
    let mut rgba = Vec::with_capacity((SIDE * SIDE * 4) as usize);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / f64::from(SIDE);
            rgba.extend(color(p).map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8));
            rgba.push(255);
        }
    }
    Texture {
        name: name.to_owned(),
        width: SIDE,
        height: SIDE,
        rgba: Arc::from(rgba),
        srgb: true,
        wrap: [Wrap::Repeat; 2],
        filter: Filter::Linear,
    }
}

//! Viewpoints of a scene, the same on every machine, for load tests, the demo and the studies.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};

use crate::scene::RigKind;
use crate::{Bounds, Camera};

/// Largest deviation of a viewpoint from its camera, seen from the target: degrees around it, degrees up or down, and
/// a share of the distance.
const YAW_DEG: f64 = 14.0;
const PITCH_DEG: f64 = 5.0;
const DOLLY: f64 = 0.08;

/// `count` viewpoints spread around the `suggested` ones, in turn. The first of each is the suggested camera itself;
/// the rest surround it evenly (an additive recurrence with the plastic number's powers, so that any prefix covers the
/// range). Every one is valid if the suggested ones are.
///
/// Empty where nothing is suggested.
pub fn viewpoints(suggested: &[Camera], count: usize) -> Vec<Camera> {
    if suggested.is_empty() {
        return Vec::new();
    }
    (0..count)
        .map(|i| {
            let camera = suggested[i % suggested.len()];
            let turn = (i / suggested.len()) as f64;
            if turn == 0.0 { camera } else { stray(camera, turn) }
        })
        .collect()
}

/// A camera's neighbour of index `turn`, from 1.
fn stray(camera: Camera, turn: f64) -> Camera {
    // Reciprocal powers of the root of x⁴ = x + 1: a low-discrepancy sequence in three dimensions.
    let spread = |alpha: f64| 2.0 * (turn * alpha).fract() - 1.0;
    let (yaw, pitch, dolly) =
        (spread(0.819_172_513_396), spread(0.671_043_606_704), spread(0.549_700_477_902));
    let offset = camera.eye - camera.target;
    let side = camera.up.cross(offset).normalize_or(DVec3::X);
    let up = camera.up.normalize_or(DVec3::Y);
    // The pitch stops short of the pole, where up would be parallel to the view.
    let polar = offset.angle_between(up);
    let pitch = (polar - (PITCH_DEG * pitch).to_radians()).clamp(0.05, std::f64::consts::PI - 0.05) - polar;
    let turned = DQuat::from_axis_angle(up, (YAW_DEG * yaw).to_radians())
        * DQuat::from_axis_angle(side, pitch)
        * offset;
    Camera { eye: camera.target + turned * (1.0 + DOLLY * dolly), ..camera }
}

/// Endless random viewpoints, typical for the kind of rig, the same for the same seed. [`RigKind::Cell`]: among the
/// scene's walls, at any height below three quarters of its own, looking about level, with samples all around.
/// [`RigKind::TileCorners`]: from above its ground up to half its width above its top, looking down at a point in its
/// middle. Some viewpoints stand inside solid objects: a caller that knows the triangles skips them.
pub fn wandering(bounds: Bounds, kind: RigKind, seed: u64) -> impl Iterator<Item = Camera> {
    let mut next = uniform(seed);
    std::iter::repeat_with(move || {
        let (center, size) = (bounds.center(), bounds.size());
        let mut between = |low: f64, high: f64| low + (high - low) * next();
        let mut place = |share: f64, low: f64, high: f64| {
            let across = |center: f64, size: f64, x: f64| center + share * size * x;
            let (x, z) = (between(-0.5, 0.5), between(-0.5, 0.5));
            let y = bounds.min.y + size.y * between(low, high);
            DVec3::new(across(center.x, size.x, x), y, across(center.z, size.z, z))
        };
        match kind {
            RigKind::Cell => {
                let eye = place(0.8, 0.05, 0.75);
                let (yaw, pitch) = (between(0.0, 2.0 * PI), between(-0.5, 0.5));
                let ahead = DVec3::new(pitch.cos() * yaw.cos(), pitch.sin(), pitch.cos() * yaw.sin());
                Camera {
                    fov_deg: between(45.0, 75.0),
                    ..Camera::look_at(eye, eye + ahead * size.max_element())
                }
            }
            RigKind::TileCorners => {
                let eye = place(1.0, 0.1, 1.0);
                let target = place(0.6, 0.0, 0.3);
                let above = 0.5 * size.x.max(size.z) * between(0.0, 1.0).powi(2);
                let eye = eye + DVec3::Y * above;
                Camera { fov_deg: between(35.0, 65.0), ..Camera::look_at(eye, target) }
            }
        }
    })
    .filter(|camera| camera.validate().is_ok())
}

/// Endless uniform numbers in 0..1, the same for the same seed: Steele, Lea and Flood's SplitMix64 (*Fast splittable pseudorandom number generators*,
/// OOPSLA 2014).
pub fn uniform(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wandering_viewpoints_are_valid_repeatable_and_spread_over_the_scene() {
        let bounds = Bounds { min: DVec3::new(-20.0, 0.0, -10.0), max: DVec3::new(20.0, 15.0, 10.0) };
        for kind in [RigKind::Cell, RigKind::TileCorners] {
            let cameras: Vec<Camera> = wandering(bounds, kind, 7).take(500).collect();
            assert_eq!(cameras, wandering(bounds, kind, 7).take(500).collect::<Vec<_>>());
            assert_ne!(cameras[0], wandering(bounds, kind, 8).next().unwrap());
            for quadrant in 0..4 {
                let (x, z) = (quadrant & 1 == 0, quadrant & 2 == 0);
                let there = cameras.iter().filter(|c| (c.eye.x > 0.0) == x && (c.eye.z > 0.0) == z).count();
                assert!(there > 80, "{there} of 500 in quadrant {quadrant}");
            }
            cameras.iter().for_each(|camera| camera.validate().unwrap());
        }
    }

    #[test]
    fn viewpoints_are_valid_distinct_and_begin_with_the_suggested_ones() {
        let steep = Camera { up: DVec3::Y, ..Camera::look_at(DVec3::new(0.0, 9.0, 0.4), DVec3::ZERO) };
        let level = Camera::look_at(DVec3::new(-11.0, 3.0, 0.0), DVec3::new(0.0, 4.0, 0.0));
        let cameras = viewpoints(&[steep, level], 500);
        assert_eq!(cameras[..2], [steep, level]);
        for (i, camera) in cameras.iter().enumerate() {
            camera.validate().unwrap_or_else(|e| panic!("viewpoint {i}: {e}"));
            assert!(cameras[..i].iter().all(|other| other != camera), "viewpoint {i} is not new");
        }
        assert_eq!(cameras, viewpoints(&[steep, level], 500));
        assert!(viewpoints(&[], 4).is_empty());
    }
}

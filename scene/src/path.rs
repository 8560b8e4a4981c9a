//! Many viewpoints of one scene, the same on every machine: what load tests, the demo and the studies look
//! through.

use glam::{DQuat, DVec3};

use crate::Camera;

/// How far, as seen from the target, a viewpoint strays from the camera it is made from: degrees around it,
/// degrees up or down, and a share of the distance.
const YAW_DEG: f64 = 14.0;
const PITCH_DEG: f64 = 5.0;
const DOLLY: f64 = 0.08;

/// `count` viewpoints spread around the `suggested` ones, in turn. The first of each is the suggested camera
/// itself; the others surround it evenly (an additive recurrence with the plastic number's powers, so that any
/// prefix covers the range). Every one is valid if the suggested ones are.
///
/// Returns none where nothing is suggested.
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

/// The camera's `turn`-th neighbour, 1 and up.
fn stray(camera: Camera, turn: f64) -> Camera {
    // Reciprocal powers of the root of x⁴ = x + 1: a low-discrepancy sequence in three dimensions.
    let spread = |alpha: f64| 2.0 * (turn * alpha).fract() - 1.0;
    let (yaw, pitch, dolly) =
        (spread(0.819_172_513_396), spread(0.671_043_606_704), spread(0.549_700_477_902));
    let offset = camera.eye - camera.target;
    let side = camera.up.cross(offset).normalize_or(DVec3::X);
    let up = camera.up.normalize_or(DVec3::Y);
    // Pitching towards the pole stops short of it, where up would be parallel to the view.
    let polar = offset.angle_between(up);
    let pitch = (polar - (PITCH_DEG * pitch).to_radians()).clamp(0.05, std::f64::consts::PI - 0.05) - polar;
    let turned = DQuat::from_axis_angle(up, (YAW_DEG * yaw).to_radians())
        * DQuat::from_axis_angle(side, pitch)
        * offset;
    Camera { eye: camera.target + turned * (1.0 + DOLLY * dolly), ..camera }
}

#[cfg(test)]
mod tests {
    use super::*;

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

//! Poses: a camera's place as a matrix from camera to world.

use argus_scene::Camera;
use glam::{DMat4, DVec3};

/// Most by which a column of a pose may differ from unit length, or two from a right angle.
const LEAST_RIGID: f64 = 1e-3;

/// Axes of a camera in its pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Axes {
    /// x right, y down, z forward.
    OpenCv,
    /// x right, y up, z backward.
    OpenGl,
}

/// A camera at the place of a pose (camera to world), with the lens of `usual`.
///
/// # Errors
/// The pose is no rigid motion: a number is not finite, or its columns are no rotation.
pub(crate) fn placed(pose: DMat4, axes: Axes, usual: Camera) -> Result<Camera, &'static str> {
    if !pose.is_finite() {
        return Err("its numbers must be finite");
    }
    let [x, y, z] = [pose.x_axis, pose.y_axis, pose.z_axis].map(|axis| axis.truncate());
    let skew = [x.dot(y), y.dot(z), z.dot(x), x.length() - 1.0, y.length() - 1.0, z.length() - 1.0];
    // Written so that an overflow is refused.
    if !(skew.iter().all(|off| off.abs() <= LEAST_RIGID) && x.cross(y).dot(z) > 0.0) {
        return Err("its first three columns must be a rotation, without scale or reflection");
    }
    let (ahead, up): (DVec3, DVec3) = match axes {
        Axes::OpenCv => (z, -y),
        Axes::OpenGl => (-z, y),
    };
    let eye = pose.w_axis.truncate();
    // Far enough that f64 holds the direction at any place.
    let target = eye + ahead * eye.abs().max_element().max(1.0);
    Ok(Camera { eye, target, up, ..usual })
}

/// The pose of a valid camera (camera to world).
pub(crate) fn pose_of(camera: &Camera, axes: Axes) -> DMat4 {
    let axes_in_world = camera.view_from_world().transpose();
    let flip = match axes {
        Axes::OpenCv => -1.0,
        Axes::OpenGl => 1.0,
    };
    DMat4::from_cols(
        axes_in_world.x_axis.extend(0.0),
        (axes_in_world.y_axis * flip).extend(0.0),
        (axes_in_world.z_axis * flip).extend(0.0),
        camera.eye.extend(1.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_survives_its_pose_at_any_place() {
        for far in [0.0, 1.0, 1e6] {
            let eye = DVec3::new(1.0 + far, -2.0 * far, 0.5);
            let camera = Camera { up: DVec3::Z, ..Camera::look_at(eye, eye + DVec3::new(-3.0, 4.0, 1.0)) };
            for axes in [Axes::OpenCv, Axes::OpenGl] {
                let pose = pose_of(&camera, axes);
                let again = placed(pose, axes, camera).unwrap();
                assert!(pose_of(&again, axes).abs_diff_eq(pose, 1e-12), "{axes:?} {far}");
                assert_eq!(again.eye, camera.eye);
            }
        }
    }
}

//! Flags of a camera. What is not given follows from the scene's default view.

use std::fmt::Write as _;

use argus_scene::{Camera, Scene};
use glam::DVec3;

use super::{lens, point, size};
use crate::exit::bad_arguments;

/// A camera that is the scene's default view if no flag is given.
#[derive(clap::Args, Debug, Clone)]
pub(crate) struct Viewpoint {
    /// Position of the viewer, metres [default: that of the scene's default view: the file's first camera, or one that
    /// shows all of it]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// Point that the viewer looks at, metres [default: that of the scene's default view]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    target: Option<DVec3>,
    /// Direction that points up in the image [default: 0,1,0 with --eye or --target, else the default view's]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    up: Option<DVec3>,
    /// Vertical field of view, degrees [default: 45 with --eye or --target, else the default view's]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    fov_deg: Option<f64>,
}

impl Viewpoint {
    /// The camera of these flags in a scene with that default view. It is not checked.
    pub(crate) fn camera(&self, usual: Camera) -> Camera {
        let camera = match (self.eye, self.target) {
            (None, None) => usual,
            (eye, target) => Camera::look_at(eye.unwrap_or(usual.eye), target.unwrap_or(usual.target)),
        };
        Camera { up: self.up.unwrap_or(camera.up), fov_deg: self.fov_deg.unwrap_or(camera.fov_deg), ..camera }
    }
}

/// A camera and the size of its image.
#[derive(clap::Args, Debug, Clone)]
pub(crate) struct Picture {
    #[command(flatten)]
    viewpoint: Viewpoint,
    /// Size of the image in pixels
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = size)]
    pub(crate) size: [u32; 2],
}

impl Picture {
    /// The camera that the flags or the scene name.
    ///
    /// # Errors
    /// The camera has no image, or the size is 0 or beyond 16384 pixels a side.
    pub(crate) fn camera(&self, scene: &Scene) -> anyhow::Result<Camera> {
        let camera = self.viewpoint.camera(scene.default_camera());
        camera.validate().map_err(|error| bad_arguments(error.to_string()))?;
        if self.size.iter().any(|side| !(1..=16384).contains(side)) {
            return Err(bad_arguments("--size: must be 1 to 16384 pixels a side"));
        }
        Ok(camera)
    }
}

/// Significant digits of a camera's distance to its target in [`flags_of`].
const DIGITS: f64 = 6.0;

/// A camera as flags of `argus view`, with as many decimals as its scale needs.
pub(crate) fn flags_of(camera: &Camera) -> String {
    let Camera { eye, target, up, fov_deg, lens } = camera;
    let decimals = (DIGITS - 1.0 - eye.distance(*target).log10().floor()).clamp(0.0, 15.0) as usize;
    let point = |p: &DVec3| format!("{:.decimals$},{:.decimals$},{:.decimals$}", p.x, p.y, p.z);
    let mut flags = format!("--eye {} --target {}", point(eye), point(target));
    match lens {
        Some(lens) => flags += &lens::flags_of(Some(lens)),
        None => {
            let _ = write!(flags, " --fov-deg {fov_deg:.3}");
        }
    }
    if *up != DVec3::Y {
        let _ = write!(flags, " --up {:.6},{:.6},{:.6}", up.x, up.y, up.z);
    }
    flags
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    #[command(allow_negative_numbers = true)]
    struct Line {
        #[command(flatten)]
        viewpoint: Viewpoint,
    }

    fn camera(flags: &str, usual: Camera) -> Camera {
        let words = std::iter::once("line").chain(flags.split_whitespace());
        Line::try_parse_from(words).unwrap().viewpoint.camera(usual)
    }

    #[test]
    fn flags_that_are_not_given_follow_from_the_default_view() {
        let (eye, target) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 5.0, 6.0));
        let usual = Camera { eye, target, up: DVec3::Z, fov_deg: 60.0, lens: None };
        assert_eq!(camera("", usual), usual);
        assert_eq!(camera("--fov-deg 30", usual), Camera { fov_deg: 30.0, ..usual });
        assert_eq!(camera("--up 1,0,0", usual), Camera { up: DVec3::X, ..usual });
        let other = DVec3::new(-7.0, 8.0, 9.0);
        assert_eq!(camera("--eye -7,8,9", usual), Camera::look_at(other, target));
        assert_eq!(camera("--target -7,8,9", usual), Camera::look_at(eye, other));
        assert_eq!(camera("--eye -7,8,9 --target 1,2,3", usual), Camera::look_at(other, eye));
    }

    #[test]
    fn a_camera_survives_its_flags_at_every_scale() {
        let unit = Camera {
            eye: DVec3::new(1.234_567, -0.765_432, 0.111_111),
            target: DVec3::new(-0.222_222, 0.333_333, -0.444_444),
            up: DVec3::new(0.0, 0.6, 0.8),
            fov_deg: 39.597_8,
            lens: None,
        };
        for scale in [1e-3, 1.0, 1e3, 1e6] {
            let there = Camera { eye: unit.eye * scale, target: unit.target * scale, ..unit };
            let again = camera(&flags_of(&there), Camera::look_at(DVec3::ONE, DVec3::ZERO));
            let off = again.eye.distance(there.eye) + again.target.distance(there.target);
            assert!(off < 1e-4 * scale, "{scale}: {off}");
            assert!(again.up.distance(unit.up) < 1e-5 && (again.fov_deg - unit.fov_deg).abs() < 1e-3);
        }
    }
}

//! Flags of a lens, and of a pose as a matrix.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use argus_scene::{Camera, Distortion, Intrinsics, Lens, RayList};
use glam::{DMat4, DVec2, DVec3};

use super::pose::{Axes, placed};
use crate::exit::bad_arguments;

/// A calibrated or omnidirectional camera.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Calibrated cameras")]
pub(crate) struct LensArgs {
    /// Focal lengths and principal point for an image of --size, pixels
    #[arg(long, value_name = "FX,FY,CX,CY", value_parser = numbers, allow_hyphen_values = true, conflicts_with = "fov_deg")]
    intrinsics: Option<Numbers>,
    /// Distortion by OpenCV's coefficients: 4, 5 or 8 of them
    #[arg(
        long,
        value_name = "K1,K2,P1,P2[,K3[,K4,K5,K6]]",
        value_parser = numbers,
        allow_hyphen_values = true,
        requires = "intrinsics",
        conflicts_with = "fisheye"
    )]
    distortion: Option<Numbers>,
    /// Distortion by OpenCV's fisheye model
    #[arg(long, value_name = "K1,K2,K3,K4", value_parser = numbers, allow_hyphen_values = true, requires = "intrinsics")]
    fisheye: Option<Numbers>,
    /// Where the centre of the first pixel lies in the coordinates of the principal point: 0.5, or 0 as in OpenCV
    #[arg(long, value_name = "PIXELS", default_value = "0.5", value_parser = ["0.5", "0"], requires = "intrinsics")]
    pixel_center: String,
    /// Show all directions: 360° from left to right, 180° from top to bottom
    #[arg(long, conflicts_with_all = ["intrinsics", "fov_deg"])]
    equirectangular: bool,
    /// File of directions x y z, one a line, for each pixel of --size row by row, in the camera's axes: a lidar's scan
    #[arg(long, value_name = "FILE", conflicts_with_all = ["intrinsics", "fov_deg", "equirectangular"])]
    rays: Option<PathBuf>,
    /// File with the camera's place as a 4×4 matrix from camera to world: 16 numbers, row by row
    #[arg(long, value_name = "FILE", conflicts_with_all = ["eye", "target", "up"])]
    pose: Option<PathBuf>,
    /// Axes of --pose and --rays: opencv (y down, z forward) or opengl (y up, z backward)
    #[arg(long, value_name = "AXES", default_value = "opencv", value_parser = ["opencv", "opengl"])]
    convention: String,
}

/// Numbers of one flag. A newtype, since clap takes a bare list for many flags.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Numbers(Vec<f64>);

/// Parses numbers separated by commas. Infinite and NaN numbers pass: the camera's check names the invalid field.
fn numbers(text: &str) -> Result<Numbers, String> {
    let parts = text.split(',').map(|part| part.trim().parse::<f64>()).collect::<Result<Vec<_>, _>>();
    parts.map(Numbers).map_err(|_| "must be numbers separated by commas".to_owned())
}

impl LensArgs {
    /// A camera with what these flags change. It is not checked.
    ///
    /// # Errors
    /// A flag with another number of values than it takes, or a pose that cannot be read or is no rigid motion.
    pub(crate) fn camera(&self, usual: Camera) -> anyhow::Result<Camera> {
        let posed = match &self.pose {
            Some(file) => {
                let text = std::fs::read_to_string(file)
                    .map_err(|error| bad_arguments(format!("--pose {}: {error}", file.display())))?;
                self.posed(&text, file, usual)?
            }
            None => usual,
        };
        Ok(Camera { lens: self.lens()?.or(posed.lens), ..posed })
    }

    /// The camera with the rays of the file, for an image with rows of `width` pixels.
    ///
    /// # Errors
    /// A file that cannot be read, or is no list of directions.
    pub(crate) fn listed(&self, camera: Camera, width: u32) -> anyhow::Result<(Camera, Option<RayList>)> {
        let Some(file) = &self.rays else { return Ok((camera, None)) };
        let refused = |reason: String| bad_arguments(format!("--rays {}: {reason}", file.display()));
        camera.validate()?;
        let text = std::fs::read_to_string(file).map_err(|error| refused(error.to_string()))?;
        let [down, forward] = if self.convention == "opencv" { [-1.0, -1.0] } else { [1.0, 1.0] };
        let world_from_view = camera.view_from_world().transpose();
        let directions =
            text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()).map(|(at, line)| {
                let parts =
                    line.split(|c: char| c.is_whitespace() || c == ',').filter(|part| !part.is_empty());
                let numbers: Option<Vec<f64>> = parts.map(|part| part.parse().ok()).collect();
                let Some([x, y, z]) = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok()) else {
                    return Err(refused(format!("line {} must be three numbers, x y z", at + 1)));
                };
                Ok((world_from_view * DVec3::new(x, y * down, z * forward)).as_vec3())
            });
        let list = RayList::new(directions.collect::<anyhow::Result<_>>()?)?;
        let lens = Lens::Rays { spacing_deg: list.spacing_deg(width) };
        Ok((Camera { lens: Some(lens), ..camera }, Some(list)))
    }

    fn lens(&self) -> anyhow::Result<Option<Lens>> {
        if self.equirectangular {
            return Ok(Some(Lens::Equirectangular));
        }
        let Some(Numbers(matrix)) = &self.intrinsics else { return Ok(None) };
        let &[fx, fy, cx, cy] = &matrix[..] else {
            return Err(bad_arguments("--intrinsics: must be four numbers, such as 500,500,320,240"));
        };
        let distortion = match (&self.distortion, &self.fisheye) {
            (Some(Numbers(k)), _) => match k[..] {
                [_, _, _, _] | [_, _, _, _, _] | [_, _, _, _, _, _, _, _] => {
                    Distortion::Rational(std::array::from_fn(|i| k.get(i).copied().unwrap_or(0.0)))
                }
                _ => return Err(bad_arguments("--distortion: must be 4, 5 or 8 numbers")),
            },
            (None, Some(Numbers(k))) => match k[..] {
                [k1, k2, k3, k4] => Distortion::Fisheye([k1, k2, k3, k4]),
                _ => return Err(bad_arguments("--fisheye: must be four numbers")),
            },
            (None, None) => Distortion::None,
        };
        let shift = if self.pixel_center == "0" { 0.5 } else { 0.0 };
        let (focal, center) = (DVec2::new(fx, fy), DVec2::new(cx, cy) + shift);
        Ok(Some(Lens::Intrinsics(Intrinsics { focal, center, distortion })))
    }

    /// A camera with the pose of a file's text.
    fn posed(&self, text: &str, file: &Path, usual: Camera) -> anyhow::Result<Camera> {
        let refused = |reason: &str| bad_arguments(format!("--pose {}: {reason}", file.display()));
        let parts =
            text.split(|c: char| c.is_whitespace() || ",;[]".contains(c)).filter(|part| !part.is_empty());
        let values: Result<Vec<f64>, _> = parts.map(str::parse::<f64>).collect();
        let values = values.map_err(|_| refused("must be 16 numbers"))?;
        let values = <[f64; 16]>::try_from(values)
            .map_err(|all| refused(&format!("must be 16 numbers, row by row, not {}", all.len())))?;
        let matrix = DMat4::from_cols_array(&values).transpose();
        if matrix.row(3) != glam::DVec4::W {
            return Err(refused("its last row must be 0 0 0 1: a matrix from camera to world, row by row"));
        }
        let axes = if self.convention == "opencv" { Axes::OpenCv } else { Axes::OpenGl };
        placed(matrix, axes, usual).map_err(refused)
    }
}

/// A lens as flags of `argus view`; empty for the usual one.
pub(super) fn flags_of(lens: Option<&Lens>) -> String {
    let Intrinsics { focal, center, distortion } = match lens {
        None => return String::new(),
        Some(Lens::Equirectangular) => return " --equirectangular".to_owned(),
        // The file is not known any more.
        Some(Lens::Rays { .. }) => return " --rays FILE".to_owned(),
        Some(Lens::Intrinsics(intrinsics)) => intrinsics,
    };
    let mut flags = format!(" --intrinsics {},{},{},{}", focal.x, focal.y, center.x, center.y);
    let (flag, k): (&str, &[f64]) = match distortion {
        Distortion::None => return flags,
        Distortion::Rational(k) => ("distortion", k),
        Distortion::Fisheye(k) => ("fisheye", k),
    };
    let k: Vec<String> = k.iter().map(f64::to_string).collect();
    let _ = write!(flags, " --{flag} {}", k.join(","));
    flags
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use glam::Vec3;

    use super::*;

    #[derive(Parser)]
    #[command(allow_negative_numbers = true)]
    struct Line {
        #[command(flatten)]
        viewpoint: super::super::Viewpoint,
        #[command(flatten)]
        lens: LensArgs,
    }

    fn usual() -> Camera {
        Camera::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO)
    }

    fn line(flags: &str) -> Result<LensArgs, clap::Error> {
        let words = std::iter::once("line").chain(flags.split_whitespace());
        Line::try_parse_from(words).map(|line| line.lens)
    }

    fn camera(flags: &str) -> Camera {
        line(flags).unwrap().camera(usual()).unwrap()
    }

    #[test]
    fn a_lens_survives_its_flags() {
        for distortion in [
            Distortion::None,
            Distortion::Rational([-0.1, 0.25, 1e-3, -2e-5, 0.5, 0.0, 0.125, 1.0]),
            Distortion::Fisheye([0.1, -0.2, 0.3, -0.4]),
        ] {
            let (focal, center) = (DVec2::new(500.5, 480.0), DVec2::new(-3.25, 1e-3));
            let lens = Lens::Intrinsics(Intrinsics { focal, center, distortion });
            assert_eq!(camera(&flags_of(Some(&lens))).lens, Some(lens));
        }
        assert_eq!(camera(&flags_of(Some(&Lens::Equirectangular))).lens, Some(Lens::Equirectangular));
        assert_eq!(camera(""), usual());
    }

    #[test]
    fn rays_of_a_file_are_turned_with_the_camera() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rays.txt");
        let listed = |flags: &str, text: &str| {
            std::fs::write(&file, text).unwrap();
            let line = line(&format!("--rays {} {flags}", file.display())).unwrap();
            line.listed(Camera::look_at(DVec3::ZERO, DVec3::X), 3)
        };
        let text = "0 0 1\n1, 0, 0\n\n0 1 0\n";
        let (camera, list) = listed("", text).unwrap();
        assert_eq!(camera.lens, Some(Lens::Rays { spacing_deg: 90.0 }));
        // Forward along x, right along z, down along −y.
        assert_eq!(list.unwrap().directions(), [Vec3::X, Vec3::Z, Vec3::NEG_Y]);
        let (_, list) = listed("--convention opengl", text).unwrap();
        assert_eq!(list.unwrap().directions(), [Vec3::NEG_X, Vec3::Z, Vec3::Y]);
        for (text, words) in
            [("0 0 1\n1 2", "line 2"), ("a b c", "line 1"), ("", "1 to 65536"), ("0 0 inf", "direction 0")]
        {
            let said = listed("", text).unwrap_err().to_string();
            assert!(said.contains(words), "{said}");
        }
    }

    #[test]
    fn the_first_pixel_s_centre_is_where_the_flag_says() {
        let lens = |flags: &str| camera(&format!("--intrinsics 500,500,319.5,239.5 {flags}")).lens.unwrap();
        let Lens::Intrinsics(corner) = lens("") else { panic!("intrinsics") };
        let Lens::Intrinsics(opencv) = lens("--pixel-center 0") else { panic!("intrinsics") };
        assert_eq!(corner.center, DVec2::new(319.5, 239.5));
        assert_eq!(opencv.center, DVec2::new(320.0, 240.0));
    }

    #[test]
    fn a_pose_of_either_convention_is_the_same_camera() {
        let axes = usual().view_from_world().transpose();
        let rows = |x: DVec3, y: DVec3, z: DVec3| {
            let eye = usual().eye;
            let row = |i: usize| format!("{} {} {} {}\n", x[i], y[i], z[i], eye[i]);
            format!("{}{}{}0 0 0 1", row(0), row(1), row(2))
        };
        let file = Path::new("pose.txt");
        let posed = |flags: &str, text: &str| line(flags).unwrap().posed(text, file, usual());
        let opengl = rows(axes.x_axis, axes.y_axis, axes.z_axis);
        let opencv = rows(axes.x_axis, -axes.y_axis, -axes.z_axis);
        for (flags, text) in [("--pose p", &opencv), ("--pose p --convention opengl", &opengl)] {
            let found = posed(flags, text).unwrap();
            let off = found.view_from_world().transpose() - axes;
            assert!(found.eye == usual().eye && off.to_cols_array().iter().all(|x| x.abs() < 1e-12));
        }
        let mirrored = rows(axes.x_axis, axes.y_axis, -axes.z_axis);
        let scaled = rows(axes.x_axis * 2.0, axes.y_axis, axes.z_axis);
        let not_a_number = rows(DVec3::NAN, axes.y_axis, axes.z_axis);
        for wrong in ["", "1 2 3", "a b", &opencv[..8], &mirrored, &scaled, &not_a_number, &"1 ".repeat(16)] {
            let said = posed("--pose p", wrong).unwrap_err().to_string();
            assert!(said.contains("--pose pose.txt: "), "{said}");
        }
    }

    #[test]
    fn flags_that_do_not_go_together_are_refused() {
        for wrong in [
            "--intrinsics 1,2,3,4 --fov-deg 40",
            "--distortion 1,2,3,4",
            "--fisheye 1,2,3,4",
            "--intrinsics 1,2,3,4 --equirectangular",
            "--intrinsics 1,2,3,4 --distortion 1,2,3,4 --fisheye 1,2,3,4",
            "--intrinsics 1,2,3,4 --pixel-center 0.25",
            "--pose p --eye 1,2,3",
            "--intrinsics 1,x,3,4",
        ] {
            assert!(line(wrong).is_err(), "{wrong}");
        }
        for wrong in [
            "--intrinsics 1,2,3",
            "--intrinsics 1,2,3,4 --distortion 1,2,3",
            "--intrinsics 1,2,3,4 --fisheye 1,2,3,4,5",
            "--pose /nowhere",
        ] {
            assert!(line(wrong).unwrap().camera(usual()).is_err(), "{wrong}");
        }
    }
}

//! NeRF's `transforms.json`, as instant-ngp and nerfstudio read it.
//!
//! Poses are from camera to world by OpenGL's axes, lengths are metres, and the centre of the first pixel is (½, ½).

use anyhow::{Context, bail, ensure};
use argus_scene::{Distortion, Intrinsics, Output};
use glam::{DMat4, DVec2};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::bounded;
use super::files::relative_path;
use super::model::{Calibration, Model};
use super::shots::{Cameras, Format, Shot, camera_at, image_name, intrinsics_of};
use crate::args::{Axes, pose_of};

/// The file, or a frame of it: what a frame lacks is the file's.
#[derive(Deserialize, Default)]
#[serde(default)]
struct Raw {
    #[serde(deserialize_with = "bounded::list")]
    frames: Vec<Raw>,
    file_path: Option<String>,
    transform_matrix: Option<Vec<Vec<f64>>>,
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    k5: Option<f64>,
    k6: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    depth_unit_scale_factor: Option<f64>,
}

/// A frame with what it inherits.
struct Frame<'a> {
    own: &'a Raw,
    file: &'a Raw,
}

/// Reads the text of a file. `size` is that of images of which the file says none.
///
/// # Errors
/// Text that is no such file, with the frame and the field at fault.
pub(super) fn read(text: &str, size: Option<[u32; 2]>) -> anyhow::Result<Cameras> {
    let file: Raw = serde_json::from_str(text).context("it is no transforms.json")?;
    let shot = |index: usize| {
        Frame { own: &file.frames[index], file: &file }
            .shot(index, size)
            .with_context(|| format!("frames[{index}]"))
    };
    let shots = (0..file.frames.len()).map(shot).collect::<anyhow::Result<_>>()?;
    Cameras { format: Format::Transforms, shots }.checked()
}

impl Frame<'_> {
    fn of<T>(&self, pick: impl Fn(&Raw) -> Option<T>) -> Option<T> {
        pick(self.own).or_else(|| pick(self.file))
    }

    fn shot(&self, index: usize, size: Option<[u32; 2]>) -> anyhow::Result<Shot> {
        let path = self.own.file_path.as_deref().context("file_path is missing")?;
        let name = image_name(path)?;
        let size = self.size(size)?;
        let camera = camera_at(self.pose()?, Axes::OpenGl, self.intrinsics(size)?)?;
        let depth_unit = self.of(|raw| raw.depth_unit_scale_factor);
        Ok(Shot { name, id: index as u32, camera, size, depth_unit })
    }

    fn size(&self, usual: Option<[u32; 2]>) -> anyhow::Result<[u32; 2]> {
        let (w, h) = (self.of(|raw| raw.w), self.of(|raw| raw.h));
        match (w, h, usual) {
            (Some(w), Some(h), _) => Ok([side("w", w)?, side("h", h)?]),
            (_, _, Some(size)) => Ok(size),
            _ => bail!("w and h are missing: give the images' size in the file or by --size"),
        }
    }

    fn pose(&self) -> anyhow::Result<DMat4> {
        let rows = self.own.transform_matrix.as_ref().context("transform_matrix is missing")?;
        ensure!(
            (3..=4).contains(&rows.len()) && rows.iter().all(|row| row.len() == 4),
            "transform_matrix: must be 4 rows of 4 numbers"
        );
        let numbers = rows.iter().flatten().copied().chain([0.0, 0.0, 0.0, 1.0]).take(16);
        let matrix = DMat4::from_cols_slice(&numbers.collect::<Vec<f64>>()).transpose();
        ensure!(matrix.row(3) == glam::DVec4::W, "transform_matrix: its last row must be 0 0 0 1");
        Ok(matrix)
    }

    fn intrinsics(&self, size: [u32; 2]) -> anyhow::Result<Intrinsics> {
        let [w, h] = size.map(f64::from);
        let by_angle = |side: f64, angle: Option<f64>| angle.map(|angle| 0.5 * side / (0.5 * angle).tan());
        let x = self.of(|raw| raw.fl_x).or_else(|| by_angle(w, self.of(|raw| raw.camera_angle_x)));
        let y = self.of(|raw| raw.fl_y).or_else(|| by_angle(h, self.of(|raw| raw.camera_angle_y)));
        let Some(x) = x.or(y) else {
            bail!("the intrinsics are missing: give fl_x and fl_y in pixels, or camera_angle_x in radians");
        };
        let center =
            DVec2::new(self.of(|raw| raw.cx).unwrap_or(0.5 * w), self.of(|raw| raw.cy).unwrap_or(0.5 * h));
        Ok(Intrinsics { focal: DVec2::new(x, y.unwrap_or(x)), center, distortion: self.distortion()? })
    }

    fn distortion(&self) -> anyhow::Result<Distortion> {
        let fisheye = self.of(|raw| raw.is_fisheye).unwrap_or(false);
        let model = match self.of(|raw| raw.camera_model.clone()) {
            Some(name) => Model::named(&name)?,
            None if fisheye => Model::OpenCvFisheye,
            None => Model::OpenCv,
        };
        let picks: [fn(&Raw) -> Option<f64>; 8] =
            [|r| r.k1, |r| r.k2, |r| r.p1, |r| r.p2, |r| r.k3, |r| r.k4, |r| r.k5, |r| r.k6];
        let [k1, k2, p1, p2, k3, k4, k5, k6] = picks.map(|pick| self.of(pick).unwrap_or(0.0));
        let rational = [k1, k2, p1, p2, k3, k4, k5, k6];
        match model {
            Model::OpenCvFisheye => Ok(Distortion::Fisheye([k1, k2, k3, k4])),
            Model::FullOpenCv => Ok(Distortion::Rational(rational)),
            _ if [k4, k5, k6].iter().any(|k| *k != 0.0) => bail!(
                "k4, k5 and k6 of {} must be 0: give camera_model FULL_OPENCV if they divide, as in OpenCV, or \
                 OPENCV_FISHEYE",
                model.name()
            ),
            _ if rational.iter().all(|k| *k == 0.0) => Ok(Distortion::None),
            _ => Ok(Distortion::Rational(rational)),
        }
    }
}

/// A side of an image, pixels.
fn side(field: &str, pixels: f64) -> anyhow::Result<u32> {
    ensure!(
        pixels.fract() == 0.0 && (1.0..=1e6).contains(&pixels),
        "{field}: must be a whole number of pixels, not {pixels}"
    );
    Ok(pixels as u32)
}

/// The text of a file with these images and outputs. Depth images have steps of `depth_unit` metres.
///
/// # Errors
/// A camera without intrinsics.
pub(super) fn write(cameras: &Cameras, outputs: &[Output], depth_unit: f64) -> anyhow::Result<String> {
    let first = cameras.shots.first().context("no images")?;
    let (lens, size) = (intrinsics_of(&first.camera)?, first.size);
    let shared = cameras
        .shots
        .iter()
        .all(|shot| shot.size == size && intrinsics_of(&shot.camera).is_ok_and(|other| other == lens));
    let mut file = if shared { lens_fields(&lens, size) } else { Map::new() };
    if outputs.contains(&Output::Depth) {
        file.insert("depth_unit_scale_factor".to_owned(), json!(depth_unit));
    }
    let frame = |shot: &Shot| {
        let mut frame = Map::new();
        for output in outputs {
            let key = match output {
                Output::Color => "file_path".to_owned(),
                output => format!("{}_file_path", output.name()),
            };
            frame.insert(key, json!(relative_path(cameras.format, *output, shot)));
        }
        // Readers want a path, though no colours were asked for.
        frame.entry("file_path").or_insert_with(|| json!(shot.name));
        if !shared {
            frame.append(&mut lens_fields(&intrinsics_of(&shot.camera)?, shot.size));
        }
        let pose = pose_of(&shot.camera, Axes::OpenGl).transpose();
        let rows = [pose.x_axis, pose.y_axis, pose.z_axis, pose.w_axis].map(|row| row.to_array());
        frame.insert("transform_matrix".to_owned(), json!(rows));
        Ok(Value::Object(frame))
    };
    let frames = cameras.shots.iter().map(frame).collect::<anyhow::Result<Vec<_>>>()?;
    file.insert("frames".to_owned(), Value::Array(frames));
    Ok(serde_json::to_string_pretty(&file)? + "\n")
}

fn lens_fields(lens: &Intrinsics, [w, h]: [u32; 2]) -> Map<String, Value> {
    let Calibration { model, .. } = Calibration::of(lens);
    // A fifth coefficient of OpenCV's shorter model is k3, which needs no other model here.
    let (model, names, k): (Model, &[&str], &[f64]) = match &lens.distortion {
        Distortion::None => (model, &[], &[]),
        Distortion::Rational(k) if k[5..].iter().all(|k| *k == 0.0) => {
            (Model::OpenCv, &["k1", "k2", "p1", "p2", "k3"], &k[..5])
        }
        Distortion::Rational(k) => (model, &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"], k),
        Distortion::Fisheye(k) => (model, &["k1", "k2", "k3", "k4"], k),
    };
    let Intrinsics { focal, center, .. } = lens;
    let fixed = [("fl_x", focal.x), ("fl_y", focal.y), ("cx", center.x), ("cy", center.y)];
    let numbers = fixed.into_iter().chain(names.iter().copied().zip(k.iter().copied()));
    [("camera_model", json!(model.name())), ("w", json!(w)), ("h", json!(h))]
        .into_iter()
        .chain(numbers.map(|(name, number)| (name, json!(number))))
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}

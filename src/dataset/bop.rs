//! BOP's `scene_camera.json` and `camera.json`.
//!
//! Poses are from world to camera by OpenCV's axes, in millimetres. The centre of the first pixel is (0, 0). Format: `bop_toolkit`,
//! "BOP datasets format".

use std::path::Path;

use anyhow::{Context, ensure};
use argus_scene::Intrinsics;
use glam::{DMat3, DMat4, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::bounded::Entries;
use super::shots::{Cameras, Format, Shot, camera_at, intrinsics_of, read_text};
use crate::args::{Axes, pose_of};

/// Millimetres of a metre.
const MM: f64 = 1000.0;
/// Where BOP's centre of the first pixel lies, by ours.
const PIXEL_CENTER: f64 = 0.5;

/// An image of `scene_camera.json`.
#[derive(Serialize, Deserialize)]
struct Raw {
    #[serde(rename = "cam_K")]
    matrix: Option<Vec<f64>>,
    #[serde(rename = "cam_R_w2c")]
    rotation: Option<Vec<f64>>,
    #[serde(rename = "cam_t_w2c")]
    translation: Option<Vec<f64>>,
    /// Millimetres of a step of the depth image.
    depth_scale: Option<f64>,
}

/// What is read of `camera.json`.
#[derive(Deserialize, Default)]
#[serde(default)]
struct Sensor {
    width: Option<u32>,
    height: Option<u32>,
    depth_scale: Option<f64>,
}

/// Reads `scene_camera.json`, and `camera.json` from its folder or one of the two above. `size` is that of images where there is none.
///
/// # Errors
/// A file that is none of these, with the image and the field at fault.
pub(super) fn read(path: &Path, size: Option<[u32; 2]>) -> anyhow::Result<Cameras> {
    let text = read_text(path)?;
    let Entries(images) =
        serde_json::from_str::<Entries<Raw>>(&text).context("it is no scene_camera.json")?;
    let sensor = sensor_of(path)?;
    let size = match (sensor.width, sensor.height, size) {
        (Some(width), Some(height), _) => [width, height],
        (_, _, Some(size)) => size,
        _ => anyhow::bail!(
            "the images' size is missing: put a camera.json with width and height beside it, or give --size"
        ),
    };
    let shot = |(key, raw): (String, Raw)| shot(&key, &raw, size, &sensor).context(format!("image {key:?}"));
    let shots = images.into_iter().map(shot).collect::<anyhow::Result<_>>()?;
    Cameras { format: Format::Bop, shots }.checked()
}

fn sensor_of(path: &Path) -> anyhow::Result<Sensor> {
    let folders = path.ancestors().skip(1).take(3);
    let Some(file) = folders.map(|folder| folder.join("camera.json")).find(|file| file.is_file()) else {
        return Ok(Sensor::default());
    };
    let text = read_text(&file)?;
    serde_json::from_str(&text).with_context(|| format!("{} is no camera.json", file.display()))
}

fn shot(key: &str, raw: &Raw, size: [u32; 2], sensor: &Sensor) -> anyhow::Result<Shot> {
    let id: u32 = key.parse().ok().context("its key must be the image's number")?;
    let numbers = |field: &str, given: &Option<Vec<f64>>, count: usize| {
        let given = given.as_ref().with_context(|| format!("{field} is missing"))?;
        ensure!(given.len() == count, "{field}: must be {count} numbers, not {}", given.len());
        Ok(given.clone())
    };
    let matrix = numbers("cam_K", &raw.matrix, 9).context("its intrinsics")?;
    let &[fx, skew, cx, zero, fy, cy, ref last @ ..] = &matrix[..] else { anyhow::bail!("cam_K") };
    ensure!(
        skew == 0.0 && zero == 0.0 && last == [0.0, 0.0, 1.0],
        "cam_K: must be fx 0 cx 0 fy cy 0 0 1, without skew"
    );
    let rotation = DMat3::from_cols_slice(&numbers("cam_R_w2c", &raw.rotation, 9)?).transpose();
    let translation = DVec3::from_slice(&numbers("cam_t_w2c", &raw.translation, 3)?) / MM;
    // Transposed, since the inverse of what is no rotation may not exist: then the pose is refused.
    let world_from_camera = rotation.transpose();
    let eye = world_from_camera * -translation;
    let pose = DMat4::from_cols(
        world_from_camera.x_axis.extend(0.0),
        world_from_camera.y_axis.extend(0.0),
        world_from_camera.z_axis.extend(0.0),
        eye.extend(1.0),
    );
    let lens = Intrinsics::pinhole(DVec2::new(fx, fy), DVec2::new(cx, cy) + PIXEL_CENTER);
    let camera = camera_at(pose, Axes::OpenCv, lens)?;
    let depth_unit = raw.depth_scale.or(sensor.depth_scale).map(|scale| scale / MM);
    Ok(Shot { name: format!("{id:06}.png"), id, camera, size, depth_unit })
}

/// The texts of `scene_camera.json` and `camera.json`. Depth images have steps of `depth_unit` metres.
///
/// # Errors
/// A camera without intrinsics.
pub(super) fn write(cameras: &Cameras, depth_unit: f64) -> anyhow::Result<Vec<(&'static str, Vec<u8>)>> {
    let depth_scale = depth_unit * MM;
    let mut images = Map::new();
    for shot in &cameras.shots {
        let Intrinsics { focal, center, .. } = intrinsics_of(&shot.camera)?;
        let (center, camera_from_world) =
            (center - PIXEL_CENTER, pose_of(&shot.camera, Axes::OpenCv).inverse());
        // Row by row, as BOP has them.
        let rotation = DMat3::from_mat4(camera_from_world).transpose().to_cols_array();
        let translation = camera_from_world.w_axis.truncate() * MM;
        let raw = Raw {
            matrix: Some(vec![focal.x, 0.0, center.x, 0.0, focal.y, center.y, 0.0, 0.0, 1.0]),
            rotation: Some(rotation.to_vec()),
            translation: Some(translation.to_array().to_vec()),
            depth_scale: Some(depth_scale),
        };
        images.insert(shot.id.to_string(), serde_json::to_value(raw)?);
    }
    let first = cameras.shots.first().context("no images")?;
    let Intrinsics { focal, center, .. } = intrinsics_of(&first.camera)?;
    let center = center - PIXEL_CENTER;
    let [width, height] = first.size;
    let sensor = json!({
        "fx": focal.x, "fy": focal.y, "cx": center.x, "cy": center.y,
        "width": width, "height": height, "depth_scale": depth_scale,
    });
    let pretty = |value: &Value| {
        Ok::<_, serde_json::Error>((serde_json::to_string_pretty(value)? + "\n").into_bytes())
    };
    Ok(vec![("scene_camera.json", pretty(&Value::Object(images))?), ("camera.json", pretty(&sensor)?)])
}

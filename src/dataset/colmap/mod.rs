//! Models of COLMAP: the files `cameras` and `images`, as text or binary.
//!
//! Poses are from world to camera by OpenCV's axes, and the centre of the first pixel is (½, ½). Points are not read, and none are
//! written. Format: COLMAP's documentation, "Output Format".

mod binary;
mod records;
mod text;

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, ensure};
use glam::DMat4;

use self::records::{Image, Sensor};
use super::model::Calibration;
use super::shots::{Cameras, Format, Shot, camera_at, image_name, intrinsics_of, read, read_text};
use crate::args::{Axes, pose_of};

/// Reads a model from its folder.
///
/// # Errors
/// A file that cannot be read, or with the line or image that is at fault.
pub(super) fn read_folder(folder: &Path, format: Format) -> anyhow::Result<Cameras> {
    let is_text = format == Format::ColmapText;
    let ending = if is_text { "txt" } else { "bin" };
    let at = |name: &str| folder.join(format!("{name}.{ending}"));
    let (sensors, images) = if is_text {
        (text::sensors(&read_text(&at("cameras"))?), text::images(&read_text(&at("images"))?))
    } else {
        (binary::sensors(&read(&at("cameras"))?), binary::images(&read(&at("images"))?))
    };
    let sensors = sensors.with_context(|| format!("cameras.{ending}"))?;
    let sensors: HashMap<u32, Sensor> = sensors.into_iter().map(|sensor| (sensor.id, sensor)).collect();
    let shot = |image: Image| {
        let within = format!("images.{ending}: image {}", image.id);
        shot(image, &sensors).context(within)
    };
    let images = images.with_context(|| format!("images.{ending}"))?;
    let shots = images.into_iter().map(shot).collect::<anyhow::Result<_>>()?;
    Cameras { format, shots }.checked()
}

fn shot(image: Image, sensors: &HashMap<u32, Sensor>) -> anyhow::Result<Shot> {
    let Image { id, rotation, translation, sensor: number, name } = image;
    let sensor = sensors
        .get(&number)
        .with_context(|| format!("its intrinsics are missing: the file of cameras has no camera {number}"))?;
    // Written so that NaN is refused.
    ensure!(
        rotation.length() > 1e-6 && rotation.is_finite() && translation.is_finite(),
        "its rotation must be a quaternion with a length above 0, and its numbers finite"
    );
    let camera_from_world = DMat4::from_rotation_translation(rotation.normalize(), translation);
    let camera = camera_at(camera_from_world.inverse(), Axes::OpenCv, sensor.lens)?;
    Ok(Shot { name: image_name(&name)?, id, camera, size: sensor.size, depth_unit: None })
}

/// The files of a model, by name.
///
/// # Errors
/// A camera without intrinsics.
pub(super) fn write(cameras: &Cameras) -> anyhow::Result<Vec<(&'static str, Vec<u8>)>> {
    let (mut numbers, mut sensors, mut images) = (HashMap::new(), Vec::new(), Vec::new());
    for shot in &cameras.shots {
        let lens = intrinsics_of(&shot.camera)?;
        let Calibration { model, parameters } = Calibration::of(&lens);
        let bits: Vec<u64> = parameters.iter().map(|number| number.to_bits()).collect();
        let next = sensors.len() as u32 + 1;
        let sensor = *numbers.entry((model.number(), shot.size, bits)).or_insert_with(|| {
            sensors.push(Sensor { id: next, size: shot.size, lens });
            next
        });
        let camera_from_world = pose_of(&shot.camera, Axes::OpenCv).inverse();
        let (_, rotation, translation) = camera_from_world.to_scale_rotation_translation();
        images.push(Image { id: shot.id, rotation, translation, sensor, name: shot.name.clone() });
    }
    Ok(match cameras.format {
        Format::ColmapBinary => vec![
            ("cameras.bin", binary::write_sensors(&sensors)),
            ("images.bin", binary::write_images(&images)),
            ("points3D.bin", 0u64.to_le_bytes().to_vec()),
        ],
        _ => vec![
            ("cameras.txt", text::write_sensors(&sensors).into_bytes()),
            ("images.txt", text::write_images(&images).into_bytes()),
            ("points3D.txt", b"# No points\n".to_vec()),
        ],
    })
}

//! The text files of a model.

use std::fmt::Write as _;
use std::str::FromStr;

use anyhow::{Context, ensure};
use glam::{DQuat, DVec3};

use super::super::model::{Calibration, Model};
use super::super::shots::check_count;
use super::records::{Image, Sensor, side};

/// Reads `cameras.txt`.
pub(super) fn sensors(text: &str) -> anyhow::Result<Vec<Sensor>> {
    let mut sensors = Vec::new();
    for (line, words) in text.lines().enumerate().filter(|(_, line)| holds_data(line)) {
        sensors.push(sensor(words).with_context(|| format!("line {}", line + 1))?);
        check_count(sensors.len())?;
    }
    Ok(sensors)
}

fn sensor(line: &str) -> anyhow::Result<Sensor> {
    let words: Vec<&str> = line.split_whitespace().collect();
    ensure!(words.len() >= 5, "must be CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS");
    let parameters: Vec<f64> =
        words[4..].iter().map(|word| number(word, "a parameter")).collect::<anyhow::Result<_>>()?;
    let size = [side(number(words[2], "WIDTH")?)?, side(number(words[3], "HEIGHT")?)?];
    Ok(Sensor {
        id: number(words[0], "CAMERA_ID")?,
        size,
        lens: Model::named(words[1])?.intrinsics(&parameters)?,
    })
}

/// Reads `images.txt`: two lines an image, of which the second, its points, may be empty.
pub(super) fn images(text: &str) -> anyhow::Result<Vec<Image>> {
    let mut images = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((at, line)) = lines.next() {
        if holds_data(line) {
            images.push(image(line).with_context(|| format!("line {}", at + 1))?);
            check_count(images.len())?;
            lines.next();
        }
    }
    Ok(images)
}

fn image(line: &str) -> anyhow::Result<Image> {
    let mut rest = line.trim();
    let mut word = || {
        let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
        rest = after.trim_start();
        word
    };
    let words: [&str; 9] = std::array::from_fn(|_| word());
    ensure!(!rest.is_empty(), "must be IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
    let float = |at: usize, name: &str| number::<f64>(words[at], name);
    let (w, x, y, z) = (float(1, "QW")?, float(2, "QX")?, float(3, "QY")?, float(4, "QZ")?);
    Ok(Image {
        id: number(words[0], "IMAGE_ID")?,
        rotation: DQuat::from_xyzw(x, y, z, w),
        translation: DVec3::new(float(5, "TX")?, float(6, "TY")?, float(7, "TZ")?),
        sensor: number(words[8], "CAMERA_ID")?,
        name: rest.to_owned(),
    })
}

fn holds_data(line: &str) -> bool {
    let line = line.trim();
    !line.is_empty() && !line.starts_with('#')
}

fn number<T: FromStr>(word: &str, field: &str) -> anyhow::Result<T> {
    word.parse().ok().with_context(|| format!("{field}: must be a number, not {word:?}"))
}

/// The text of `cameras.txt`.
pub(super) fn write_sensors(sensors: &[Sensor]) -> String {
    let mut text = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS\n".to_owned();
    for Sensor { id, size: [width, height], lens } in sensors {
        let Calibration { model, parameters } = Calibration::of(lens);
        let _ = write!(text, "{id} {} {width} {height}", model.name());
        for parameter in parameters {
            let _ = write!(text, " {parameter}");
        }
        text.push('\n');
    }
    text
}

/// The text of `images.txt`.
pub(super) fn write_images(images: &[Image]) -> String {
    let mut text =
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n# then a line of points, here empty\n".to_owned();
    for Image { id, rotation: q, translation: t, sensor, name } in images {
        let _ =
            writeln!(text, "{id} {} {} {} {} {} {} {} {sensor} {name}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z);
    }
    text
}

//! Images of a data set: their names, cameras and sizes.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, bail, ensure};
use argus_scene::{Camera, Intrinsics, Lens};
use glam::DMat4;

use crate::args::{Axes, placed};

/// Most images of a data set.
pub(super) const MOST_SHOTS: usize = 100_000;
/// Most bytes of a file of cameras.
pub(super) const MOST_BYTES: u64 = 1 << 30;
/// Most bytes of an image's name.
const MOST_NAME: usize = 240;
/// Endings of names of images. Images are written as PNG, so these become `.png`.
const ENDINGS: [&str; 9] = ["png", "jpg", "jpeg", "bmp", "tif", "tiff", "exr", "webp", "ppm"];

/// How a file describes cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    /// NeRF's `transforms.json`.
    Transforms,
    /// A model of COLMAP, as text.
    ColmapText,
    /// A model of COLMAP, in binary files.
    ColmapBinary,
    /// BOP's `scene_camera.json`.
    Bop,
}

impl Format {
    /// The name for users.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Transforms => "transforms.json",
            Self::ColmapText => "COLMAP (text)",
            Self::ColmapBinary => "COLMAP (binary)",
            Self::Bop => "BOP",
        }
    }
}

/// An image of a data set.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shot {
    /// Path of its colours below the data set's folder of images: components with `/` between, the last with `.png`.
    pub(super) name: String,
    /// Its number in the format: COLMAP's image id, BOP's image id, or its place in the list.
    pub(super) id: u32,
    /// Its camera; always with intrinsics.
    pub(super) camera: Camera,
    /// Width and height in pixels.
    pub(super) size: [u32; 2],
    /// Metres of a step of its depth image, if the file says so.
    pub(super) depth_unit: Option<f64>,
}

/// The images that a file describes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cameras {
    /// How the file describes them, and how they are written.
    pub(super) format: Format,
    /// The images, in the order of the file.
    pub(super) shots: Vec<Shot>,
}

impl Cameras {
    /// Checks what holds of all formats.
    ///
    /// # Errors
    /// No image, too many, or two of one name.
    pub(super) fn checked(self) -> anyhow::Result<Self> {
        ensure!(!self.shots.is_empty(), "it has no image: it must name at least one");
        check_count(self.shots.len())?;
        let mut names = BTreeSet::new();
        for shot in &self.shots {
            ensure!(names.insert(&shot.name), "two images would be written to {}: rename one", shot.name);
        }
        Ok(self)
    }
}

/// Checks a number of images.
///
/// # Errors
/// There are too many.
pub(super) fn check_count(count: usize) -> anyhow::Result<()> {
    ensure!(
        count <= MOST_SHOTS,
        "it has more than {MOST_SHOTS} images: split it into several files, each with its own --out"
    );
    Ok(())
}

/// A camera of intrinsics at a pose (camera to world).
///
/// # Errors
/// The pose is no rigid motion, or the camera has no image.
pub(super) fn camera_at(pose: DMat4, axes: Axes, intrinsics: Intrinsics) -> anyhow::Result<Camera> {
    let usual = Camera::look_at(glam::DVec3::ZERO, glam::DVec3::Z);
    let placed = placed(pose, axes, usual).map_err(|reason| anyhow::anyhow!("its pose: {reason}"))?;
    let camera = Camera { lens: Some(Lens::Intrinsics(intrinsics)), ..placed };
    camera.validate()?;
    Ok(camera)
}

/// The intrinsics of a shot's camera.
///
/// # Errors
/// The camera has another lens, which no file of cameras describes.
pub(super) fn intrinsics_of(camera: &Camera) -> anyhow::Result<Intrinsics> {
    match camera.lens {
        Some(Lens::Intrinsics(intrinsics)) => Ok(intrinsics),
        _ => bail!("the camera has no intrinsics"),
    }
}

/// The name of an image by the path that a file gives it.
///
/// # Errors
/// A path that would leave the folder it is written to, or that no file can have.
pub(super) fn image_name(path: &str) -> anyhow::Result<String> {
    let refused = |reason: &str| anyhow::anyhow!("the image name {path:?} {reason}");
    let path_with_slashes = path.replace('\\', "/");
    let is_absolute =
        path_with_slashes.starts_with('/') || path_with_slashes.chars().nth(1).is_some_and(|c| c == ':');
    if is_absolute {
        return Err(refused("is absolute: names must stay within --out"));
    }
    let parts: Vec<&str> =
        path_with_slashes.split('/').filter(|part| !part.is_empty() && *part != ".").collect();
    if parts.contains(&"..") {
        return Err(refused("would leave --out: it must not contain `..`"));
    }
    if path.chars().any(char::is_control) || path.len() > MOST_NAME {
        return Err(refused("must have no control characters and at most 240 bytes"));
    }
    let Some((last, folders)) = parts.split_last() else { return Err(refused("is empty")) };
    let stem = match last.rsplit_once('.') {
        Some((stem, ending))
            if !stem.is_empty() && ENDINGS.iter().any(|e| ending.eq_ignore_ascii_case(e)) =>
        {
            stem
        }
        _ => last,
    };
    let stem = format!("{stem}.png");
    Ok(folders.iter().copied().chain([stem.as_str()]).collect::<Vec<_>>().join("/"))
}

/// Reads a file of cameras as bytes.
///
/// # Errors
/// The file cannot be read, or is too large.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    let within = || format!("cannot read {}", path.display());
    let bytes = std::fs::metadata(path).with_context(within)?.len();
    ensure!(bytes <= MOST_BYTES, "{} has {bytes} bytes, more than {MOST_BYTES}: split it", path.display());
    std::fs::read(path).with_context(within)
}

/// Reads a file of cameras as text.
///
/// # Errors
/// The file cannot be read, is too large, or is no UTF-8.
pub(super) fn read_text(path: &Path) -> anyhow::Result<String> {
    String::from_utf8(read(path)?).with_context(|| format!("{} is no text in UTF-8", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_within_the_folder_and_end_in_png() {
        for (path, name) in [
            ("./images/0001.JPG", "images/0001.png"),
            ("train/r_0", "train/r_0.png"),
            ("a\\b.png", "a/b.png"),
            ("r_0.5", "r_0.5.png"),
            (".png", ".png.png"),
        ] {
            assert_eq!(image_name(path).unwrap(), name);
        }
        for (path, word) in [
            ("../x", "leave --out"),
            ("a/../../x.png", "leave --out"),
            ("a\\..\\x.png", "leave --out"),
            ("/etc/x.png", "absolute"),
            ("C:\\x.png", "absolute"),
            ("", "empty"),
            ("./", "empty"),
            ("a\0b", "control"),
            (&"x".repeat(300), "240"),
        ] {
            let error = image_name(path).unwrap_err().to_string();
            assert!(error.contains(word), "{path:?}: {error}");
        }
    }
}

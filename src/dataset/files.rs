//! Image files of a frame, where each format has them.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context;
use argus_scene::{Frame, Output, Outputs};
use serde::{Deserialize, Serialize};

use super::shots::{Cameras, Format, Shot};
use crate::output;
use crate::view::images;

/// Where files of a data set are, and the unit of its depth images.
#[derive(Debug, Clone)]
pub(super) struct Writer {
    pub(super) format: Format,
    pub(super) out: PathBuf,
    pub(super) outputs: Outputs,
    /// Metres of a step of a depth image of 16 bits.
    pub(super) depth_unit: f64,
}

/// The files of a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Written {
    /// BLAKE3 of each file, hexadecimal, by its path below the folder of the data set.
    pub(super) files: BTreeMap<String, String>,
    /// Pixels whose depth is beyond what 16 bits hold; written as 0, which stands for none.
    pub(super) beyond: u64,
}

/// The path of an output's file below the folder of the data set.
pub(super) fn relative_path(format: Format, output: Output, shot: &Shot) -> String {
    let name = shot.name.as_str();
    let below = name.strip_prefix("images/").unwrap_or(name);
    match (format, output) {
        (Format::Transforms, Output::Color) => name.to_owned(),
        (Format::ColmapText | Format::ColmapBinary, Output::Color) => format!("images/{name}"),
        (Format::Bop, Output::Color) => format!("rgb/{name}"),
        (Format::ColmapText | Format::ColmapBinary, Output::Depth) => {
            format!("stereo/depth_maps/{name}.geometric.bin")
        }
        (_, Output::Depth) => format!("depth/{below}"),
        (_, output) => {
            let stem = below.strip_suffix("png").unwrap_or(below);
            format!("{}/{stem}{}", output.name(), images::ending(output))
        }
    }
}

/// Checks that no two images would be written to one file.
///
/// # Errors
/// Two would: the file's name.
pub(super) fn check_paths(cameras: &Cameras, outputs: Outputs) -> anyhow::Result<()> {
    let mut paths = std::collections::HashSet::new();
    for shot in &cameras.shots {
        for output in outputs.iter() {
            let path = relative_path(cameras.format, output, shot);
            anyhow::ensure!(!paths.contains(&path), "two images would be written to {path}: rename one");
            paths.insert(path);
        }
    }
    Ok(())
}

impl Writer {
    /// Writes the images of a frame.
    ///
    /// # Errors
    /// A file cannot be written, or the frame lacks an image.
    pub(super) fn write(&self, shot: &Shot, frame: &Frame) -> anyhow::Result<Written> {
        let mut written = Written { files: BTreeMap::new(), beyond: 0 };
        for output in self.outputs.iter() {
            let relative = relative_path(self.format, output, shot);
            let path = self.out.join(&relative);
            match (self.format, output) {
                (Format::ColmapText | Format::ColmapBinary, Output::Depth) => write_depth_map(&path, frame)?,
                (_, Output::Depth) => written.beyond += write_depth_png(&path, frame, self.depth_unit)?,
                _ => images::write(&path, output, frame)?,
            }
            written.files.insert(relative, digest(&path)?);
        }
        Ok(written)
    }

    /// Whether the files are there as they were written.
    pub(super) fn is_intact(&self, written: &Written) -> bool {
        let same = |(path, was): (&String, &String)| digest(&self.out.join(path)).is_ok_and(|is| is == *was);
        written.files.iter().all(same)
    }
}

fn digest(path: &Path) -> anyhow::Result<String> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}

/// Writes a file of the data set's own as a whole or not at all.
///
/// # Errors
/// The file cannot be written.
pub(super) fn save(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let write = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let temporary = path.with_extension("part");
        std::fs::File::create(&temporary)?.write_all(bytes)?;
        std::fs::rename(&temporary, path)
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}

fn depths(frame: &Frame) -> anyhow::Result<impl Iterator<Item = f32>> {
    let image = frame.images[Output::Depth].as_ref().context("the frame lacks its depth")?;
    Ok(image.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)))
}

/// Writes depth in whole steps of `unit` metres; 0 where nothing is. Returns the number of pixels beyond the last step.
fn write_depth_png(path: &Path, frame: &Frame, unit: f64) -> anyhow::Result<u64> {
    let mut beyond = 0;
    let steps = depths(frame)?.map(|depth| {
        let steps = (f64::from(depth) / unit).round();
        if steps <= f64::from(u16::MAX) {
            return steps as u16;
        }
        beyond += u64::from(depth.is_finite());
        0
    });
    let steps: Vec<u16> = steps.collect();
    output::write_gray16_png(path, frame.width, frame.height, &steps)?;
    Ok(beyond)
}

/// Writes depth as COLMAP's depth maps: width, height and channels as text, then floats; 0 where nothing is.
fn write_depth_map(path: &Path, frame: &Frame) -> anyhow::Result<()> {
    let mut bytes = format!("{}&{}&1&", frame.width, frame.height).into_bytes();
    let finite = depths(frame)?.map(|depth| if depth.is_finite() { depth } else { 0.0 });
    bytes.extend(finite.flat_map(f32::to_le_bytes));
    save(path, &bytes)
}

#[cfg(test)]
mod tests {
    use argus_scene::{Images, Plan, Provenance, SceneHash, SceneState};
    use glam::DVec3;

    use super::*;

    fn shot(name: &str) -> Shot {
        let camera = argus_scene::Camera::look_at(DVec3::ZERO, DVec3::Z);
        Shot { name: name.to_owned(), id: 0, camera, size: [2, 2], depth_unit: None }
    }

    fn frame(depth: [f32; 4]) -> Frame {
        let provenance = Provenance::of_plan(SceneHash([7; 32]), SceneState::default(), Plan::direct(1));
        let bytes: Vec<u8> = depth.iter().flat_map(|depth| depth.to_le_bytes()).collect();
        let images = Images::from([(Output::Depth, bytes.into())]);
        Frame { images, ..Frame::without_images(2, 2, provenance) }
    }

    fn writer(format: Format, out: &Path) -> Writer {
        Writer { format, out: out.to_owned(), outputs: Outputs::only(Output::Depth), depth_unit: 0.001 }
    }

    #[test]
    fn depth_is_in_the_units_of_each_format_and_zero_stands_for_none() {
        let folder = tempfile::tempdir().unwrap();
        let frame = frame([1.2345, f32::INFINITY, 70.0, 65.535]);
        let written = writer(Format::Bop, folder.path()).write(&shot("a.png"), &frame).unwrap();
        assert_eq!(written.beyond, 1);
        let image = image::open(folder.path().join("depth/a.png")).unwrap().into_luma16();
        assert_eq!(image.as_raw(), &[1235, 0, 0, 65535]);
        writer(Format::ColmapText, folder.path()).write(&shot("a.png"), &frame).unwrap();
        let map = std::fs::read(folder.path().join("stereo/depth_maps/a.png.geometric.bin")).unwrap();
        let floats = map.strip_prefix(b"2&2&1&").unwrap().as_chunks::<4>().0;
        let floats: Vec<f32> = floats.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        assert_eq!(floats, [1.2345, 0.0, 70.0, 65.535]);
    }

    #[test]
    fn a_changed_or_missing_file_is_not_intact() {
        let folder = tempfile::tempdir().unwrap();
        let writer = writer(Format::Transforms, folder.path());
        let written = writer.write(&shot("images/a.png"), &frame([1.0; 4])).unwrap();
        assert!(writer.is_intact(&written));
        let file = folder.path().join("depth/a.png");
        let mut bytes = std::fs::read(&file).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(&file, &bytes).unwrap();
        assert!(!writer.is_intact(&written));
        std::fs::remove_file(&file).unwrap();
        assert!(!writer.is_intact(&written));
    }

    #[test]
    fn two_outputs_of_one_path_are_refused() {
        let shots = vec![shot("images/a.png"), shot("depth/a.png")];
        let cameras = Cameras { format: Format::Transforms, shots };
        check_paths(&cameras, Outputs::COLOR).unwrap();
        let error = check_paths(&cameras, Outputs::COLOR.with(Output::Depth)).unwrap_err();
        assert!(error.to_string().contains("depth/a.png"), "{error}");
    }
}

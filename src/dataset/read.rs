//! Finds out how a file describes cameras, and reads it.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::shots::{Cameras, Format, read_text};
use super::{bop, colmap, transforms};

/// Names that are looked for in a folder, in this order.
const NAMES: [&str; 4] = ["transforms.json", "scene_camera.json", "cameras.bin", "cameras.txt"];
/// Folders of a data set where a model of COLMAP is looked for.
const MODELS: [&str; 3] = ["", "sparse", "sparse/0"];

/// Reads the cameras of a file or a folder. `size` is that of images of which the file says none.
///
/// # Errors
/// No file of cameras, or one that is malformed: the file, the image and the field at fault.
pub(super) fn cameras(path: &Path, size: Option<[u32; 2]>) -> anyhow::Result<Cameras> {
    let file = file_of(path)?;
    let folder = file.parent().unwrap_or(Path::new(""));
    let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    match ending {
        "txt" => colmap::read_folder(folder, Format::ColmapText),
        "bin" => colmap::read_folder(folder, Format::ColmapBinary),
        "json" if file.file_name().is_some_and(|name| name == "scene_camera.json") => bop::read(&file, size),
        "json" => transforms::read(&read_text(&file)?, size),
        _ => bail!(
            "must be a transforms.json of NeRF, a scene_camera.json of BOP, or a folder with cameras and images of COLMAP \
             (.txt or .bin)"
        ),
    }
}

fn file_of(path: &Path) -> anyhow::Result<PathBuf> {
    std::fs::metadata(path).context("cannot be read")?;
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let found = MODELS.iter().flat_map(|model| NAMES.map(|name| path.join(model).join(name)));
    let mut found = found.filter(|file| file.is_file());
    found.next().with_context(|| format!("the folder has none of {}", NAMES.join(", ")))
}

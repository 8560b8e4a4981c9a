//! Calibrated models that are kept on this machine.

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use argus_cluster::core::quality::Model;
use argus_scene::reference::cache;
use argus_scene::{Rig, SceneHash};

/// The folder of saved models, beside the reference images.
pub fn directory() -> Option<PathBuf> {
    cache::directory().map(|cache| cache.join("models"))
}

/// Saved models for a scene and rig, for any device. Files that are not a model are skipped.
pub fn kept(scene: SceneHash, rig: &Rig) -> Vec<Model> {
    let entries = directory().and_then(|folder| std::fs::read_dir(folder).ok()).into_iter().flatten();
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.retain(|path| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&scene.to_string()))
    });
    paths.sort();
    let read = |path: PathBuf| serde_json::from_slice::<Model>(&std::fs::read(path).ok()?).ok();
    paths.into_iter().filter_map(read).filter(|model| model.fits(scene, rig)).collect()
}

/// Saves a model. Returns the file's path.
///
/// # Errors
/// There is no cache folder, or it cannot be written to.
pub fn keep(model: &Model) -> Result<PathBuf> {
    let folder = directory().context("there is no cache folder: set ARGUS_CACHE")?;
    std::fs::create_dir_all(&folder)?;
    let path = folder.join(model.file_name());
    // Written to a temporary file and renamed, so that readers never see half a model.
    let partial = folder.join(format!("{}.{}", model.file_name(), std::process::id()));
    std::fs::write(&partial, serde_json::to_vec(model)?)?;
    std::fs::rename(&partial, &path)?;
    Ok(path)
}

//! The scene that a coordinator serves, and its files.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use argus_cluster::SceneSource;
use argus_sampler::PacketSight;
use argus_scene::rig::Sight;
use argus_scene::{LoadError, Metering, Scene, load};

/// The folder of a bundle that holds the environment map alone. Scenes name no files in it.
const ENVIRONMENT: &str = ".environment";

/// The name in a bundle of an environment map: its folder and the file's own name.
pub(super) fn environment_name(file: &str) -> Option<String> {
    let name = Path::new(file).file_name()?.to_str()?;
    Some(format!("{ENVIRONMENT}/{name}"))
}

/// An open scene.
pub(crate) struct OpenScene {
    scene: Arc<Scene>,
    /// Built when it is first needed.
    sight: OnceLock<Arc<PacketSight>>,
}

impl OpenScene {
    /// Opens a file or generates a scene, which may take long.
    pub(crate) fn open(spec: &str) -> Result<Self, LoadError> {
        Ok(Self { scene: Arc::new(argus_scene::open(spec)?), sight: OnceLock::new() })
    }

    /// The name given by the user.
    pub(crate) fn name(&self) -> &str {
        &self.scene.name
    }

    fn packets(&self) -> &Arc<PacketSight> {
        self.sight.get_or_init(|| Arc::new(PacketSight::new(&self.scene)))
    }

    /// Logs the scene's size and the loader's warnings.
    pub(crate) fn report(&self) {
        tracing::info!("{}: {} triangles", self.scene.name, self.scene.triangles());
        for warning in &self.scene.warnings {
            tracing::warn!("{}: {warning}", self.scene.name);
        }
    }
}

impl SceneSource for OpenScene {
    fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    fn sight(&self) -> Option<Arc<dyn Sight>> {
        Some(self.packets().clone())
    }

    fn metered(&self, metering: Metering) -> Option<f64> {
        self.packets().metered(metering)
    }

    fn procedural(&self) -> Option<String> {
        argus_scene::is_procedural(&self.scene.name).then(|| self.scene.name.clone())
    }

    fn files(&self) -> Result<Vec<(String, PathBuf)>, String> {
        if self.procedural().is_some() {
            return Ok(Vec::new());
        }
        let (alone, environment) = argus_scene::split_environment(&self.scene.name);
        let mut files = Vec::new();
        if !argus_scene::is_procedural(alone) {
            let path = Path::new(argus_scene::base_of(alone));
            files = load::bundle_files(path).map_err(|error| error.to_string())?;
            // The file to open comes first; the rest keep their order.
            files.sort_by_key(|(name, _)| path.file_name() != Some(OsStr::new(name)));
        }
        if let Some(file) = environment {
            let name = environment_name(file).ok_or_else(|| format!("{file}: is not the name of a file"))?;
            files.push((name, PathBuf::from(file)));
        }
        Ok(files)
    }
}

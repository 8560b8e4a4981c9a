//! The scene that a coordinator serves, and its files.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use argus_cluster::SceneSource;
use argus_sampler::PacketSight;
use argus_scene::rig::VisibilityQuery;
use argus_scene::{LightRequest, LoadError, Metering, Scene, load};

/// The folder of a bundle that holds the environment map alone. Scenes name no files in it.
const ENVIRONMENT: &str = ".environment";

/// The name in a bundle of an environment map: its folder and the file's own name.
pub(super) fn environment_name(file: &str) -> Option<String> {
    let name = Path::new(file).file_name()?.to_str()?;
    Some(format!("{ENVIRONMENT}/{name}"))
}

/// An open scene, in the light that it is served in.
pub(crate) struct OpenScene {
    /// The scene and its triangles.
    sight: Arc<PacketSight>,
    /// The light and why it was chosen.
    light: String,
    /// What was metered when the light was chosen.
    metered: (Metering, Option<f64>),
}

impl OpenScene {
    /// Opens a file or generates a scene, and chooses its light for this metering. May take long.
    ///
    /// A generated scene keeps the light that it is generated with, unless sun and sky or the light of interiors is asked for.
    pub(crate) fn open(spec: &str, light: LightRequest, metering: Metering) -> Result<Self, LoadError> {
        let sight = PacketSight::new(&Arc::new(argus_scene::open(spec)?));
        let is_generated = argus_scene::is_procedural(spec);
        if is_generated && matches!(light, LightRequest::Auto | LightRequest::File) {
            let metered = (metering, sight.metered(metering));
            let light = format!("{}: it is generated with this light", sight.scene().opened_light());
            return Ok(Self { light, metered, sight: Arc::new(sight) });
        }
        let resolved = sight.resolve_light(light, metering);
        let light = format!("{}: {}", resolved.choice, resolved.reason);
        let metered = (metering, resolved.metered);
        Ok(Self { light, metered, sight: Arc::new(sight.in_light(resolved.choice)) })
    }

    /// The light and why it was chosen, in one line.
    pub(crate) fn light(&self) -> &str {
        &self.light
    }

    /// The name given by the user.
    pub(crate) fn name(&self) -> &str {
        &self.scene().name
    }

    /// Logs the scene's size, its light and the loader's warnings.
    pub(crate) fn report(&self) {
        let scene = self.scene();
        tracing::info!("{}: {} triangles, light: {}", scene.name, scene.triangles(), self.light);
        for warning in &scene.warnings {
            tracing::warn!("{}: {warning}", scene.name);
        }
    }
}

impl SceneSource for OpenScene {
    fn scene(&self) -> &Arc<Scene> {
        self.sight.scene()
    }

    fn sight(&self) -> Option<Arc<dyn VisibilityQuery>> {
        Some(self.sight.clone())
    }

    fn metered(&self, metering: Metering) -> Option<f64> {
        match self.metered {
            (known, metered) if known == metering => metered,
            _ => self.sight.metered(metering),
        }
    }

    fn light(&self) -> Option<String> {
        Some(self.light.clone())
    }

    fn procedural(&self) -> Option<String> {
        argus_scene::is_procedural(self.name()).then(|| self.name().to_owned())
    }

    fn files(&self) -> Result<Vec<(String, PathBuf)>, String> {
        if self.procedural().is_some() {
            return Ok(Vec::new());
        }
        let (alone, environment) = argus_scene::split_environment(self.name());
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

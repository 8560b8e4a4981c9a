//! The scene that a coordinator serves, and its files.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use argus_cluster::SceneSource;
use argus_sampler::PacketSight;
use argus_scene::rig::Sight;
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
    scene: Arc<Scene>,
    /// The light and why it was chosen.
    light: String,
    /// What was metered when the light was chosen.
    metered: (Metering, Option<f64>),
    /// Built when it is first needed.
    sight: OnceLock<Arc<PacketSight>>,
}

impl OpenScene {
    /// Opens a file or generates a scene, and chooses its light for this metering. May take long.
    ///
    /// A generated scene keeps the light that it is generated with, unless sun and sky or the light of interiors is asked for.
    pub(crate) fn open(spec: &str, light: LightRequest, metering: Metering) -> Result<Self, LoadError> {
        let scene = Arc::new(argus_scene::open(spec)?);
        let is_generated = argus_scene::is_procedural(spec);
        let packets = Arc::new(PacketSight::new(&scene));
        if is_generated && matches!(light, LightRequest::Auto | LightRequest::File) {
            let metered = (metering, packets.metered(metering));
            let light = format!("{}: it is generated with this light", scene.opened_light());
            return Ok(Self { scene, light, metered, sight: OnceLock::from(packets) });
        }
        let resolved = packets.resolve_light(light, metering);
        let light = format!("{}: {}", resolved.choice, resolved.reason);
        let metered = (metering, resolved.metered);
        if resolved.choice == scene.opened_light() {
            return Ok(Self { scene, light, metered, sight: OnceLock::from(packets) });
        }
        // Without a second copy of the scene, which rays would keep.
        drop(packets);
        let scene = Arc::new(Arc::unwrap_or_clone(scene).in_light(resolved.choice));
        Ok(Self { scene, light, metered, sight: OnceLock::new() })
    }

    /// The light and why it was chosen, in one line.
    pub(crate) fn light(&self) -> &str {
        &self.light
    }

    /// The name given by the user.
    pub(crate) fn name(&self) -> &str {
        &self.scene.name
    }

    fn packets(&self) -> &Arc<PacketSight> {
        self.sight.get_or_init(|| Arc::new(PacketSight::new(&self.scene)))
    }

    /// Logs the scene's size, its light and the loader's warnings.
    pub(crate) fn report(&self) {
        tracing::info!("{}: {} triangles, light: {}", self.scene.name, self.scene.triangles(), self.light);
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
        match self.metered {
            (known, metered) if known == metering => metered,
            _ => self.packets().metered(metering),
        }
    }

    fn light(&self) -> Option<String> {
        Some(self.light.clone())
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

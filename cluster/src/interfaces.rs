//! Interfaces that the binary implements, so that the cluster depends neither on scene loaders nor on a GPU.

use std::path::PathBuf;
use std::sync::Arc;

use argus_scene::rig::VisibilityQuery;
use argus_scene::{Compositor, Metering, RenderError, SampleSetInfo, Sampler, Scene, SceneHash};
use bytes::Bytes;

/// A reference to a scene, by name and content.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneRef {
    /// The user's name of it: a file's path or `terrain:500000`.
    pub name: String,
    /// A hash over all files of its bundle, or over a generated scene's name and version.
    pub hash: SceneHash,
}

/// One fetched file of a scene's bundle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneFile {
    /// Path relative to the bundle's root, with `/` between parts and without `..`; checked on arrival.
    pub name: String,
    /// Its contents.
    pub bytes: Bytes,
}

/// The scene that a coordinator serves, and its source.
pub trait SceneSource: Send + Sync + 'static {
    /// The scene.
    fn scene(&self) -> &Arc<Scene>;

    /// The specification that generates the scene on any machine, such as `terrain:500000`; `None` if it was loaded
    /// from files.
    fn procedural(&self) -> Option<String>;

    /// The files of the scene's bundle, the root file first: (name within the bundle, path on this machine). Empty
    /// for a generated scene. Called once per fetch.
    ///
    /// # Errors
    /// Why the list cannot be made, in one line.
    fn files(&self) -> Result<Vec<(String, PathBuf)>, String>;

    /// Ray queries into the scene, by which views are planned. Called once, on a blocking thread, and may take long.
    /// `None`: views are planned by distance.
    fn sight(&self) -> Option<Arc<dyn VisibilityQuery>> {
        None
    }

    /// The light that the scene is shown in and why, in one line; `None` if nothing was chosen.
    fn light(&self) -> Option<String> {
        None
    }

    /// Mean light at visible surfaces, for [`argus_scene::Exposure::factor`]. Called once, on a blocking thread. `None`: no
    /// light arrives, or the scene cannot be metered.
    fn metered(&self, _metering: Metering) -> Option<f64> {
        None
    }
}

/// Opens scenes for a worker. Called on blocking threads; may take long.
pub trait SceneOpener: Send + Sync + 'static {
    /// Opens the scene from this machine: from files found by its name, or from a cache. `Ok(None)` if there is
    /// nothing with this hash; then the worker fetches it.
    ///
    /// # Errors
    /// Why a scene that exists here cannot be opened, in one line.
    fn open_local(&self, reference: &SceneRef) -> Result<Option<Arc<Scene>>, String>;

    /// Generates a scene from its specification, such as `terrain:500000`.
    ///
    /// # Errors
    /// Why it cannot be generated, in one line.
    fn open_procedural(&self, spec: &str) -> Result<Arc<Scene>, String>;

    /// Opens a fetched bundle; the first file is the root.
    ///
    /// # Errors
    /// Why it cannot be opened, in one line.
    fn open_bundle(&self, reference: &SceneRef, files: Vec<SceneFile>) -> Result<Arc<Scene>, String>;
}

/// Makes the two roles on this machine's device. Called on the worker's render thread. Called again after the device
/// was lost, when it must open a new one.
pub trait RoleFactory: Send + Sync + 'static {
    /// Makes a sampler of `scene`, for the sample set `set` and other sets of the same specification.
    ///
    /// # Errors
    /// What the device lacks.
    fn sampler(&self, scene: Arc<Scene>, set: &SampleSetInfo) -> Result<Box<dyn Sampler>, RenderError>;

    /// Makes a compositor.
    ///
    /// # Errors
    /// What the device lacks.
    fn compositor(&self) -> Result<Box<dyn Compositor>, RenderError>;
}

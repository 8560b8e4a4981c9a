//! Interfaces that the binary implements, so that the cluster depends neither on scene loaders nor on a GPU.

use std::path::PathBuf;
use std::sync::Arc;

use argus_scene::rig::Sight;
use argus_scene::{Compositor, RenderError, SampleSetInfo, Sampler, Scene, SceneHash};
use bytes::Bytes;

/// A scene by name and content: what a worker is told to render.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneRef {
    /// What the user called it: a file's path or `terrain:500000`.
    pub name: String,
    /// Over the whole bundle of files, or a generated scene's name and version.
    pub hash: SceneHash,
}

/// One file of a scene's bundle that came over the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BundleFile {
    /// Relative to the bundle's root, parts separated by `/`, none of them `..`: checked on arrival.
    pub name: String,
    /// What is in it.
    pub bytes: Bytes,
}

/// The scene a coordinator serves, and where it came from.
pub trait SceneSource: Send + Sync + 'static {
    /// The scene.
    fn scene(&self) -> &Arc<Scene>;

    /// The specification that generates the scene on any machine, such as `terrain:500000`; `None` where it
    /// came from files.
    fn procedural(&self) -> Option<String>;

    /// The files a worker without the scene needs: (name within the bundle, place on this machine), the file
    /// to open first. Empty for a generated scene. Called once a fetch.
    ///
    /// # Errors
    /// What keeps the list from being made, in one line.
    fn files(&self) -> Result<Vec<(String, PathBuf)>, String>;

    /// Who knows what stands between two points of the scene, asked once and off the async threads where cameras stand in
    /// its midst; may take long. `None`: a view's cameras are the nearest ones.
    fn sight(&self) -> Option<Arc<dyn Sight>> {
        None
    }
}

/// How a worker opens the scene it is told to render. Called off the async threads; may take long.
pub trait SceneOpener: Send + Sync + 'static {
    /// Opens the scene from what this machine has by itself: files found under the scene's name or in a cache.
    /// `Ok(None)` where it has nothing of that hash; then the worker fetches it.
    ///
    /// # Errors
    /// In one line, what keeps a scene that is there from being opened.
    fn open_local(&self, reference: &SceneRef) -> Result<Option<Arc<Scene>>, String>;

    /// Generates a scene from its specification, such as `terrain:500000`.
    ///
    /// # Errors
    /// In one line.
    fn open_procedural(&self, spec: &str) -> Result<Arc<Scene>, String>;

    /// Opens a fetched bundle; the first file is the one to open.
    ///
    /// # Errors
    /// In one line.
    fn open_bundle(&self, reference: &SceneRef, files: Vec<BundleFile>) -> Result<Arc<Scene>, String>;
}

/// Makes the two roles on this machine's device. Called on the worker's render thread, and again after the
/// device was lost, when it must bring up a new one.
pub trait RoleFactory: Send + Sync + 'static {
    /// Renders `scene` from its triangles, for the sample set `set` and no set of another specification.
    ///
    /// # Errors
    /// What the device lacks.
    fn sampler(&self, scene: Arc<Scene>, set: &SampleSetInfo) -> Result<Box<dyn Sampler>, RenderError>;

    /// Reconstructs views from samples.
    ///
    /// # Errors
    /// What the device lacks.
    fn compositor(&self) -> Result<Box<dyn Compositor>, RenderError>;
}

//! How a worker comes by the scene it is told to render: from this machine, or from files that it was sent
//! and keeps.

use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use argus_cluster::{BundleFile, SceneOpener, SceneRef};
use argus_scene::{LoadError, Scene, load, reference};

/// Within a kept bundle, the file that says which of the others to open.
const ROOT: &str = "root";
/// Within a kept bundle, the folder of its files.
const FILES: &str = "files";

/// A folder of scenes: those that a person put there, by name, and those that were fetched, by hash.
pub(crate) struct SceneFolder {
    folder: PathBuf,
    /// A scene that is being opened before anybody named it, and what it is called.
    preloaded: Option<(String, Mutex<Option<Preloading>>)>,
}

/// A scene on its way from its file.
type Preloading = JoinHandle<Result<Scene, LoadError>>;

impl SceneFolder {
    /// Uses `folder`, or one in the user's cache.
    pub(crate) fn new(folder: Option<PathBuf>) -> Self {
        let cache = || reference::cache::directory().unwrap_or_else(std::env::temp_dir).join("scenes");
        Self { folder: folder.unwrap_or_else(cache), preloaded: None }
    }

    /// Begins to open a scene, which will probably be the one that is asked for.
    pub(crate) fn preloading(self, scene: Option<String>) -> Self {
        let begin = |name: String| {
            let spec = name.clone();
            let thread = std::thread::Builder::new().name("preload".to_owned());
            let opening = thread.spawn(move || argus_scene::open(&spec)).ok();
            (name, Mutex::new(opening))
        };
        Self { preloaded: scene.map(begin), ..self }
    }

    /// The scene that was opened ahead, if it is the one of that name. Given once: who asks again has it.
    fn preloaded(&self, name: &str) -> Option<Scene> {
        let (preloaded, opening) = self.preloaded.as_ref().filter(|(preloaded, _)| preloaded == name)?;
        let opening = opening.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        match opening.join() {
            Ok(Ok(scene)) => Some(scene),
            Ok(Err(error)) => {
                tracing::warn!("{preloaded}: {error}");
                None
            }
            Err(_) => None,
        }
    }

    /// Where a fetched bundle is kept.
    fn kept(&self, reference: &SceneRef) -> PathBuf {
        self.folder.join(reference.hash.to_string())
    }

    /// The file to open of a bundle that was kept.
    fn kept_root(&self, reference: &SceneRef) -> Option<PathBuf> {
        let kept = self.kept(reference);
        let root = std::fs::read_to_string(kept.join(ROOT)).ok()?;
        Some(kept.join(FILES).join(root))
    }

    /// Keeps a bundle: written beside its place and renamed into it, so that several workers may share the
    /// folder and none sees half a scene.
    fn keep(&self, reference: &SceneRef, files: &[BundleFile]) -> io::Result<()> {
        let partial = self.folder.join(format!("{}.{}", reference.hash, std::process::id()));
        let _ = std::fs::remove_dir_all(&partial);
        let kept = self.keep_by(&partial, reference, files);
        if kept.is_err() {
            // A disk that is full is not to be kept full by half a scene.
            let _ = std::fs::remove_dir_all(&partial);
        }
        kept
    }

    fn keep_by(&self, partial: &Path, reference: &SceneRef, files: &[BundleFile]) -> io::Result<()> {
        let root = files.first().ok_or(io::ErrorKind::InvalidData)?;
        let kept = self.kept(reference);
        for file in files {
            let path = partial.join(FILES).join(&file.name);
            std::fs::create_dir_all(path.parent().unwrap_or(partial))?;
            std::fs::write(path, &file.bytes)?;
        }
        std::fs::write(partial.join(ROOT), &root.name)?;
        if std::fs::rename(partial, &kept).is_err() {
            // Another worker was first, or what is there is damaged: either way this bundle is whole.
            let _ = std::fs::remove_dir_all(&kept);
            std::fs::rename(partial, &kept)?;
        }
        Ok(())
    }
}

impl SceneOpener for SceneFolder {
    fn open_local(&self, reference: &SceneRef) -> Result<Option<Arc<Scene>>, String> {
        if let Some(scene) = self.preloaded(&reference.name).filter(|scene| scene.hash == reference.hash) {
            return Ok(Some(Arc::new(scene)));
        }
        if argus_scene::is_procedural(&reference.name) {
            // Its generator is asked for by the coordinator's own word for it.
            return Ok(None);
        }
        let name = Path::new(&reference.name);
        let by_name = name.file_name().map(|file: &OsStr| self.folder.join(file));
        let places = [self.kept_root(reference), by_name, Some(name.to_path_buf())];
        for place in places.into_iter().flatten().filter(|place| place.is_file()) {
            // A file that cannot be opened, or is another scene by the same name, is no obstacle: the
            // coordinator has the right one.
            match load::load_path(&place) {
                Ok(scene) if scene.hash == reference.hash => {
                    return Ok(Some(Arc::new(Scene { name: reference.name.clone(), ..scene })));
                }
                Ok(_) => tracing::info!("{} is not the scene that is served", place.display()),
                Err(error) => tracing::warn!("{error}"),
            }
        }
        Ok(None)
    }

    fn open_procedural(&self, spec: &str) -> Result<Arc<Scene>, String> {
        if !argus_scene::is_procedural(spec) {
            return Err(format!("`{spec}` is not a scene that can be generated"));
        }
        argus_scene::open(spec).map(Arc::new).map_err(|error| error.to_string())
    }

    fn open_bundle(&self, reference: &SceneRef, files: Vec<BundleFile>) -> Result<Arc<Scene>, String> {
        if let Err(error) = self.keep(reference, &files) {
            // The scene is here all the same; it will be fetched again next time.
            tracing::warn!("cannot keep the scene in {}: {error}", self.folder.display());
        }
        let root = files.first().ok_or("the scene came without files")?.name.clone();
        let files = files.into_iter().map(|file| (file.name, file.bytes)).collect();
        let scene = load::load_bundle(&root, &files).map_err(|error| error.to_string())?;
        Ok(Arc::new(Scene { name: reference.name.clone(), ..scene }))
    }
}

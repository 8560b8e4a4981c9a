//! Opens the scene that a worker must render: from this machine's files, or from files that the coordinator sent.

use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use argus_cluster::{BundleFile, SceneOpener, SceneRef};
use argus_scene::{LoadError, Scene, load, reference};

/// The file of a kept bundle that names the file to open.
const ROOT: &str = "root";
/// The folder of a kept bundle's files.
const FILES: &str = "files";

/// A folder of scenes: the user's by name, fetched ones by hash.
pub(crate) struct SceneFolder {
    folder: PathBuf,
    /// A scene that is opened in advance, and its name.
    preloaded: Option<(String, Mutex<Option<Preloading>>)>,
}

/// A running load of a scene.
type Preloading = JoinHandle<Result<Scene, LoadError>>;

impl SceneFolder {
    /// Uses `folder`, or one in the user's cache.
    pub(crate) fn new(folder: Option<PathBuf>) -> Self {
        let cache = || reference::cache::directory().unwrap_or_else(std::env::temp_dir).join("scenes");
        Self { folder: folder.unwrap_or_else(cache), preloaded: None }
    }

    /// Starts to open a scene that will probably be requested.
    pub(crate) fn preloading(self, scene: Option<String>) -> Self {
        let begin = |name: String| {
            let spec = name.clone();
            let thread = std::thread::Builder::new().name("preload".to_owned());
            let opening = thread.spawn(move || argus_scene::open(&spec)).ok();
            (name, Mutex::new(opening))
        };
        Self { preloaded: scene.map(begin), ..self }
    }

    /// Takes the preloaded scene if it has that name. It can be taken once.
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

    /// The folder of a fetched bundle.
    fn kept(&self, reference: &SceneRef) -> PathBuf {
        self.folder.join(reference.hash.to_string())
    }

    /// The file to open of a kept bundle.
    fn kept_root(&self, reference: &SceneRef) -> Option<PathBuf> {
        let kept = self.kept(reference);
        let root = std::fs::read_to_string(kept.join(ROOT)).ok()?;
        Some(kept.join(FILES).join(root))
    }

    /// Keeps a bundle. It is written to a temporary folder and renamed, so that several workers may share the folder
    /// and none sees half a scene.
    fn keep(&self, reference: &SceneRef, files: &[BundleFile]) -> io::Result<()> {
        let partial = self.folder.join(format!("{}.{}", reference.hash, std::process::id()));
        let _ = std::fs::remove_dir_all(&partial);
        let kept = self.keep_by(&partial, reference, files);
        if kept.is_err() {
            // A partial scene must not fill the disk.
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
            // Another worker was first, or the folder is damaged; this bundle is whole in either case.
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
            // Procedural scenes are generated in `open_procedural`, by the coordinator's specification.
            return Ok(None);
        }
        // Balls are added to the file here.
        let name = Path::new(argus_scene::base_of(&reference.name));
        let by_name = name.file_name().map(|file: &OsStr| self.folder.join(file));
        let places = [self.kept_root(reference), by_name, Some(name.to_path_buf())];
        for place in places.into_iter().flatten().filter(|place| place.is_file()) {
            // A file that cannot be opened, or that holds another scene of the same name, is skipped: the coordinator
            // has the right one.
            let opened =
                load::load_path(&place).and_then(|scene| argus_scene::with_additions(scene, &reference.name));
            match opened {
                Ok(scene) if scene.hash == reference.hash => return Ok(Some(Arc::new(scene))),
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
            // The scene is usable; it will be fetched again next time.
            tracing::warn!("cannot keep the scene in {}: {error}", self.folder.display());
        }
        let root = files.first().ok_or("the scene's bundle has no files")?.name.clone();
        let files = files.into_iter().map(|file| (file.name, file.bytes)).collect();
        let scene = load::load_bundle(&root, &files)
            .and_then(|scene| argus_scene::with_additions(scene, &reference.name));
        scene.map(Arc::new).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use argus_cluster::SceneSource as _;

    use super::*;
    use crate::wiring::source::OpenScene;

    #[test]
    fn balls_are_added_to_a_file_wherever_a_worker_has_it() {
        let [there, here] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let file = there.path().join("floor.obj");
        std::fs::write(&file, "v -5 0 -5\nv 5 0 -5\nv 5 0 5\nv -5 0 5\nf 4 3 2 1\n").unwrap();
        let served = OpenScene::open(&format!("{}+balls:3", file.display())).unwrap();
        assert_eq!(served.procedural(), None);
        let files: Vec<BundleFile> = served
            .files()
            .unwrap()
            .into_iter()
            .map(|(name, path)| BundleFile { name, bytes: std::fs::read(path).unwrap().into() })
            .collect();
        let reference = SceneRef { name: served.name().to_owned(), hash: served.scene().hash };
        let folder = SceneFolder::new(Some(here.path().to_owned()));
        let is_served = |scene: Option<Arc<Scene>>| scene.is_some_and(|scene| scene == *served.scene());
        assert!(is_served(folder.open_local(&reference).unwrap()), "under its own name");
        std::fs::remove_file(&file).unwrap();
        assert_eq!(folder.open_local(&reference), Ok(None));
        assert!(is_served(folder.open_bundle(&reference, files).ok()), "from files that were sent");
        assert!(is_served(folder.open_local(&reference).unwrap()), "from files that were kept");
    }

    #[test]
    fn balls_in_a_generated_scene_are_generated() {
        let served = OpenScene::open("rooms+balls:4").unwrap();
        let spec = served.procedural().unwrap();
        let folder = SceneFolder::new(Some(std::env::temp_dir()));
        assert_eq!(folder.open_procedural(&spec).as_ref(), Ok(served.scene()));
        assert_eq!(served.files(), Ok(Vec::new()));
    }
}

//! Opens the scene that a worker must render: from this machine's files, or from files that the coordinator sent.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use argus_cluster::{SceneFile, SceneOpener, SceneRef};
use argus_scene::{LoadError, Scene, load, reference};

use super::source::environment_name;

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

    /// Starts to open a scene that will probably be requested, and to prepare it: `prepare` does what does not depend on its
    /// light, and keeps no reference to it.
    pub(crate) fn preloading(
        self,
        scene: Option<String>,
        prepare: impl FnOnce(&Arc<Scene>) + Send + 'static,
    ) -> Self {
        let begin = |name: String| {
            let spec = name.clone();
            let open = move || {
                let scene = Arc::new(argus_scene::open(&spec)?);
                prepare(&scene);
                Ok(Arc::unwrap_or_clone(scene))
            };
            let thread = std::thread::Builder::new().name("preload".to_owned());
            (name, Mutex::new(thread.spawn(open).ok()))
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

    /// The files here that may be the environment map of a scene: of its kept bundle, of that name in the folder, and the
    /// named file itself.
    fn environments(&self, reference: &SceneRef, file: &str) -> Vec<PathBuf> {
        let kept = environment_name(file).map(|name| self.kept(reference).join(FILES).join(name));
        let by_name = Path::new(file).file_name().map(|name| self.folder.join(name));
        let places = [kept, by_name, Some(PathBuf::from(file))];
        places.into_iter().flatten().filter(|place| place.is_file()).collect()
    }

    /// Keeps a bundle. It is written to a temporary folder and renamed, so that several workers may share the folder
    /// and none sees half a scene.
    fn keep(&self, reference: &SceneRef, files: &[SceneFile]) -> io::Result<()> {
        let partial = self.folder.join(format!("{}.{}", reference.hash, std::process::id()));
        let _ = std::fs::remove_dir_all(&partial);
        let kept = self.keep_by(&partial, reference, files);
        if kept.is_err() {
            // A partial scene must not fill the disk.
            let _ = std::fs::remove_dir_all(&partial);
        }
        kept
    }

    fn keep_by(&self, partial: &Path, reference: &SceneRef, files: &[SceneFile]) -> io::Result<()> {
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
        if let Some(scene) =
            self.preloaded(&reference.name).and_then(|scene| scene.in_light_of(reference.hash))
        {
            return Ok(Some(Arc::new(scene)));
        }
        if argus_scene::is_procedural(&reference.name) {
            // In the light that they are generated with, procedural scenes are made in `open_procedural`, by the
            // coordinator's specification.
            let scene = argus_scene::open(&reference.name).map_err(|error| error.to_string())?;
            return Ok(scene.in_light_of(reference.hash).map(Arc::new));
        }
        let (alone, environment) = argus_scene::split_environment(&reference.name);
        let environments = environment.map(|file| self.environments(reference, file));
        if argus_scene::is_procedural(alone) {
            let has_environment = environments.as_ref().is_some_and(|places| !places.is_empty());
            let scene = has_environment.then(|| argus_scene::open(alone)).transpose();
            let scene = scene.map_err(|error| error.to_string())?;
            return Ok(scene.and_then(|scene| served(reference, scene, environments.as_deref())));
        }
        // Balls are added to the file here.
        let name = Path::new(argus_scene::base_of(alone));
        let by_name = name.file_name().map(|file: &OsStr| self.folder.join(file));
        let places = [self.kept_root(reference), by_name, Some(name.to_path_buf())];
        for place in places.into_iter().flatten().filter(|place| place.is_file()) {
            // A file that cannot be opened, or that holds another scene of the same name, is skipped: the coordinator
            // has the right one.
            let opened = load::load_path(&place).and_then(|scene| argus_scene::with_additions(scene, alone));
            match opened {
                Ok(scene) => match served(reference, scene, environments.as_deref()) {
                    Some(scene) => return Ok(Some(scene)),
                    None => tracing::info!("{} is not the scene that is served", place.display()),
                },
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

    fn open_bundle(&self, reference: &SceneRef, files: Vec<SceneFile>) -> Result<Arc<Scene>, String> {
        if let Err(error) = self.keep(reference, &files) {
            // The scene is usable; it will be fetched again next time.
            tracing::warn!("cannot keep the scene in {}: {error}", self.folder.display());
        }
        let root = files.first().ok_or("the scene's bundle has no files")?.name.clone();
        let mut files: BTreeMap<_, _> = files.into_iter().map(|file| (file.name, file.bytes)).collect();
        let (alone, environment) = argus_scene::split_environment(&reference.name);
        let environment = environment.and_then(environment_name).and_then(|name| files.remove_entry(&name));
        let scene = match argus_scene::is_procedural(alone) {
            true => argus_scene::open(alone),
            false => {
                load::load_bundle(&root, &files).and_then(|scene| argus_scene::with_additions(scene, alone))
            }
        };
        let mut scene = scene.map_err(|error| error.to_string())?;
        if let Some((name, bytes)) = environment {
            let map = load::decode_environment(&name, &bytes).map_err(|error| error.to_string())?;
            scene = scene.with_environment(map, &bytes);
        }
        let opened = scene.hash;
        let scene = scene
            .in_light_of(reference.hash)
            .ok_or_else(|| format!("its hash is {opened} here, and no light gives it {}", reference.hash))?;
        Ok(Arc::new(Scene { name: reference.name.clone(), ..scene }))
    }
}

/// A scene that was opened here, in the light and the first of its environments that make it the referenced one. `None` if it is
/// another scene.
fn served(reference: &SceneRef, scene: Scene, environments: Option<&[PathBuf]>) -> Option<Arc<Scene>> {
    let named = |scene: Scene| Arc::new(Scene { name: reference.name.clone(), ..scene });
    let Some(places) = environments else { return scene.in_light_of(reference.hash).map(named) };
    for place in places {
        let is_it = |bytes: &Vec<u8>| scene.hash.in_environment(bytes).choice_of(reference.hash).is_some();
        let Some(bytes) = std::fs::read(place).ok().filter(is_it) else { continue };
        match load::decode_environment(&place.display().to_string(), &bytes) {
            Ok(map) => {
                return scene.with_environment(map, &bytes).in_light_of(reference.hash).map(named);
            }
            Err(error) => tracing::warn!("{error}"),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use argus_cluster::SceneSource as _;
    use argus_scene::{LightEffects, LightRequest, Metering};

    use super::*;
    use crate::wiring::OpenScene;

    /// A map of 2 × 1 texels as a Radiance file: one grey, one red.
    const MAP: &[u8] = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x80\x80\x40\x40\x80";

    fn open(spec: &str) -> OpenScene {
        lit(spec, LightRequest::Auto)
    }

    fn lit(spec: &str, light: LightRequest) -> OpenScene {
        let metering = Metering { effects: LightEffects::ALL, indirect: true };
        OpenScene::open(spec, light, metering).unwrap()
    }

    /// The bundle of an open scene, as a worker receives it.
    fn bundle(scene: &OpenScene) -> Vec<SceneFile> {
        let read =
            |(name, path): (String, PathBuf)| SceneFile { name, bytes: std::fs::read(path).unwrap().into() };
        scene.files().unwrap().into_iter().map(read).collect()
    }

    fn reference(scene: &OpenScene) -> SceneRef {
        SceneRef { name: scene.name().to_owned(), hash: scene.scene().hash }
    }

    fn write_square(folder: &Path) -> String {
        let file = folder.join("square.obj");
        std::fs::write(&file, "v 0 0 0\nv 1 0 0\nv 1 0 1\nf 3 2 1\n").unwrap();
        file.display().to_string()
    }

    #[test]
    fn a_worker_without_the_environments_file_gets_it_with_the_scene_and_keeps_it() {
        let here = tempfile::tempdir().unwrap();
        let map = here.path().join("noon.hdr");
        std::fs::write(&map, MAP).unwrap();
        for scene in [write_square(here.path()), "terrain:2000".to_owned()] {
            let spec = argus_scene::in_environment(&scene, &map.display().to_string());
            let served = open(&spec);
            assert_eq!(served.name(), spec);
            assert_eq!(served.procedural(), None);
            let (reference, files) = (reference(&served), bundle(&served));
            assert!(files.iter().any(|file| file.name == ".environment/noon.hdr"));
            // Another machine has neither file.
            let there = tempfile::tempdir().unwrap();
            let moved = here.path().with_extension("moved");
            std::fs::rename(here.path(), &moved).unwrap();
            let worker = SceneFolder::new(Some(there.path().to_path_buf()));
            assert!(worker.open_local(&reference).unwrap().is_none());
            let fetched = worker.open_bundle(&reference, files).unwrap();
            assert_eq!(*fetched, **served.scene());
            let kept = worker.open_local(&reference).unwrap().expect("the bundle was kept");
            assert_eq!(*kept, **served.scene());
            std::fs::rename(&moved, here.path()).unwrap();
            let near = SceneFolder::new(Some(there.path().join("empty")));
            assert_eq!(*near.open_local(&reference).unwrap().expect("both are here"), **served.scene());
        }
    }

    #[test]
    fn a_scene_is_not_opened_in_another_environment_of_that_name() {
        let here = tempfile::tempdir().unwrap();
        let map = here.path().join("noon.hdr");
        std::fs::write(&map, MAP).unwrap();
        let spec = argus_scene::in_environment("terrain:2000", &map.display().to_string());
        let reference = reference(&open(&spec));
        std::fs::write(&map, [MAP, b"\n"].concat()).unwrap();
        let worker = SceneFolder::new(Some(here.path().join("scenes")));
        assert!(worker.open_local(&reference).unwrap().is_none());
    }

    #[test]
    fn balls_are_added_to_a_file_wherever_a_worker_has_it() {
        let [there, here] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let file = there.path().join("floor.obj");
        std::fs::write(&file, "v -5 0 -5\nv 5 0 -5\nv 5 0 5\nv -5 0 5\nf 4 3 2 1\n").unwrap();
        let served = open(&format!("{}+balls:3", file.display()));
        assert_eq!(served.procedural(), None);
        let (reference, files) = (reference(&served), bundle(&served));
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
        let served = open("rooms+balls:4");
        let spec = served.procedural().unwrap();
        let folder = SceneFolder::new(Some(std::env::temp_dir()));
        assert_eq!(folder.open_procedural(&spec).as_ref(), Ok(served.scene()));
        assert_eq!(served.files(), Ok(Vec::new()));
    }

    #[test]
    fn workers_find_the_light_of_a_scene_by_its_hash() {
        let here = tempfile::tempdir().unwrap();
        let file = write_square(here.path());
        for scene in [file.as_str(), "terrain:2000"] {
            for light in LightRequest::ALL {
                let served = lit(scene, light);
                let folder = SceneFolder::new(Some(here.path().join("empty")));
                let found = match folder.open_local(&reference(&served)).unwrap() {
                    Some(scene) => scene,
                    None => folder.open_procedural(scene).unwrap(),
                };
                assert_eq!(found, *served.scene(), "{scene}, {light}");
                if !argus_scene::is_procedural(scene) {
                    let sent = folder.open_bundle(&reference(&served), bundle(&served)).unwrap();
                    assert_eq!(sent, *served.scene(), "{scene}, {light}");
                }
            }
        }
    }
}

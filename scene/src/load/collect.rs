//! Reads the files of a bundle.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use super::parts::Format;
use super::paths::{Files, Finder, Folder};
use super::scene_files::{SceneFiles, folder_of};
use super::{LoadError, gltf, obj, ply};

impl SceneFiles {
    /// Reads the main file and, following its references, all others. Missing ones are recorded; the loader decides
    /// whether the scene can do without.
    pub(super) fn collect(files: &dyn Files, main: &str) -> Result<Self, LoadError> {
        let bytes = files.read(main).map_err(|error| LoadError::new(main, error.to_string()))?;
        let format = Format::detect(main, &bytes).map_err(|reason| LoadError::new(main, reason))?;
        let mut finder = Finder::new(files);
        finder.read.insert(main.to_owned(), bytes.clone());
        let mut bundle = Self {
            main: main.to_owned(),
            format,
            files: BTreeMap::new(),
            libraries: Vec::new(),
            found: HashMap::new(),
        };
        match format {
            Format::Gltf => {
                let names = gltf::references(&bytes).map_err(|reason| LoadError::new(main, reason))?;
                bundle.add(&mut finder, "", names);
            }
            Format::Obj => {
                for candidates in obj::libraries(&bytes) {
                    bundle.add_libraries(&mut finder, candidates);
                }
                let libraries: BTreeSet<String> =
                    bundle.libraries.iter().flat_map(|(_, names)| names.iter().cloned()).collect();
                for library in libraries {
                    let textures = obj::textures(&finder.read[&library]);
                    bundle.add(&mut finder, folder_of(&library), textures);
                }
            }
            Format::Ply => bundle.add(&mut finder, "", ply::textures(&bytes)),
        }
        bundle.files = finder.read;
        Ok(bundle)
    }

    /// Finds the libraries of one line. The whole line is a name with spaces; if there is no such file, each word is a
    /// name. Files of exactly those names come before substitutes.
    fn add_libraries(&mut self, finder: &mut Finder, candidates: Vec<String>) {
        let Some((line, words)) = candidates.split_first() else { return };
        let is_there = |finder: &mut Finder, name: &String| finder.exact("", name).is_ok();
        let by_words = !is_there(finder, line) && words.iter().any(|word| is_there(finder, word));
        let whole = if by_words { None } else { self.find(finder, "", line.clone()) };
        let names = match whole {
            Some(name) => vec![name],
            None => words.iter().filter_map(|word| self.find(finder, "", word.clone())).collect(),
        };
        self.libraries.push((line.clone(), names));
    }

    fn add(&mut self, finder: &mut Finder, folder: &str, references: BTreeSet<String>) {
        for reference in references {
            self.find(finder, folder, reference);
        }
    }

    fn find(&mut self, finder: &mut Finder, folder: &str, reference: String) -> Option<String> {
        let found = finder.find(folder, &reference);
        let name = found.as_ref().ok().map(|found| found.name.clone());
        self.found.insert((folder.to_owned(), reference), found);
        name
    }
}

/// A path's folder, and the name of the file in it.
///
/// # Errors
/// A path without a file name, or a name that is not Unicode: names are part of the scene's hash.
pub(super) fn split(path: &Path) -> Result<Folder, LoadError> {
    let shown = path.display().to_string();
    let name = path.file_name().ok_or_else(|| LoadError::new(&shown, "is not the name of a file"))?;
    let name = name.to_str().ok_or_else(|| LoadError::new(&shown, "its name is not Unicode"))?;
    Ok(Folder { path: path.parent().map(Path::to_owned).unwrap_or_default(), main: name.to_owned() })
}

/// Every file of a scene's bundle: its name relative to the folder, and its path on this machine. Includes the main file.
/// References that cannot be read or point outside the folder are left out, as in [`super::load_path`].
///
/// # Errors
/// The main file cannot be read or has an unknown format.
pub fn bundle_files(path: impl AsRef<Path>) -> Result<Vec<(String, PathBuf)>, LoadError> {
    let path = path.as_ref();
    let folder = split(path)?;
    let bundle = SceneFiles::collect(&folder, &folder.main)
        .map_err(|error| LoadError::new(path.display().to_string(), error.reason))?;
    Ok(bundle.files.into_keys().map(|name| (name.clone(), folder.path.join(name))).collect())
}

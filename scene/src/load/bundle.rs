//! The bundle of a scene: its main file and every file it refers to, by names relative to its folder.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::paths::{Files, Finder, Folder, Found};
use super::{Format, LoadError, Warnings, gltf, obj, ply};
use crate::SceneHash;

/// A reference in a file: the file's folder, and the name as it is written.
type Reference = (String, String);

/// A main file and the files it refers to.
pub(super) struct Bundle {
    /// Name of the main file.
    pub(super) main: String,
    /// The main file's format.
    pub(super) format: Format,
    /// Every file that could be read, by relative name.
    pub(super) files: BTreeMap<String, Bytes>,
    /// The material libraries of an OBJ file: what each line says, and the files that it stands for.
    pub(super) libraries: Vec<(String, Vec<String>)>,
    /// The file of each reference, or why it is missing.
    found: HashMap<Reference, Result<Found, String>>,
}

impl Bundle {
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

    /// The main file's content.
    pub(super) fn main_bytes(&self) -> &Bytes {
        &self.files[&self.main]
    }

    /// The name and content of the file that `reference` in a file of `folder` stands for, or why it is missing.
    pub(super) fn get(&self, folder: &str, reference: &str) -> Result<(&str, &Bytes), String> {
        let missing = |reason: &str| format!("{reference}: {reason}");
        match self.found.get(&(folder.to_owned(), reference.to_owned())) {
            Some(Ok(found)) => Ok((&found.name, &self.files[&found.name])),
            Some(Err(reason)) => Err(missing(reason)),
            None => Err(missing("not in the bundle")),
        }
    }

    /// Warns of each file that was taken for another name.
    pub(super) fn warn_of_substitutes(&self, warnings: &mut Warnings) {
        let told: BTreeSet<String> = self
            .found
            .iter()
            .filter_map(|((_, reference), found)| {
                let found = found.as_ref().ok().filter(|found| found.substitute)?;
                let place =
                    if found.name.contains('/') { "within the file's folder" } else { "beside the file" };
                Some(format!("\"{reference}\" is not there: {} taken from {place}", found.name))
            })
            .collect();
        told.into_iter().for_each(|line| warnings.add(line));
    }

    /// Bytes of all files together.
    pub(super) fn len(&self) -> usize {
        self.files.values().map(Bytes::len).sum()
    }

    /// BLAKE3 over name and content of every file, in the order of names.
    pub(super) fn hash(&self) -> SceneHash {
        let mut hasher = blake3::Hasher::new();
        for (name, bytes) in &self.files {
            // Lengths first, so that different bundles never hash the same bytes.
            hasher.update(&(name.len() as u64).to_le_bytes());
            hasher.update(name.as_bytes());
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        }
        SceneHash(*hasher.finalize().as_bytes())
    }
}

/// The folder of a file.
pub(super) fn folder_of(name: &str) -> &str {
    name.rsplit_once('/').map_or("", |(folder, _)| folder)
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
    let bundle = Bundle::collect(&folder, &folder.main)
        .map_err(|error| LoadError::new(path.display().to_string(), error.reason))?;
    Ok(bundle.files.into_keys().map(|name| (name.clone(), folder.path.join(name))).collect())
}

//! The bundle of a scene: its main file and every file it refers to, by names relative to its folder.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use bytes::Bytes;

use super::parts::{Format, Warnings};
use super::paths::Found;
use crate::SceneHash;

/// A reference in a file: the file's folder, and the name as it is written.
type Reference = (String, String);

/// A main file and the files it refers to.
pub(super) struct SceneFiles {
    /// Name of the main file.
    pub(super) main: String,
    /// The main file's format.
    pub(super) format: Format,
    /// Every file that could be read, by relative name.
    pub(super) files: BTreeMap<String, Bytes>,
    /// The material libraries of an OBJ file: what each line says, and the files that it stands for.
    pub(super) libraries: Vec<(String, Vec<String>)>,
    /// The file of each reference, or why it is missing.
    pub(super) found: HashMap<Reference, Result<Found, String>>,
}

impl SceneFiles {
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

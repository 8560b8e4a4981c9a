//! The bundle of a scene: its main file and every file it refers to, by names relative to its folder.
//!
//! Scene files are untrusted. A name that is absolute, leaves the folder (`..`) or has a scheme is never opened.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::{Format, LoadError, gltf, obj};
use crate::SceneHash;

/// A source of a bundle's files.
pub(super) trait Files {
    /// The whole content of a file, by its name relative to the scene's folder.
    fn read(&self, name: &str) -> io::Result<Bytes>;
}

/// Files of a folder on disk.
pub(super) struct Folder(pub(super) PathBuf);

impl Files for Folder {
    fn read(&self, name: &str) -> io::Result<Bytes> {
        let path = self.0.join(name);
        // Reading a device or a pipe might never end.
        if !std::fs::metadata(&path)?.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a file"));
        }
        Ok(Bytes::from(std::fs::read(path)?))
    }
}

/// Files that are in memory already.
pub(super) struct InMemory<'a>(pub(super) &'a BTreeMap<String, Bytes>);

impl Files for InMemory<'_> {
    fn read(&self, name: &str) -> io::Result<Bytes> {
        self.0.get(name).cloned().ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not in the bundle"))
    }
}

/// A main file and the files it refers to.
pub(super) struct Bundle {
    /// Name of the main file.
    pub(super) main: String,
    /// The main file's format.
    pub(super) format: Format,
    /// Every file that could be read, by relative name.
    pub(super) files: BTreeMap<String, Bytes>,
    /// Why each of the remaining files could not be read.
    missing: BTreeMap<String, String>,
}

impl Bundle {
    /// Reads the main file and, following its references, all others. Missing ones are recorded; the loader decides
    /// whether the scene can do without.
    pub(super) fn collect(files: &dyn Files, main: &str) -> Result<Self, LoadError> {
        let bytes = files.read(main).map_err(|error| LoadError::new(main, error.to_string()))?;
        let format = Format::detect(main, &bytes).map_err(|reason| LoadError::new(main, reason))?;
        let mut bundle = Self {
            main: main.to_owned(),
            format,
            files: BTreeMap::from([(main.to_owned(), bytes.clone())]),
            missing: BTreeMap::new(),
        };
        match format {
            Format::Gltf => {
                let names = gltf::references(&bytes).map_err(|reason| LoadError::new(main, reason))?;
                bundle.add(files, names);
            }
            Format::Obj => {
                let libraries = obj::libraries(&bytes);
                let candidates =
                    libraries.iter().flatten().filter_map(|name| relative("", name).ok()).collect();
                bundle.add(files, candidates);
                // If the whole line names a file, its words are not files of their own. Words that name no file were
                // guesses.
                bundle.missing.clear();
                let libraries: Vec<(String, Bytes)> = bundle
                    .files
                    .iter()
                    .filter(|(name, _)| *name != main)
                    .map(|(n, b)| (n.clone(), b.clone()))
                    .collect();
                for (library, bytes) in libraries {
                    bundle.add(files, obj::textures(&library, &bytes));
                }
            }
            Format::Ply => {}
        }
        Ok(bundle)
    }

    fn add(&mut self, files: &dyn Files, names: BTreeSet<String>) {
        for name in names {
            if self.files.contains_key(&name) {
                continue;
            }
            match files.read(&name) {
                Ok(bytes) => {
                    self.files.insert(name, bytes);
                }
                Err(error) => {
                    self.missing.insert(name, error.to_string());
                }
            }
        }
    }

    /// The main file's content.
    pub(super) fn main_bytes(&self) -> &Bytes {
        &self.files[&self.main]
    }

    /// A file of the bundle, or why it is missing.
    pub(super) fn get(&self, name: &str) -> Result<&Bytes, String> {
        self.files.get(name).ok_or_else(|| match self.missing.get(name) {
            Some(reason) => format!("{name}: {reason}"),
            None => format!("{name}: not in the bundle"),
        })
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

/// The name of a referenced file relative to the scene's folder. `reference` is relative to `folder`.
///
/// # Errors
/// Why the name is not within the folder.
pub(super) fn relative(folder: &str, reference: &str) -> Result<String, String> {
    // Files written on Windows use backslashes.
    let unified = reference.replace('\\', "/");
    let refuse = |why: &str| Err(format!("{:?} {why}", super::error::one_line(reference)));
    if unified.starts_with('/') || unified.contains(':') {
        return refuse("is not a name within the scene's folder");
    }
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in unified.split('/') {
        match part {
            "" | "." => {}
            ".." => return refuse("leaves the scene's folder"),
            _ if part.contains('\0') => return refuse("is not a file name"),
            _ => parts.push(part),
        }
    }
    if parts.is_empty() { refuse("is not a file name") } else { Ok(parts.join("/")) }
}

/// Splits a path into its folder and the name of the file in it.
///
/// # Errors
/// A path without a file name, or a name that is not Unicode: names are part of the scene's hash.
pub(super) fn split(path: &Path) -> Result<(PathBuf, String), LoadError> {
    let shown = path.display().to_string();
    let name = path.file_name().ok_or_else(|| LoadError::new(&shown, "is not the name of a file"))?;
    let name = name.to_str().ok_or_else(|| LoadError::new(&shown, "its name is not Unicode"))?;
    Ok((path.parent().map(Path::to_owned).unwrap_or_default(), name.to_owned()))
}

/// Every file of a scene's bundle: its name relative to the folder, and its path on this machine. Includes the main file.
/// References that cannot be read or point outside the folder are left out, as in [`super::load_path`].
///
/// # Errors
/// The main file cannot be read or has an unknown format.
pub fn bundle_files(path: impl AsRef<Path>) -> Result<Vec<(String, PathBuf)>, LoadError> {
    let path = path.as_ref();
    let (folder, main) = split(path)?;
    let bundle = Bundle::collect(&Folder(folder.clone()), &main)
        .map_err(|error| LoadError::new(path.display().to_string(), error.reason))?;
    Ok(bundle.files.into_keys().map(|name| (name.clone(), folder.join(name))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_outside_the_folder_are_rejected() {
        for name in
            ["../secret", "a/../../b", "/etc/passwd", "C:\\x.png", "http://x/y", "file:x", "a\0b", "", "."]
        {
            relative("", name).expect_err(name);
        }
        relative("textures", "..\\x.png").expect_err("backslashes climb as well");
    }

    #[test]
    fn names_inside_the_folder_are_normalised() {
        assert_eq!(relative("", "./a//b c.png").unwrap(), "a/b c.png");
        assert_eq!(relative("maps", "wood\\oak.png").unwrap(), "maps/wood/oak.png");
        assert_eq!(relative("", "..hidden").unwrap(), "..hidden");
    }
}

//! Finds the files that a scene refers to, within the scene's folder.
//!
//! Scene files are untrusted. No name leads out of the folder, neither by `..` nor by a link. Files travel between machines
//! while the names in them stay, so that a name may be absolute, of another system or in another case. Such a name stands
//! for the file within the folder that matches most of its last components, whatever their case.

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::path::PathBuf;

use bytes::Bytes;

/// Most components of a name that are compared with files.
const MOST_COMPONENTS: usize = 16;
/// Most folders that are looked into for one name.
const MOST_STEPS: usize = 256;

/// A source of a scene's files. Names are relative to the scene's folder.
pub(super) trait Files {
    /// The whole content of a file.
    fn read(&self, name: &str) -> io::Result<Bytes>;
    /// Names of the files and folders in a folder; none if it cannot be read.
    fn list(&self, folder: &str) -> Vec<String>;
}

/// Files of a folder on disk.
pub(super) struct Folder {
    /// The folder's path; empty for the working directory.
    pub(super) path: PathBuf,
    /// The file that the user named: it alone may be a link to elsewhere.
    pub(super) main: String,
}

impl Folder {
    /// The path of a file or folder that lies within this folder, links followed.
    fn within(&self, name: &str) -> io::Result<PathBuf> {
        let root = if self.path.as_os_str().is_empty() { PathBuf::from(".") } else { self.path.clone() };
        let path = root.join(name).canonicalize()?;
        if path.starts_with(root.canonicalize()?) {
            return Ok(path);
        }
        Err(io::Error::new(io::ErrorKind::PermissionDenied, "a link leads out of the scene's folder"))
    }
}

impl Files for Folder {
    fn read(&self, name: &str) -> io::Result<Bytes> {
        let path = if name == self.main { self.path.join(name) } else { self.within(name)? };
        // Reading a device or a pipe might never end.
        if !std::fs::metadata(&path)?.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a file"));
        }
        Ok(Bytes::from(std::fs::read(path)?))
    }

    fn list(&self, folder: &str) -> Vec<String> {
        let entries = self.within(folder).and_then(std::fs::read_dir);
        entries.into_iter().flatten().filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect()
    }
}

/// Files that are in memory already.
pub(super) struct InMemory<'a>(pub(super) &'a BTreeMap<String, Bytes>);

impl Files for InMemory<'_> {
    fn read(&self, name: &str) -> io::Result<Bytes> {
        self.0.get(name).cloned().ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not in the bundle"))
    }

    fn list(&self, folder: &str) -> Vec<String> {
        let prefix = if folder.is_empty() { String::new() } else { format!("{folder}/") };
        let below = self.0.range(prefix.clone()..).map_while(|(name, _)| name.strip_prefix(&prefix));
        let mut entries: Vec<String> =
            below.map(|rest| rest.split('/').next().unwrap_or(rest).to_owned()).collect();
        entries.dedup();
        entries
    }
}

/// Where a referenced file is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Found {
    /// Its name relative to the scene's folder.
    pub(super) name: String,
    /// Whether that is another name than the reference's.
    pub(super) substitute: bool,
}

/// Looks files up and keeps what it has read.
pub(super) struct Finder<'a> {
    files: &'a dyn Files,
    /// Every file that was found, by name relative to the scene's folder.
    pub(super) read: BTreeMap<String, Bytes>,
    /// Entries of the folders that were looked into, by their names in lower case.
    listings: HashMap<String, HashMap<String, Vec<String>>>,
}

impl<'a> Finder<'a> {
    pub(super) fn new(files: &'a dyn Files) -> Self {
        Self { files, read: BTreeMap::new(), listings: HashMap::new() }
    }

    /// Finds the file that `reference` in a file of `folder` names, exactly as it is written.
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn exact(&mut self, folder: &str, reference: &str) -> Result<Found, String> {
        let name = relative(folder, reference)?;
        self.load(&name).map_err(|error| error.to_string())?;
        Ok(Found { name, substitute: false })
    }

    /// Finds the file that `reference` in a file of `folder` names, or else the one that matches most of the name's last
    /// components: first in `folder`, then in the scene's folder. Of names that differ only in case, the exact one comes
    /// first, then the first in order.
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn find(&mut self, folder: &str, reference: &str) -> Result<Found, String> {
        let reason = match self.exact(folder, reference) {
            Ok(found) => return Ok(found),
            Err(reason) => reason,
        };
        let parts = components(reference);
        let mut steps = MOST_STEPS;
        for first in parts.len().saturating_sub(MOST_COMPONENTS)..parts.len() {
            for place in [folder, ""] {
                if let Some(name) = self.walk(place, &parts[first..], &mut steps) {
                    return Ok(Found { name, substitute: true });
                }
            }
        }
        Err(reason)
    }

    fn load(&mut self, name: &str) -> io::Result<()> {
        if !self.read.contains_key(name) {
            self.read.insert(name.to_owned(), self.files.read(name)?);
        }
        Ok(())
    }

    /// The name of the file at a path below `folder` in any case.
    fn walk(&mut self, folder: &str, path: &[&str], steps: &mut usize) -> Option<String> {
        let (first, rest) = path.split_first()?;
        *steps = steps.checked_sub(1)?;
        for entry in self.matching(folder, first) {
            let name = if folder.is_empty() { entry } else { format!("{folder}/{entry}") };
            let found = match rest {
                [] => self.load(&name).is_ok().then_some(name),
                _ => self.walk(&name, rest, steps),
            };
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// The entries of a folder that have a name in any case, the exact one first.
    fn matching(&mut self, folder: &str, name: &str) -> Vec<String> {
        let files = self.files;
        let listing = self.listings.entry(folder.to_owned()).or_insert_with(|| {
            let mut by_name: HashMap<String, Vec<String>> = HashMap::new();
            for entry in files.list(folder) {
                by_name.entry(entry.to_lowercase()).or_default().push(entry);
            }
            by_name
        });
        let mut entries = listing.get(&name.to_lowercase()).cloned().unwrap_or_default();
        entries.sort_by(|a, b| (a != name, a).cmp(&(b != name, b)));
        entries
    }
}

/// The components of a name of any system: without drive, scheme and root, and without what `..` takes back.
fn components(reference: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    for part in reference.split(['/', '\\']) {
        let part = part.rsplit(':').next().unwrap_or(part);
        match part {
            "" | "." => {}
            ".." => {
                parts.pop();
            }
            _ if part.contains('\0') => return Vec::new(),
            _ => parts.push(part),
        }
    }
    parts
}

/// The name of a referenced file relative to the scene's folder. `reference` is relative to `folder`.
///
/// # Errors
/// Why the name is not within the scene's folder.
fn relative(folder: &str, reference: &str) -> Result<String, String> {
    // Files written on Windows use backslashes.
    let unified = reference.replace('\\', "/");
    let refuse = |why: &str| Err(format!("{why}, and no such file lies there"));
    if unified.starts_with('/') || unified.contains(':') {
        return refuse("not a name within the scene's folder");
    }
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in unified.split('/') {
        match part {
            "" | "." => {}
            ".." if parts.pop().is_some() => {}
            ".." => return refuse("leads out of the scene's folder"),
            _ if part.contains('\0') => return Err("not a file name".to_owned()),
            _ => parts.push(part),
        }
    }
    if parts.is_empty() || unified.is_empty() {
        return Err("not a file name".to_owned());
    }
    Ok(parts.join("/"))
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
        relative("textures", "..\\..\\x.png").expect_err("backslashes climb as well");
    }

    #[test]
    fn names_inside_the_folder_are_normalised() {
        assert_eq!(relative("", "./a//b c.png").unwrap(), "a/b c.png");
        assert_eq!(relative("maps", "wood\\oak.png").unwrap(), "maps/wood/oak.png");
        assert_eq!(relative("maps", "../wood/oak.png").unwrap(), "wood/oak.png");
        assert_eq!(relative("", "..hidden").unwrap(), "..hidden");
    }

    /// Finds a reference of a file in `folder` among files of the given names.
    fn find(names: &[&str], folder: &str, reference: &str) -> Option<(String, bool)> {
        let files = names.iter().map(|name| ((*name).to_owned(), Bytes::new())).collect();
        let found = Finder::new(&InMemory(&files)).find(folder, reference).ok()?;
        Some((found.name, found.substitute))
    }

    #[test]
    fn a_name_stands_for_the_file_that_matches_most_of_its_end() {
        let names =
            ["brick.png", "export/brick.png", "maps/Wood/OAK.png", "maps/brick.png", "Case.PNG", "case.png"];
        for (folder, reference, expected, substitute) in [
            ("", "brick.png", "brick.png", false),
            ("maps", "brick.png", "maps/brick.png", false),
            ("maps", "../brick.png", "brick.png", false),
            ("", r"D:\tower\brick.png", "brick.png", true),
            ("maps", r"D:\tower\brick.png", "maps/brick.png", true),
            ("", r"D:\tower\export\brick.png", "export/brick.png", true),
            ("", "D:brick.png", "brick.png", true),
            ("", "/home/a/BRICK.PNG", "brick.png", true),
            ("", "../../brick.png", "brick.png", true),
            ("", "../maps/./x/../wood/oak.png", "maps/Wood/OAK.png", true),
            ("", "file:///a/maps/wood/oak.png", "maps/Wood/OAK.png", true),
            ("", "case.png", "case.png", false),
            ("", "CASE.png", "Case.PNG", true),
        ] {
            assert_eq!(
                find(&names, folder, reference),
                Some((expected.to_owned(), substitute)),
                "{reference}"
            );
        }
        for none in ["oak.png", "maps", "D:/", "..", "", "brick.png/brick", "a\0b"] {
            assert_eq!(find(&names, "", none), None, "{none}");
        }
    }

    #[test]
    fn long_names_and_deep_folders_end() {
        let deep = format!("{}x", "a/".repeat(2000));
        assert_eq!(find(&[&deep], "", &format!("/{}y", "A/".repeat(5000))), None);
        assert!(find(&["x"], "", &format!("/{}x", "a/".repeat(50_000))).is_some());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_does_not_lead_out_of_the_folder() {
        let (inside, outside) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        std::fs::write(outside.path().join("secret.png"), b"x").unwrap();
        std::fs::create_dir(inside.path().join("maps")).unwrap();
        std::fs::write(inside.path().join("maps/own.png"), b"x").unwrap();
        let link =
            |to: PathBuf, name: &str| std::os::unix::fs::symlink(to, inside.path().join(name)).unwrap();
        link(outside.path().join("secret.png"), "linked.png");
        link(outside.path().to_owned(), "folder");
        link(inside.path().join("maps"), "textures");
        link(outside.path().join("secret.png"), "main.obj");
        let folder = Folder { path: inside.path().to_owned(), main: "main.obj".to_owned() };
        let mut finder = Finder::new(&folder);
        for name in ["linked.png", "LINKED.png", "folder/secret.png", "/x/Folder/Secret.png"] {
            finder.find("", name).expect_err(name);
        }
        assert!(finder.find("", "main.obj").is_ok(), "the user named it");
        assert!(finder.find("", "textures/own.png").is_ok(), "a link within the folder");
        assert_eq!(finder.find("", "Textures/own.png").unwrap().name, "textures/own.png");
    }
}

//! The journal of a data set: what it is of, and each frame that is finished. With it a run goes on where another one stopped.

use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write as _};
use std::path::Path;

use anyhow::{Context, bail};
use argus_scene::{Outputs, PlanRequest, SceneHash};
use serde::{Deserialize, Serialize};

use super::files::Written;
use crate::exit::bad_arguments;
use crate::view::record::Record;

/// Name of the file, below the folder of the data set.
pub(super) const FILE: &str = "argus-dataset.jsonl";

/// What all frames of a data set share: the journal's first line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Header {
    pub(super) scene: String,
    pub(super) scene_hash: SceneHash,
    pub(super) format: String,
    pub(super) outputs: Outputs,
    pub(super) plan: PlanRequest,
    pub(super) depth_unit: f64,
}

/// A finished frame: a line of the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    pub(super) name: String,
    #[serde(flatten)]
    pub(super) written: Written,
    /// What made the frame, and the digest of its images: what `argus replay` takes.
    pub(super) record: Record,
}

/// The journal of a run, which no other run writes at the same time.
#[derive(Debug)]
pub(super) struct Journal {
    file: File,
    /// Frames of earlier runs, by name.
    pub(super) earlier: HashMap<String, Entry>,
}

impl Journal {
    /// Opens the journal of a folder, or begins one in an empty folder.
    ///
    /// # Errors
    /// The folder holds something else, another run writes to it, or it cannot be written.
    pub(super) fn open(folder: &Path, header: &Header) -> anyhow::Result<Self> {
        let path = folder.join(FILE);
        let is_new = !path.exists();
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let within = || format!("cannot open {}", path.display());
        if is_new && folder.read_dir().with_context(within)?.next().is_some() {
            return Err(bad_arguments(format!(
                "--out {}: is not empty, and holds no data set of this command: choose another folder",
                folder.display()
            )));
        }
        let mut file =
            OpenOptions::new().read(true).append(true).create(true).open(&path).with_context(within)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                bail!("another run writes to {}: wait until it ends", folder.display())
            }
            Err(TryLockError::Error(error)) => return Err(error).with_context(within),
        }
        let mut text = Vec::new();
        file.read_to_end(&mut text).with_context(within)?;
        let text = String::from_utf8_lossy(&text);
        let Some((first, lines)) = text.split_once('\n') else {
            // Nothing, or a first line that was cut off.
            file.set_len(0).with_context(within)?;
            let mut journal = Self { file, earlier: HashMap::new() };
            journal.line(header)?;
            return Ok(journal);
        };
        agree(first, header).map_err(|reason| {
            bad_arguments(format!("--out {}: {reason}: choose another folder", folder.display()))
        })?;
        // A line that was cut off is a frame that is rendered again.
        let entries = lines.lines().filter_map(|line| serde_json::from_str::<Entry>(line).ok());
        let earlier = entries.map(|entry| (entry.name.clone(), entry)).collect();
        let mut journal = Self { file, earlier };
        if !text.ends_with('\n') {
            journal.write("\n")?;
        }
        Ok(journal)
    }

    /// Adds a finished frame, whose files are written.
    ///
    /// # Errors
    /// The journal cannot be written.
    pub(super) fn add(&mut self, entry: &Entry) -> anyhow::Result<()> {
        self.line(entry)
    }

    fn line(&mut self, value: &impl Serialize) -> anyhow::Result<()> {
        let line = serde_json::to_string(value)? + "\n";
        self.write(&line)
    }

    fn write(&mut self, text: &str) -> anyhow::Result<()> {
        let mut write = || {
            self.file.seek(SeekFrom::End(0))?;
            self.file.write_all(text.as_bytes())
        };
        write().with_context(|| format!("cannot write {FILE}"))
    }
}

/// Compares a journal's first line with what this run writes.
fn agree(first: &str, header: &Header) -> Result<(), String> {
    let ours = serde_json::to_value(header).map_err(|error| error.to_string())?;
    let Ok(theirs) = serde_json::from_str::<serde_json::Value>(first) else {
        return Err(format!("its {FILE} is no journal of a data set"));
    };
    let fields = ours.as_object().into_iter().flatten();
    for (field, ours) in fields {
        let theirs = &theirs[field];
        if theirs != ours {
            return Err(format!("it holds frames of {field} {theirs}, not {ours}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header() -> Header {
        Header {
            scene: "rooms".to_owned(),
            scene_hash: SceneHash([3; 32]),
            format: "BOP".to_owned(),
            outputs: Outputs::COLOR,
            plan: PlanRequest::default(),
            depth_unit: 0.001,
        }
    }

    #[test]
    fn a_folder_of_something_else_is_refused_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("mine.txt"), "mine").unwrap();
        let error = Journal::open(folder.path(), &header()).unwrap_err().to_string();
        assert!(error.contains("not empty"), "{error}");
        assert_eq!(folder.path().read_dir().unwrap().count(), 1);
        std::fs::write(folder.path().join(FILE), "mine\n").unwrap();
        let error = Journal::open(folder.path(), &header()).unwrap_err().to_string();
        assert!(error.contains("no journal"), "{error}");
    }

    #[test]
    fn a_data_set_of_other_settings_is_refused_by_field() {
        let folder = tempfile::tempdir().unwrap();
        drop(Journal::open(folder.path(), &header()).unwrap());
        drop(Journal::open(folder.path(), &header()).unwrap());
        let other = Header { depth_unit: 0.01, ..header() };
        let error = Journal::open(folder.path(), &other).unwrap_err().to_string();
        assert!(error.contains("depth_unit 0.001, not 0.01"), "{error}");
    }

    #[test]
    fn two_runs_do_not_write_to_one_folder() {
        let folder = tempfile::tempdir().unwrap();
        let _first = Journal::open(folder.path(), &header()).unwrap();
        let error = Journal::open(folder.path(), &header()).unwrap_err().to_string();
        assert!(error.contains("another run"), "{error}");
    }

    #[test]
    fn lines_that_were_cut_off_are_forgotten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        std::fs::write(&path, "{\"scene\": \"ro").unwrap();
        drop(Journal::open(folder.path(), &header()).unwrap());
        let whole = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, format!("{whole}{{\"name\": \"a.p")).unwrap();
        let journal = Journal::open(folder.path(), &header()).unwrap();
        assert!(journal.earlier.is_empty());
        assert!(std::fs::read_to_string(&path).unwrap().ends_with("a.p\n"));
    }
}

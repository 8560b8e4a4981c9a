//! What became of each step, and the folder that holds a campaign's results.
//!
//! Every file is replaced as a whole, so that a campaign that is cut off at any moment leaves results that can be read.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::steps::STEPS;

/// How a step ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum Outcome {
    /// Not begun yet.
    Waiting,
    /// Begun, and not ended when this was written.
    Begun,
    /// Its results are there.
    Done,
    /// It ended with an error, or was killed.
    Failed {
        /// The last thing it said, or the signal.
        reason: String,
    },
    /// It took longer than it might.
    TimedOut,
    /// It was not begun.
    Skipped {
        /// Why.
        reason: String,
    },
}

/// One step of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// [`super::Step::name`].
    pub name: String,
    /// Arguments of `argus`.
    pub command: Vec<String>,
    /// How it ended.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// Seconds that it took.
    pub secs: f64,
    /// Seconds that it might take.
    pub most_secs: f64,
}

/// A campaign.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Record {
    /// Whether its figures are noise.
    pub quick: bool,
    /// Minutes that it had.
    pub minutes: f64,
    /// In order of worth.
    pub steps: Vec<StepRecord>,
}

/// A campaign and what its steps printed, by step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Results {
    /// What became of its steps.
    pub record: Record,
    /// One JSON object of each step that printed one.
    pub printed: BTreeMap<String, Value>,
}

const RECORD: &str = "steps.json";
/// The page's name.
pub const PAGE: &str = "results.md";

impl Record {
    /// All steps, none begun.
    pub(super) fn new(quick: bool, minutes: f64) -> Self {
        let step = |step: &super::Step| StepRecord {
            name: step.name.to_owned(),
            command: step.command(quick),
            outcome: Outcome::Waiting,
            secs: 0.0,
            most_secs: 0.0,
        };
        Self { quick, minutes, steps: STEPS.iter().map(step).collect() }
    }
}

impl Results {
    /// Reads what a campaign left in a folder, also one that was cut off. What a step printed that is no JSON is left out.
    ///
    /// # Errors
    /// The folder holds no campaign.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(RECORD);
        let text = fs::read_to_string(&path)
            .with_context(|| format!("{} holds no results of a campaign", folder.display()))?;
        let record: Record =
            serde_json::from_str(&text).with_context(|| format!("cannot read {}", path.display()))?;
        let mut printed = BTreeMap::new();
        for step in &record.steps {
            let text = fs::read_to_string(folder.join(format!("{}.json", step.name))).unwrap_or_default();
            if let Ok(value) = serde_json::from_str(&text) {
                printed.insert(step.name.clone(), value);
            }
        }
        Ok(Self { record, printed })
    }
}

/// The folder of a campaign that is under way.
#[derive(Debug, Clone)]
pub(super) struct Folder(PathBuf);

impl Folder {
    /// Makes the folder if need be, and removes what an earlier campaign's steps printed there.
    pub(super) fn new(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))?;
        for step in &STEPS {
            for kind in ["json", "part", "log"] {
                // Mostly there is none.
                let _ = fs::remove_file(path.join(format!("{}.{kind}", step.name)));
            }
        }
        Ok(Self(path.to_owned()))
    }

    /// A file of a step.
    pub(super) fn file(&self, step: &str, kind: &str) -> PathBuf {
        self.0.join(format!("{step}.{kind}"))
    }

    /// Replaces record and page.
    pub(super) fn write(&self, record: &Record, page: &str) -> Result<()> {
        self.replace(RECORD, &serde_json::to_string_pretty(record)?)?;
        self.replace(PAGE, page)
    }

    /// Takes over what a step printed, if it is JSON.
    pub(super) fn take_over(&self, step: &str) -> Result<Option<Value>> {
        let part = self.file(step, "part");
        let text = fs::read_to_string(&part).unwrap_or_default();
        let value = serde_json::from_str(&text).ok();
        if value.is_some() {
            fs::rename(&part, self.file(step, "json"))
                .with_context(|| format!("cannot rename {}", part.display()))?;
        } else {
            let _ = fs::remove_file(&part);
        }
        Ok(value)
    }

    fn replace(&self, name: &str, text: &str) -> Result<()> {
        let (path, fresh) = (self.0.join(name), self.0.join(format!(".{name}")));
        let written = fs::write(&fresh, text).and_then(|()| fs::rename(&fresh, &path));
        written.with_context(|| format!("cannot write {}", path.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_survive_their_folder_and_half_a_result_counts_as_none() {
        let folder = tempfile::tempdir().unwrap();
        let own = Folder::new(folder.path()).unwrap();
        let mut record = Record::new(true, 1.5);
        record.steps[0].outcome = Outcome::Failed { reason: "no device".to_owned() };
        record.steps[1].outcome = Outcome::Begun;
        own.write(&record, "# page\n").unwrap();
        fs::write(own.file("device", "part"), "{\"rows\": [").unwrap();
        fs::write(own.file("selftest", "part"), "{\"passed\": false}").unwrap();
        assert_eq!(own.take_over("device").unwrap(), None);
        assert!(own.take_over("selftest").unwrap().is_some());
        let read = Results::read(folder.path()).unwrap();
        assert_eq!(read.record, record);
        assert_eq!(read.printed.keys().collect::<Vec<_>>(), ["selftest"]);
        // The next campaign in the same folder begins with nothing.
        Folder::new(folder.path()).unwrap();
        assert!(Results::read(folder.path()).unwrap().printed.is_empty());
    }

    #[test]
    fn a_folder_without_a_campaign_is_named_in_the_error() {
        let folder = tempfile::tempdir().unwrap();
        let error = Results::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains(&folder.path().display().to_string()), "{error}");
    }
}

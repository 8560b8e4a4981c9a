//! The outcome of each step, and the folder that holds a campaign's results.
//!
//! Every file is replaced as a whole, so that an interrupted campaign leaves readable results.

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
    /// Begun; not ended when this was written.
    Begun,
    /// Ended; its results were written.
    Done,
    /// It ended with an error, or was killed.
    Failed {
        /// The last line that it logged, or the signal.
        reason: String,
    },
    /// It exceeded its time limit.
    TimedOut,
    /// It was not begun.
    Skipped {
        /// Why.
        reason: String,
    },
}

/// One step and its outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// The step's name, [`super::Step::name`].
    pub name: String,
    /// Arguments of `argus`.
    pub command: Vec<String>,
    /// How it ended.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// Seconds that it ran.
    pub secs: f64,
    /// Its time limit in seconds.
    pub most_secs: f64,
}

/// All steps of a campaign.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Record {
    /// Whether the campaign was quick, so that its figures are noise.
    pub quick: bool,
    /// Time limit in minutes.
    pub minutes: f64,
    /// The steps, the most valuable first.
    pub steps: Vec<StepRecord>,
}

/// A campaign and the output of its steps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Results {
    /// The steps and their outcomes.
    pub record: Record,
    /// The JSON object that each step printed, by the step's name.
    pub printed: BTreeMap<String, Value>,
}

const RECORD: &str = "steps.json";
/// The page's file name.
pub const PAGE: &str = "results.md";

impl Record {
    /// All steps; none has begun.
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
    /// Reads a campaign's folder, even of an interrupted campaign. A step's output that is not JSON is skipped.
    ///
    /// # Errors
    /// The folder holds no campaign, or its record cannot be read.
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

/// The folder of a running campaign.
#[derive(Debug, Clone)]
pub(super) struct Folder(PathBuf);

impl Folder {
    /// Creates the folder if needed, and removes the step files of an earlier campaign.
    pub(super) fn new(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))?;
        for step in &STEPS {
            for kind in ["json", "part", "log"] {
                // Usually the file does not exist.
                let _ = fs::remove_file(path.join(format!("{}.{kind}", step.name)));
            }
        }
        Ok(Self(path.to_owned()))
    }

    /// The path of a step's file.
    pub(super) fn file(&self, step: &str, kind: &str) -> PathBuf {
        self.0.join(format!("{step}.{kind}"))
    }

    /// Replaces the record and the page.
    pub(super) fn write(&self, record: &Record, page: &str) -> Result<()> {
        self.replace(RECORD, &serde_json::to_string_pretty(record)?)?;
        self.replace(PAGE, page)
    }

    /// Keeps a step's output if it is JSON; deletes it otherwise.
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
    fn results_are_read_back_and_an_incomplete_output_is_dropped() {
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
        // The next campaign in the same folder starts empty.
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

//! Campaign: runs the steps that need a GPU within a given time, the most valuable first, each in its own process.
//!
//! Results are written after every step, so an interrupted campaign loses nothing. A step that fails, is killed or runs
//! out of time becomes a row with the reason.

mod beside;
mod page;
mod record;
mod schedule;
mod steps;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Result;
use indicatif::ProgressBar;
use serde_json::Value;
use tokio_util::sync::CancellationToken;

use self::record::Folder;
pub use self::record::{Outcome, PAGE, Record, Results, StepRecord};
use self::steps::SELFTEST;
pub use self::steps::{STEPS, Step};
use crate::child::{self, Ended};

/// What a campaign runs and where it writes.
#[derive(Debug, Clone)]
pub struct Options {
    /// Whether every step runs with its smallest options.
    pub quick: bool,
    /// Time limit in minutes.
    pub minutes: f64,
    /// Folder for the results.
    pub out: PathBuf,
    /// Folder of another campaign to compare with.
    pub beside: Option<PathBuf>,
}

/// Runs a campaign of the program `argus`; `progress` counts steps. Cancelling `stop` ends the running step, and no
/// further step starts.
///
/// # Errors
/// The folder cannot be written to, the other campaign cannot be read, or the program cannot be started. A failed step is
/// part of the results.
pub async fn run(
    argus: &Path,
    options: &Options,
    progress: &ProgressBar,
    stop: &CancellationToken,
) -> Result<Results> {
    let begin = Instant::now();
    let time = Duration::from_secs_f64(options.minutes * 60.0);
    let other = options.beside.as_deref().map(Results::read).transpose()?;
    let folder = Folder::new(&options.out)?;
    let mut results = Results { record: Record::new(options.quick, options.minutes), ..Results::default() };
    progress.set_length(STEPS.len() as u64);
    for (at, step) in STEPS.iter().enumerate() {
        progress.set_message(step.name);
        let most = match reason_to_skip(&results, stop) {
            Some(reason) => Err(reason),
            None => schedule::allot(step, options.quick, time.saturating_sub(begin.elapsed())),
        };
        let outcome = match most {
            Err(reason) => Outcome::Skipped { reason },
            Ok(most) => {
                results.record.steps[at].most_secs = seconds(most);
                results.record.steps[at].outcome = Outcome::Begun;
                folder.write(&results.record, &page::page(&results, other.as_ref()))?;
                let began = Instant::now();
                let outcome = run_step(argus, step, options.quick, &folder, most, stop, &mut results).await?;
                results.record.steps[at].secs = seconds(began.elapsed());
                outcome
            }
        };
        results.record.steps[at].outcome = outcome;
        folder.write(&results.record, &page::page(&results, other.as_ref()))?;
        progress.inc(1);
    }
    Ok(results)
}

/// Seconds, rounded to milliseconds so that JSON stores them without loss.
fn seconds(time: Duration) -> f64 {
    (time.as_secs_f64() * 1e3).round() / 1e3
}

/// Runs one step and keeps the JSON that it printed, even if it failed.
async fn run_step(
    argus: &Path,
    step: &Step,
    quick: bool,
    folder: &Folder,
    most: Duration,
    stop: &CancellationToken,
    results: &mut Results,
) -> Result<Outcome> {
    let [output, log] = ["part", "log"].map(|kind| folder.file(step.name, kind));
    let ended = child::run(argus, &step.command(quick), [&output, &log], most, stop).await?;
    let printed = folder.take_over(step.name)?;
    let complete = printed.is_some();
    if let Some(value) = printed {
        results.printed.insert(step.name.to_owned(), value);
    }
    Ok(match ended {
        Ended::TimedOut => Outcome::TimedOut,
        Ended::Stopped => Outcome::Failed { reason: "the campaign was stopped".to_owned() },
        Ended::Exit(status) if status.success() && complete => Outcome::Done,
        Ended::Exit(status) if status.success() => {
            Outcome::Failed { reason: "it printed no JSON object".to_owned() }
        }
        Ended::Exit(status) => Outcome::Failed { reason: child::reason(status, &log) },
    })
}

/// Why no further step may start: the campaign was stopped, or no device opens.
fn reason_to_skip(results: &Results, stop: &CancellationToken) -> Option<String> {
    if stop.is_cancelled() {
        return Some("the campaign was stopped".to_owned());
    }
    let tested = results.printed.get(SELFTEST)?;
    tested.get("device").is_some_and(Value::is_null).then(|| "no device opens, see selftest".to_owned())
}

#[cfg(all(test, unix))]
mod tests {
    #![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

    use std::fs;
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    /// Writes a program that runs a shell script; `$1` is `selftest` or `study`, `$2` its kind, `$3` its name.
    fn program(folder: &Path, script: &str) -> PathBuf {
        let path = folder.join("argus");
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    async fn campaign(
        script: &str,
        minutes: f64,
        stop: &CancellationToken,
    ) -> (Results, String, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let argus = program(folder.path(), script);
        let out = folder.path().join("results");
        let options = Options { quick: true, minutes, out: out.clone(), beside: None };
        let results = run(&argus, &options, &ProgressBar::hidden(), stop).await.unwrap();
        let page = fs::read_to_string(out.join(PAGE)).unwrap();
        assert_eq!(Results::read(&out).unwrap(), results, "the folder holds the whole result");
        (results, page, folder)
    }

    fn state<'a>(results: &'a Results, name: &str) -> &'a Outcome {
        &results.record.steps.iter().find(|step| step.name == name).unwrap().outcome
    }

    #[tokio::test]
    async fn a_failed_step_becomes_a_row_with_its_reason_and_later_steps_run() {
        let script = r#"
            case "$3" in
                warp) echo "argus: no such thing" >&2; exit 1;;
                burst) kill -9 $$;;
                manylods) echo "half a";;
                virtual-lights) echo '{"rows": [{"way": "vpl"}]}'; echo "argus: 1 of 1 cases" >&2; exit 1;;
                *) echo '{"rows": [{"view_ms": 1.5}], "device": {}}';;
            esac"#;
        let (results, page, _folder) = campaign(script, 5.0, &CancellationToken::new()).await;
        assert_eq!(state(&results, "warp"), &Outcome::Failed { reason: "argus: no such thing".to_owned() });
        assert_eq!(state(&results, "burst"), &Outcome::Failed { reason: "killed by signal 9".to_owned() });
        assert!(matches!(state(&results, "manylods"), Outcome::Failed { .. }));
        assert!(matches!(state(&results, "virtual-lights"), Outcome::Failed { .. }));
        assert!(results.printed.contains_key("virtual-lights"), "what it printed is kept");
        assert_eq!(state(&results, "service"), &Outcome::Done);
        assert!(
            page.contains("FAILED: argus: no such thing") && page.contains("## virtual-lights"),
            "{page}"
        );
    }

    #[tokio::test]
    async fn without_a_device_no_further_step_starts() {
        let script =
            r#"echo '{"passed": false, "device": null, "checks": []}'; echo "argus: no driver" >&2; exit 1"#;
        let (results, page, _folder) = campaign(script, 5.0, &CancellationToken::new()).await;
        assert_eq!(state(&results, "selftest"), &Outcome::Failed { reason: "argus: no driver".to_owned() });
        assert!(
            matches!(state(&results, "parts"), Outcome::Skipped { reason } if reason.contains("no device"))
        );
        assert!(page.contains("FAILED: argus: no driver"), "{page}");
    }

    #[tokio::test]
    async fn an_interrupted_campaign_leaves_its_page_and_results() {
        let folder = tempfile::tempdir().unwrap();
        let argus = program(
            folder.path(),
            r#"[ "$3" = parts ] && exec sleep 60; echo '{"rows": [], "device": {"adapter": "A"}}'"#,
        );
        let out = folder.path().join("results");
        let options = Options { quick: true, minutes: 5.0, out: out.clone(), beside: None };
        let (progress, stop) = (ProgressBar::hidden(), CancellationToken::new());
        // The future is dropped in its second step, as if the process were killed.
        let whole = run(&argus, &options, &progress, &stop);
        let cut = tokio::time::timeout(Duration::from_secs(5), whole).await;
        assert!(cut.is_err(), "the second step sleeps");
        let results = Results::read(&out).unwrap();
        assert_eq!(state(&results, "selftest"), &Outcome::Done);
        assert_eq!(state(&results, "parts"), &Outcome::Begun);
        assert_eq!(state(&results, "service"), &Outcome::Waiting);
        let page = fs::read_to_string(out.join(PAGE)).unwrap();
        assert!(page.contains("On A") && page.contains("not ended when this page was written"), "{page}");
    }

    #[tokio::test]
    async fn a_stopped_campaign_reports_it_and_ends() {
        let stop = CancellationToken::new();
        let ends = stop.clone();
        tokio::spawn(async move {
            tokio::time::sleep(Duration::from_millis(500)).await;
            ends.cancel();
        });
        let (results, _, _folder) = campaign("sleep 60", 5.0, &stop).await;
        assert!(
            matches!(state(&results, "selftest"), Outcome::Failed { reason } if reason.contains("stopped"))
        );
        assert!(
            matches!(state(&results, "parts"), Outcome::Skipped { reason } if reason.contains("stopped"))
        );
    }

    #[tokio::test]
    async fn steps_without_time_left_are_skipped() {
        let (results, page, _folder) = campaign("echo '{}'", 0.01, &CancellationToken::new()).await;
        assert!(results.record.steps.iter().all(|step| matches!(step.outcome, Outcome::Skipped { .. })));
        assert!(page.contains("left out: no time left"), "{page}");
    }

    #[tokio::test]
    async fn a_missing_program_is_named_in_the_error() {
        let folder = tempfile::tempdir().unwrap();
        let argus = folder.path().join("argus");
        let out = folder.path().join("results");
        let options = Options { quick: true, minutes: 5.0, out, beside: None };
        let error =
            run(&argus, &options, &ProgressBar::hidden(), &CancellationToken::new()).await.unwrap_err();
        assert!(error.to_string().contains(&argus.display().to_string()), "{error}");
    }
}

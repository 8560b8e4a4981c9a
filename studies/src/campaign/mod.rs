//! A campaign: the steps that need a GPU, each in a process of its own, in order of worth within a given time.
//!
//! A machine with a GPU is at hand for minutes at a time. Results are written as they come, so that a campaign that is cut
//! off loses nothing; a step that fails, is killed or takes too long is a row with its reason.

mod beside;
mod child;
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

use self::child::Ended;
use self::record::Folder;
pub use self::record::{Outcome, PAGE, Record, Results, StepRecord};
use self::steps::SELFTEST;
pub use self::steps::{STEPS, Step};

/// What a campaign does.
#[derive(Debug, Clone)]
pub struct Options {
    /// The least that runs every step.
    pub quick: bool,
    /// Minutes that it may take.
    pub minutes: f64,
    /// The folder for its results.
    pub out: PathBuf,
    /// The folder of another campaign, whose figures stand beside.
    pub beside: Option<PathBuf>,
}

/// Runs a campaign of the program `argus`; `progress` counts steps. Once `stop` is cancelled the step that runs is ended,
/// and no other begins.
///
/// # Errors
/// A folder that cannot be written to, another campaign that cannot be read, a program that cannot be started. Steps that
/// fail are in the results.
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

/// To the millisecond, which decimals carry without loss.
fn seconds(time: Duration) -> f64 {
    (time.as_secs_f64() * 1e3).round() / 1e3
}

/// Runs one step and takes over what it printed, also where it failed.
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

/// Why no further step is begun: the campaign was stopped, or there is no device.
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

    /// A program that does for each step what a shell script says; `$1` is `selftest` or `study`, `$2` the study.
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
        assert_eq!(Results::read(&out).unwrap(), results, "the folder holds all that there is");
        (results, page, folder)
    }

    fn state<'a>(results: &'a Results, name: &str) -> &'a Outcome {
        &results.record.steps.iter().find(|step| step.name == name).unwrap().outcome
    }

    #[tokio::test]
    async fn a_step_that_fails_is_a_row_with_its_reason_and_the_others_go_on() {
        let script = r#"
            case "$2" in
                warp) echo "argus: no such thing" >&2; exit 1;;
                burst) kill -9 $$;;
                manylods) echo "half a";;
                radiosity) echo '{"rows": [{"way": "vpl"}]}'; echo "argus: 1 of 1 cases" >&2; exit 1;;
                *) echo '{"rows": [{"view_ms": 1.5}], "device": {}}';;
            esac"#;
        let (results, page, _folder) = campaign(script, 5.0, &CancellationToken::new()).await;
        assert_eq!(state(&results, "warp"), &Outcome::Failed { reason: "argus: no such thing".to_owned() });
        assert_eq!(state(&results, "burst"), &Outcome::Failed { reason: "killed by signal 9".to_owned() });
        assert!(matches!(state(&results, "manylods"), Outcome::Failed { .. }));
        assert!(matches!(state(&results, "radiosity"), Outcome::Failed { .. }));
        assert!(results.printed.contains_key("radiosity"), "what it printed is kept");
        assert_eq!(state(&results, "service"), &Outcome::Done);
        assert!(page.contains("FAILED: argus: no such thing") && page.contains("## radiosity"), "{page}");
    }

    #[tokio::test]
    async fn without_a_device_nothing_else_is_begun() {
        let script =
            r#"echo '{"passed": false, "device": null, "checks": []}'; echo "argus: no driver" >&2; exit 1"#;
        let (results, page, _folder) = campaign(script, 5.0, &CancellationToken::new()).await;
        assert_eq!(state(&results, "selftest"), &Outcome::Failed { reason: "argus: no driver".to_owned() });
        assert!(
            matches!(state(&results, "device"), Outcome::Skipped { reason } if reason.contains("no device"))
        );
        assert!(page.contains("FAILED: argus: no driver"), "{page}");
    }

    #[tokio::test]
    async fn a_campaign_that_is_cut_off_leaves_its_page_and_its_results() {
        let folder = tempfile::tempdir().unwrap();
        let argus = program(
            folder.path(),
            r#"[ "$2" = device ] && exec sleep 60; echo '{"rows": [], "device": {"adapter": "A"}}'"#,
        );
        let out = folder.path().join("results");
        let options = Options { quick: true, minutes: 5.0, out: out.clone(), beside: None };
        let (progress, stop) = (ProgressBar::hidden(), CancellationToken::new());
        // Dropped in the middle of its second step, as a process that is killed.
        let whole = run(&argus, &options, &progress, &stop);
        let cut = tokio::time::timeout(Duration::from_secs(5), whole).await;
        assert!(cut.is_err(), "the second step sleeps");
        let results = Results::read(&out).unwrap();
        assert_eq!(state(&results, "selftest"), &Outcome::Done);
        assert_eq!(state(&results, "device"), &Outcome::Begun);
        assert_eq!(state(&results, "service"), &Outcome::Waiting);
        let page = fs::read_to_string(out.join(PAGE)).unwrap();
        assert!(page.contains("On A") && page.contains("not ended when this page was written"), "{page}");
    }

    #[tokio::test]
    async fn a_campaign_that_is_stopped_says_so_and_ends() {
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
            matches!(state(&results, "device"), Outcome::Skipped { reason } if reason.contains("stopped"))
        );
    }

    #[tokio::test]
    async fn steps_beyond_the_time_are_left_out() {
        let (results, page, _folder) = campaign("echo '{}'", 0.01, &CancellationToken::new()).await;
        assert!(results.record.steps.iter().all(|step| matches!(step.outcome, Outcome::Skipped { .. })));
        assert!(page.contains("left out: no time left"), "{page}");
    }

    #[tokio::test]
    async fn a_program_that_is_missing_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let argus = folder.path().join("argus");
        let out = folder.path().join("results");
        let options = Options { quick: true, minutes: 5.0, out, beside: None };
        let error =
            run(&argus, &options, &ProgressBar::hidden(), &CancellationToken::new()).await.unwrap_err();
        assert!(error.to_string().contains(&argus.display().to_string()), "{error}");
    }
}

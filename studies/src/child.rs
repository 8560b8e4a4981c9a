//! Runs one study's process: its output goes to files, and its whole process group ends with it.

use std::fs::{self, File};
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result};
use tokio::process::Command;
use tokio_util::sync::CancellationToken;

/// How a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ended {
    /// It exited by itself, or by a signal from outside.
    Exit(ExitStatus),
    /// It was killed because it exceeded its time limit.
    TimedOut,
    /// It was killed because the caller was stopped.
    Stopped,
}

/// Runs a program to its end or for at most `most`. Standard output and error go to files.
///
/// # Errors
/// The program cannot be started, or a file cannot be created.
pub(crate) async fn run(
    program: &Path,
    arguments: &[String],
    [output, log]: [&Path; 2],
    most: Duration,
    stop: &CancellationToken,
) -> Result<Ended> {
    let file = |path: &Path| File::create(path).with_context(|| format!("cannot write {}", path.display()));
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null()).stdout(file(output)?).stderr(file(log)?);
    // A process group of its own, so that a study's cluster ends with the study.
    #[cfg(unix)]
    command.process_group(0);
    let mut child =
        command.kill_on_drop(true).spawn().with_context(|| format!("cannot start {}", program.display()))?;
    let group = child.id();
    let ended = tokio::select! {
        status = child.wait() => Ended::Exit(status?),
        () = tokio::time::sleep(most) => Ended::TimedOut,
        () = stop.cancelled() => Ended::Stopped,
    };
    kill_group(group);
    if !matches!(ended, Ended::Exit(_)) {
        let _ = child.start_kill();
        child.wait().await?;
    }
    Ok(ended)
}

/// Kills the rest of a process group.
fn kill_group(group: Option<u32>) {
    #[cfg(unix)]
    if let Some(pid) = group.and_then(|id| rustix::process::Pid::from_raw(id.cast_signed())) {
        // Usually the group is empty.
        let _ = rustix::process::kill_process_group(pid, rustix::process::Signal::KILL);
    }
    #[cfg(not(unix))]
    let _ = group;
}

/// Why a process failed: its signal, or the last line of its log.
pub(crate) fn reason(status: ExitStatus, log: &Path) -> String {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return format!("killed by signal {signal}");
    }
    let text = fs::read_to_string(log).unwrap_or_default();
    let last = text.lines().map(str::trim).rfind(|line| !line.is_empty());
    last.map_or_else(|| status.to_string(), str::to_owned)
}

#[cfg(all(test, unix))]
mod tests {
    #![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

    use std::time::Instant;

    use super::*;

    async fn shell(script: &str, most: Duration, stop: &CancellationToken) -> (Ended, String, String) {
        let folder = tempfile::tempdir().unwrap();
        let [output, log] = ["out", "log"].map(|name| folder.path().join(name));
        let arguments = ["-c".to_owned(), script.to_owned()];
        let ended = run(Path::new("/bin/sh"), &arguments, [&output, &log], most, stop).await.unwrap();
        let why = match ended {
            Ended::Exit(status) => reason(status, &log),
            _ => String::new(),
        };
        (ended, fs::read_to_string(output).unwrap(), why)
    }

    const LONG: Duration = Duration::from_secs(30);

    #[tokio::test]
    async fn a_failure_reports_the_last_log_line_or_the_signal() {
        let stop = CancellationToken::new();
        let (ended, output, why) =
            shell("echo found; echo first >&2; echo last >&2; exit 3", LONG, &stop).await;
        assert!(matches!(ended, Ended::Exit(status) if status.code() == Some(3)));
        assert_eq!((output.as_str(), why.as_str()), ("found\n", "last"));
        let (_, _, why) = shell("kill -9 $$", LONG, &stop).await;
        assert_eq!(why, "killed by signal 9");
    }

    #[tokio::test]
    #[cfg(target_os = "linux")]
    async fn a_step_that_exceeds_its_time_is_killed_with_its_children() {
        let begin = Instant::now();
        let script = "sleep 60 & echo $!; wait";
        let (ended, output, _) = shell(script, Duration::from_millis(300), &CancellationToken::new()).await;
        assert_eq!(ended, Ended::TimedOut);
        assert!(begin.elapsed() < LONG);
        let pid: u32 = output.trim().parse().unwrap();
        // The orphan is reaped by init: at most it is a zombie for a moment.
        let ended = || {
            let status = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            status.is_empty() || status.contains(") Z") || status.contains(") X")
        };
        while !ended() {
            assert!(begin.elapsed() < LONG, "it still runs");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    #[tokio::test]
    async fn a_stopped_campaign_does_not_wait_for_its_step() {
        let stop = CancellationToken::new();
        stop.cancel();
        let begin = Instant::now();
        assert_eq!(shell("sleep 60", LONG, &stop).await.0, Ended::Stopped);
        assert!(begin.elapsed() < LONG);
    }

    #[tokio::test]
    async fn a_missing_program_is_named_in_the_error() {
        let folder = tempfile::tempdir().unwrap();
        let [output, log] = ["out", "log"].map(|name| folder.path().join(name));
        let missing = folder.path().join("argus");
        let error = run(&missing, &[], [&output, &log], LONG, &CancellationToken::new()).await.unwrap_err();
        assert!(error.to_string().contains(&missing.display().to_string()), "{error}");
    }
}

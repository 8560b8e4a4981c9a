//! A step's process: what it prints goes to files, and all that it started ends with it.

use std::fs::{self, File};
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result};
use tokio::process::Command;
use tokio_util::sync::CancellationToken;

/// How a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ended {
    /// By itself, or by somebody else's signal.
    Exit(ExitStatus),
    /// It was killed since it took too long.
    TimedOut,
    /// It was killed since the campaign was stopped.
    Stopped,
}

/// Runs a program to its end, at most for `most`; standard output and error go to files.
///
/// # Errors
/// The program cannot be started, or a file cannot be made.
pub(super) async fn run(
    program: &Path,
    arguments: &[String],
    [output, log]: [&Path; 2],
    most: Duration,
    stop: &CancellationToken,
) -> Result<Ended> {
    let file = |path: &Path| File::create(path).with_context(|| format!("cannot write {}", path.display()));
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null()).stdout(file(output)?).stderr(file(log)?);
    // A group of its own: a study's cluster ends with the study.
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

/// Ends what a process left of its group.
fn kill_group(group: Option<u32>) {
    #[cfg(unix)]
    if let Some(pid) = group.and_then(|id| rustix::process::Pid::from_raw(id.cast_signed())) {
        // Mostly nothing is left.
        let _ = rustix::process::kill_process_group(pid, rustix::process::Signal::KILL);
    }
    #[cfg(not(unix))]
    let _ = group;
}

/// Why a process failed, by how it ended and the last line that it wrote.
pub(super) fn reason(status: ExitStatus, log: &Path) -> String {
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
    async fn a_failure_says_the_last_line_and_a_killed_process_its_signal() {
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
    async fn what_takes_too_long_ends_with_all_that_it_started() {
        let begin = Instant::now();
        let script = "sleep 60 & echo $!; wait";
        let (ended, output, _) = shell(script, Duration::from_millis(300), &CancellationToken::new()).await;
        assert_eq!(ended, Ended::TimedOut);
        assert!(begin.elapsed() < LONG);
        let pid: u32 = output.trim().parse().unwrap();
        // Its parent is gone, so that whoever adopts it has to reap it: at most it is a zombie, and soon.
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
    async fn a_campaign_that_is_stopped_does_not_wait_for_its_step() {
        let stop = CancellationToken::new();
        stop.cancel();
        let begin = Instant::now();
        assert_eq!(shell("sleep 60", LONG, &stop).await.0, Ended::Stopped);
        assert!(begin.elapsed() < LONG);
    }

    #[tokio::test]
    async fn a_program_that_is_not_there_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let [output, log] = ["out", "log"].map(|name| folder.path().join(name));
        let missing = folder.path().join("argus");
        let error = run(&missing, &[], [&output, &log], LONG, &CancellationToken::new()).await.unwrap_err();
        assert!(error.to_string().contains(&missing.display().to_string()), "{error}");
    }
}

//! Keeps worker processes of this machine running: starts, restarts and stops them.

use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use argus_gpu::quirks::worker_environment;
use tokio::process::{Child, Command};
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use crate::settings::{self, Settings};

/// A process that ends within this time of its start counts as failed early.
const EARLY: Duration = Duration::from_secs(10);
/// After this many early ends in a row a worker is not restarted.
const MOST_EARLY_ENDS: u32 = 5;
/// Pause before the first restart; doubles with each early end.
const FIRST_PAUSE: Duration = Duration::from_millis(200);

/// Pause after a worker was killed by another process.
const KILLED_PAUSE: Duration = Duration::from_millis(20);
/// Time for a worker to stop: its own grace for views in work, and some more.
const GRACE: Duration = Duration::from_secs(10);

/// The default number of worker processes: at least two, so that both roles are filled, and at most four, since the
/// workers of one machine share its device.
pub(crate) fn default_count() -> usize {
    cores().clamp(2, 4)
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The worker processes to keep running.
pub(crate) struct Start<'a> {
    /// Number of workers.
    pub(crate) count: usize,
    /// The settings of each. Their coordinator may not listen yet.
    pub(crate) settings: &'a Settings,
    /// The scene to be served, which the first worker opens at once.
    pub(crate) scene: &'a str,
    /// Cancelled once the service is ready for load with the first worker; the remaining ones start then.
    pub(crate) answers: CancellationToken,
}

/// Keeps workers running until `shutdown`, then lets them finish.
///
/// # Errors
/// A worker repeatedly ends as soon as it starts.
pub(crate) async fn keep(start: Start<'_>, shutdown: CancellationToken) -> anyhow::Result<()> {
    let mut workers = JoinSet::new();
    for index in 0..start.count {
        let (count, settings, answers) = (start.count, start.settings.clone(), start.answers.clone());
        let preload = (index == 0).then(|| format!("--preload={}", start.scene));
        let (shutdown, waits) = (shutdown.clone(), index > 0);
        workers.spawn(async move {
            if waits {
                tokio::select! {
                    () = answers.cancelled() => {}
                    () = shutdown.cancelled() => return Ok(()),
                }
            }
            keep_one(index, count, settings, preload, shutdown).await
        });
    }
    let mut result = Ok(());
    while let Some(ended) = workers.join_next().await {
        let ended = ended.context("a task of this process failed").and_then(|inner| inner);
        if ended.is_err() {
            shutdown.cancel();
            result = result.and(ended);
        }
    }
    result
}

/// Whether another process killed it.
fn was_killed(status: ExitStatus) -> bool {
    const SIGKILL: i32 = 9;
    #[cfg(unix)]
    return std::os::unix::process::ExitStatusExt::signal(&status) == Some(SIGKILL);
    #[cfg(not(unix))]
    return false;
}

async fn keep_one(
    index: usize,
    count: usize,
    settings: Settings,
    preload: Option<String>,
    shutdown: CancellationToken,
) -> anyhow::Result<()> {
    let mut early_ends = 0;
    loop {
        let started = Instant::now();
        // A new file for each start: cleaners of temporary folders remove old ones.
        let file = settings.to_file()?;
        let mut child = start(count, file.path(), preload.as_deref())?;
        // Waiting for a child would close its standard input, which tells the worker that its parent has ended.
        let input = child.stdin.take();
        let status = tokio::select! {
            status = child.wait() => status?,
            () = shutdown.cancelled() => {
                drop(input);
                return stop(child).await;
            }
        };
        if shutdown.is_cancelled() {
            return Ok(());
        }
        early_ends = match started.elapsed() < EARLY {
            // A kill by another process does not tell whether the worker can work.
            true if was_killed(status) => early_ends.max(1),
            true => early_ends + 1,
            false => 0,
        };
        if early_ends == MOST_EARLY_ENDS {
            bail!("worker {index} ends as soon as it starts ({status}); its error is above");
        }
        let pause = if was_killed(status) { KILLED_PAUSE } else { FIRST_PAUSE * 2u32.pow(early_ends) };
        tracing::warn!("worker {index} ended ({status}); it is restarted in {} ms", pause.as_millis());
        tokio::select! {
            () = tokio::time::sleep(pause) => {}
            () = shutdown.cancelled() => return Ok(()),
        }
    }
}

fn start(count: usize, file: &Path, preload: Option<&str>) -> anyhow::Result<Child> {
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command = Command::new(&program);
    command
        .args(["worker", "--exit-with-stdin", "--config"])
        .arg(file)
        .args(preload)
        // Workers end when this pipe closes, however this process ends.
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .kill_on_drop(true);
    // The file has the values of the environment too, and those of flags, which override it.
    for (name, ..) in settings::variables() {
        command.env_remove(name);
    }
    command.envs(worker_environment(cores() / count));
    command.spawn().with_context(|| format!("cannot start {}", program.display()))
}

async fn stop(mut child: Child) -> anyhow::Result<()> {
    match tokio::time::timeout(GRACE, child.wait()).await {
        Ok(status) => report(status?),
        Err(_) => child.kill().await.context("cannot end a worker")?,
    }
    Ok(())
}

fn report(status: ExitStatus) {
    if !status.success() {
        tracing::warn!("a worker ended with {status} while it was stopped");
    }
}
